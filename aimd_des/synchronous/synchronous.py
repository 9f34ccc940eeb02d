"""Algorithms 1 and 2 of the paper, synchronous and with a perfect channel.

At step k every agent acts on S(k) and its average over x(0)..x(k); the control unit looks at x(k)
and sets S(k+1).  With ``lag=0`` the signal set from x(k) is used at k itself.
"""

import numpy as np

from aimd_des.dynamics.averaging import Averaging
from aimd_des.dynamics.custom_response import check_returned, with_address
from aimd_des.dynamics.demand import DISCRETE
from aimd_des.dynamics.responses import Response
from aimd_des.dynamics.state import AgentParameters, State, agent_parameters, start
from aimd_des.problem.costs import CostTable, cost_table
from aimd_des.problem.problem import Problem
from aimd_des.results.metrics import Stretch, overshoot_of
from aimd_des.results.overload import Opportunities
from aimd_des.results.recording import Recording
from aimd_des.results.result import Result
from aimd_des.results.run_data import Account, Observations, Signals
from aimd_des.synchronous.answers import AHEAD, StepBuffers
from aimd_des.synchronous.kernels import RecordBuffers, StepControl, take_custom_steps, take_steps
from aimd_des.utils import limits, rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import locked
from aimd_des.utils.rng import FOUR, Purpose
from aimd_des.utils.validation import FloatArray

# Demands that are added up, about, before Python is asked whether Ctrl-C was pressed: a tenth of a second.
_IN_ONE_GO = 3 * 10**7

# Rows are filled up to a multiple of this many agents: four vectors of four numbers, or two of eight.
_PASS = 16


def run_synchronous(
    problem: Problem,
    *,
    steps: int,
    seed: int,
    lag: int = 1,
    averaging: Averaging | None = None,
    response: Response | None = None,
    recording: Recording | None = None,
) -> Result:
    """Run the synchronous algorithm of the paper (Algorithms 1 and 2) from x(0) = 0.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many, at what cost.
    steps : int
        K >= 1; the run ends in x(K), after K looks of the control unit.
    seed : int
        At least 0; decides which agents respond to which signal.
    lag : {1, 0}
        1: a signal acts one step after the excess that it reports, as the algorithms are
        printed; 0: in the same step.
    averaging : Averaging, optional
        How agents average their demand: over all of their past unless given.
    response : Response, optional
        How agents answer signals: by the paper's rule unless given.
    recording : Recording, optional
        What to keep besides signals and end; totals at a thousand steps unless given.

    Returns
    -------
    Result
        With times in steps.

    Warns
    -----
    RuntimeWarning
        Once, if a response probability was above 1.
    OverloadWarning
        Once, if demand has run away from the capacity.
    """
    validation.instance("problem", problem, Problem, "a Problem")
    steps = check_steps("steps", steps, problem)
    lag = validation.integer("lag", lag, low=0, high=1)
    key = rng.key(seed, Purpose.RESPONSE)
    recording = Recording() if recording is None else recording
    validation.instance("recording", recording, Recording, "a Recording, such as Recording(demand='end')")
    # Refused, not ignored: who asks for a log and gets none would look for it in the result.
    if recording.events:
        raise InputError.of("recording.events", True, "False: the synchronous algorithm has no events")
    n, m = problem.n_agents, problem.n_resources
    table, parameters = cost_table(problem.costs), _parameters(problem, averaging, response)
    answering = with_address(response, parameters.response)
    parameters = parameters._replace(response=answering)
    state = start(m, parameters.increase.shape[1], DISCRETE, parameters)
    control = StepControl(
        signal=np.zeros(m, dtype=np.bool_),
        answered=np.zeros(m, dtype=np.int64),
        broadcast=np.zeros((steps, m), dtype=np.bool_),
        peak=np.zeros(m),
        above=np.zeros(m),
        excess=np.zeros(m),
        used=np.zeros(m),
        middle=np.array([0.5 * steps]),
        half=np.zeros(m),
    )
    records, buffers = _open_records(recording, steps, n, m), _step_buffers(state, n)
    # Empty where the costs have no formula that compiled code knows.
    if table.n_agents:
        table = _filled_table(table, n)
        block = max(1, _IN_ONE_GO // (n * m))
        for first in range(0, steps, block):
            last = min(first + block, steps)
            take_steps(state, parameters, table, first, last, lag, key, control, records, buffers)
    else:
        take_custom_steps(problem.costs, state, parameters, steps, lag, key, control, records, buffers)
    check_returned(response, answering)
    signals, observations, account = _outcome(problem, steps, state, control, records)
    # The looks at K / 2 or later, as the load that they are held against is that of the second half.
    looks = Opportunities(float(steps - (steps + 1) // 2), 1.0)
    return Result(
        problem, "discrete", seed, float(steps), signals, observations, account, opportunities=looks
    )


def check_steps(field: str, steps: object, problem: Problem) -> int:
    """Refuse a number of steps that is none, or whose signals have no room."""
    clean = validation.integer(field, steps, low=1)
    limits.memory(field, clean, clean * problem.n_resources, "a byte for each step and resource")
    return clean


def _parameters(problem: Problem, averaging: Averaging | None, response: Response | None) -> AgentParameters:
    """Lay out the parameters of the agents."""
    if averaging is not None:
        allowed = "an averaging, such as averaging.Window(100.0)"
        validation.instance("averaging", averaging, Averaging, allowed)
    if response is not None:
        validation.instance("response", response, Response, "a response, such as responses.Derandomised()")
    parameters = agent_parameters(problem, DISCRETE, averaging, response=response)
    return parameters._replace(
        increase=locked(_filled(parameters.increase, 0.0)), decrease=locked(_filled(parameters.decrease, 1.0))
    )


def _filled(rows: FloatArray, filler: float) -> FloatArray:
    """Fill rows up to whole passes along agents."""
    n = rows.shape[-1]
    filled = np.full((*rows.shape[:-1], n + -n % _PASS), filler)
    filled[..., :n] = rows
    return filled


def _filled_table(table: CostTable, n: int) -> CostTable:
    """Fill derivatives up with agents that have none."""
    return CostTable(*(_filled(part, 0.0) if part.shape[-1] == n else part for part in table))


def _step_buffers(state: State, n: int) -> StepBuffers:
    m, width = state.demand.shape
    folded, average, gradient = np.zeros((3, m, width))
    uniform = np.zeros(width)
    draws, totals = uniform[: n + -n % FOUR], np.zeros(AHEAD)
    acting = np.zeros(m, dtype=np.bool_)
    return StepBuffers(folded, average, gradient, uniform, np.zeros((2, width)), draws, totals, acting)


def _open_records(recording: Recording, steps: int, n: int, m: int) -> RecordBuffers:
    rows = recording.times("demand", steps, whole=True)
    pages = recording.times("allocations", steps, whole=True)
    return RecordBuffers(
        demand_steps=rows,
        total_demand=np.zeros((len(rows), m)),
        total_average=np.zeros((len(rows), m)),
        allocation_steps=pages,
        demand=np.zeros((len(pages), m, n)),
        average=np.zeros((len(pages), m, n)),
        # Both end at K, so there is a next step until both are done.
        cursor=np.array([[0, 0, min(rows[0], pages[0])]] * m, dtype=np.int64),
    )


def _outcome(
    problem: Problem, steps: int, state: State, control: StepControl, records: RecordBuffers
) -> tuple[Signals, Observations, Account]:
    step, resource = np.nonzero(control.broadcast)
    # Sorted by step, and then by resource: the order in which an asynchronous run sends them.
    number = np.empty_like(step)
    for j in range(problem.n_resources):
        own = resource == j
        number[own] = np.arange(np.count_nonzero(own))
    signals = Signals(step.astype(np.float64), resource, number)
    sent = signals.counts(problem.n_resources)
    measures = (control.peak, control.above, control.excess, control.used)
    stretches = (Stretch(0.0, float(steps), problem.capacity, *measures),)
    observations = Observations(
        records.demand_steps,
        records.total_demand,
        records.total_average,
        records.allocation_steps,
        records.demand,
        records.average,
        overshoot_of(stretches),
        (control.used - control.half) / (0.5 * steps) / problem.capacity,
        stretches,
    )
    # There is no channel: every copy of every signal reaches its agent.
    n = problem.n_agents
    nothing = np.zeros((problem.n_resources, n), dtype=np.int64)
    account = Account(
        delivered=nothing + sent[:, None],
        lost=nothing,
        in_flight=nothing,
        duplicated=nothing,
        responses=state.responses[:, :n].copy(),
        saturated=state.saturated[:, :n].copy(),
    )
    return signals, observations, account
