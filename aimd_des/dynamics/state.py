"""The state of all agents and the parameters of their rule, in arrays with one row per resource."""

from typing import Any, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from aimd_des.dynamics.averaging import (
    CUMULATIVE,
    FORGETTING,
    POLYNOMIAL,
    WINDOW,
    Averaging,
    AveragingParameters,
    Cumulative,
)
from aimd_des.dynamics.loss_compensation import (
    ESTIMATED,
    KNOWN,
    NOTHING,
    Compensation,
    CompensationParameters,
    no_compensation,
)
from aimd_des.dynamics.responses import (
    AVERAGE,
    DRAWN,
    FULL,
    OWN,
    Randomised,
    Response,
    ResponseParameters,
    memory_columns,
)
from aimd_des.utils import returned_values, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import each, locked
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray, IntArray

_Form = TypeVar("_Form")


@record
class State(NamedTuple):
    """What changes: every array has shape (m, n), `parts` and `memory` one axis more."""

    demand: FloatArray  # demand just after the anchor, in units of the resource
    accumulated: FloatArray  # demand accumulated up to the anchor: over ticks, or over time
    # The last moment at which growth was broken: index of the tick (-1 before the first), or time.
    anchor: FloatArray
    # Decreases, and those of them that had a response probability above 1.
    responses: IntArray
    saturated: IntArray
    origin: FloatArray  # moments that count for nothing, since the agent was away
    pause: FloatArray  # the last moment that counts for an agent that is away; inf for those that are here
    parts: FloatArray  # accumulated demand at the boundaries of a window's parts; empty without a window
    # Signals heard, and the numbers of the first and the latest as the agent counts; kept where agents
    # estimate their loss.
    heard: IntArray
    first: IntArray
    latest: IntArray
    answered: IntArray  # ticks or times at which a signal was answered; kept where agents compensate
    memory: FloatArray  # what the response keeps for each agent and resource; empty with the paper's


@record
class AgentParameters(NamedTuple):
    """The parameters of the agents' rule; only the functions of interventions can write there."""

    # (m, n): alpha and beta; alpha is 0 while an agent is away.
    increase: FloatArray
    decrease: FloatArray
    normalization: FloatArray  # (m,): Gamma
    limit: FloatArray  # (m,): total demand above which a capacity event is due
    capacity: FloatArray  # (m,): C
    averaging: AveragingParameters  # how demand is averaged
    compensation: CompensationParameters  # how losses are made good for
    response: ResponseParameters  # how signals are answered


class Shared(Protocol):
    """What the rule asks of a problem; it need not know of costs and their optimum."""

    n_agents: int
    # Of each resource, (m,).
    normalization: FloatArray
    capacity: FloatArray

    @property
    def limit(self) -> FloatArray:
        """Total demand above which a capacity event is due, (m,)."""
        ...

    def by_resource(self, name: Literal["increase", "decrease"]) -> FloatArray:
        """Spread alpha or beta over the agents, (m, n)."""
        ...


def agent_parameters(
    problem: Shared,
    tick_weight: float,
    averaging: Averaging | None = None,
    compensation: Compensation | None = None,
    response: Response | None = None,
) -> AgentParameters:
    """Lay out a problem's parameters with agents along the contiguous axis."""
    rule = rule_parameters(problem.n_agents, tick_weight, averaging, compensation, response)
    return AgentParameters(
        increase=locked(problem.by_resource("increase").copy()),
        decrease=locked(problem.by_resource("decrease").copy()),
        normalization=locked(problem.normalization.copy()),
        limit=locked(problem.limit.copy()),
        capacity=locked(problem.capacity.copy()),
        averaging=rule[0],
        compensation=rule[1],
        response=rule[2],
    )


def rule_parameters(
    n_agents: int,
    tick_weight: float,
    averaging: Averaging | None,
    compensation: Compensation | None,
    response: Response | None,
) -> tuple[AveragingParameters, CompensationParameters, ResponseParameters]:
    """Ask the parts of the rule for their parameters, and refuse what does not fit the agents."""
    return (
        _averaging_parameters(Cumulative() if averaging is None else averaging, tick_weight),
        _compensation_parameters(compensation, n_agents),
        _response_parameters(Randomised() if response is None else response, tick_weight),
    )


def own_parameters(parameters: AgentParameters) -> AgentParameters:
    """Give another run parameters as these are; those that no intervention changes are shared."""
    return parameters._replace(
        increase=locked(parameters.increase.copy()),
        decrease=locked(parameters.decrease.copy()),
        normalization=locked(parameters.normalization.copy()),
        limit=locked(parameters.limit.copy()),
        capacity=locked(parameters.capacity.copy()),
    )


def _given(part: Any, asked: float, form: type[_Form], face: str) -> tuple[str, _Form]:
    """Ask a part for its parameters, which must have their form; with the words for them."""
    field = returned_values.said_by(part, "parameters")
    allowed = f"{form.__name__}, see aimd_des.{face}"
    return field, returned_values.instance(field, part.parameters(asked), form, allowed)


def _averaging_parameters(averaging: Averaging, tick_weight: float) -> AveragingParameters:
    field, given = _given(averaging, tick_weight, AveragingParameters, "averaging")
    if given.kind not in (CUMULATIVE, WINDOW, FORGETTING, POLYNOMIAL):
        raise InputError.of(f"{field}.kind", given.kind, "CUMULATIVE, WINDOW, FORGETTING or POLYNOMIAL")
    for name in ("rate", "span", "part"):
        validation.number(f"{field}.{name}", getattr(given, name), low=0.0)
    validation.integer(f"{field}.parts", given.parts, low=0)
    validation.number(f"{field}.gain", given.gain, low=1.0)
    return given


def _response_parameters(response: Response, tick_weight: float) -> ResponseParameters:
    field, given = _given(response, tick_weight, ResponseParameters, "responses")
    validation.integer(f"{field}.cut", given.cut, low=DRAWN, high=FULL)
    validation.integer(f"{field}.divisor", given.divisor, low=AVERAGE, high=OWN)
    validation.integer(f"{field}.columns", given.columns, low=0)
    if given.divisor == OWN:
        returned_values.having(type(response).__name__, response, ["probability"])
    return given


def _compensation_parameters(compensation: Compensation | None, n_agents: int) -> CompensationParameters:
    if compensation is None:
        given = no_compensation(n_agents)
    else:
        field, given = _given(compensation, n_agents, CompensationParameters, "compensation")
        if given.rule not in (NOTHING, KNOWN, ESTIMATED):
            raise InputError.of(f"{field}.rule", given.rule, "NOTHING, KNOWN or ESTIMATED")
        validation.array(f"{field}.loss", given.loss, (n_agents,), low=0.0, high=1.0, high_open=True)
        validation.integer(f"{field}.period", given.period, low=0)
        validation.integer(f"{type(compensation).__name__}.bits", compensation.bits, low=0)
    return given._replace(loss=locked(each(given.loss, (n_agents,))))


def start(n_resources: int, n_agents: int, tick_weight: float, parameters: AgentParameters) -> State:
    """Give the state before anything has happened: no agent holds anything."""
    shape = (n_resources, n_agents)
    # Each by itself: what is not written to takes no memory, but a large array takes it in large pieces.
    counts = [np.zeros(shape, dtype=np.int64) for _ in range(6)]
    return State(
        demand=np.zeros(shape),
        accumulated=np.zeros(shape),
        anchor=np.full(shape, 0.0 - tick_weight),
        responses=counts[0],
        saturated=counts[1],
        origin=np.zeros(shape),
        pause=np.full(shape, np.inf),
        parts=np.zeros((*shape, parameters.averaging.parts)),
        heard=counts[2],
        first=counts[3],
        latest=counts[4],
        answered=counts[5],
        memory=np.zeros((*shape, memory_columns(parameters.response, parameters.averaging))),
    )
