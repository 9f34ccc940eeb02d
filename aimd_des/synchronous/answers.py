"""What all agents do about one resource at one step: averages, totals, draws and answers, in passes.

No agent is away and all answer at once, so the lines of all agents begin at the same step: they all have the
anchor and the origin of agent 0.  Rows are filled up, behind the n agents, to whole passes of vector
instructions, with agents that hold nothing, ask for nothing and never respond.
"""

from typing import Any, NamedTuple

from aimd_des.dynamics.averaging import (
    CUMULATIVE,
    WINDOW,
    accumulated_at,
    age_at,
    average_at,
    folded_at,
    keep_parts,
    time_average,
)
from aimd_des.dynamics.demand import DISCRETE, demand_at
from aimd_des.dynamics.responses import (
    AVERAGE,
    DRAWN,
    cut_factor,
    is_saturated,
    probability_of,
    response_probability,
)
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.utils.jit import deferred, formula, routine
from aimd_des.utils.records import record
from aimd_des.utils.rng import FOUR, Key, four_uniforms
from aimd_des.utils.validation import BoolArray, FloatArray

#: How many totals are added up side by side: most signals come within so many steps after an answer.
AHEAD = 4


@record
class StepBuffers(NamedTuple):
    """Working memory, so that nothing is allocated per step; rows of all agents, but for the last three."""

    folded: FloatArray
    average: FloatArray
    gradient: FloatArray
    uniform: FloatArray
    spare: FloatArray
    draws: FloatArray  # the beginning of `uniform`: the n agents, filled up to whole blocks of draws
    totals: FloatArray  # of the steps ahead
    acting: BoolArray  # for which resources agents answer a signal at the step at hand


@formula
def _add(totals: Any, demand: float, increase: float, since: float) -> Any:
    """Add one agent's demand at a step, and at the next ones if no agent responds, to the totals of these."""
    return (
        totals[0] + demand_at(demand, increase, since, DISCRETE),
        totals[1] + demand_at(demand, increase, since + 1.0, DISCRETE),
        totals[2] + demand_at(demand, increase, since + 2.0, DISCRETE),
        totals[3] + demand_at(demand, increase, since + 3.0, DISCRETE),
    )


@routine
def add_ahead(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Add up demand, in the order of agents, at this step and the next ones, if no agent responds."""
    # Each addition waits for the one before it, so several sums side by side take little longer than one.
    demand, increase = state.demand[resource], parameters.increase[resource]
    since, totals = step - state.anchor[resource, 0], (0.0, 0.0, 0.0, 0.0)
    for i in range(buffers.draws.shape[0]):
        totals = _add(totals, demand[i], increase[i], since)
    for ahead in range(AHEAD):
        buffers.totals[ahead] = totals[ahead]


@formula
def draw_and_add(
    state: State,
    parameters: AgentParameters,
    resource: int,
    step: int,
    key: Key,
    number: int,
    buffers: StepBuffers,
) -> None:
    """Draw what decides the next answers, and add up demand as `add_ahead` does."""
    # A draw is a chain of products, and a total one of sums: the one hides behind the other.
    demand, increase, draws = state.demand[resource], parameters.increase[resource], buffers.draws
    since, totals = step - state.anchor[resource, 0], (0.0, 0.0, 0.0, 0.0)
    for block in range(draws.shape[0] // FOUR):
        i = FOUR * block
        draws[i], draws[i + 1], draws[i + 2], draws[i + 3] = four_uniforms(key, resource, number, 0, block)
        totals = _add(totals, demand[i], increase[i], since)
        totals = _add(totals, demand[i + 1], increase[i + 1], since)
        totals = _add(totals, demand[i + 2], increase[i + 2], since)
        totals = _add(totals, demand[i + 3], increase[i + 3], since)
    for ahead in range(AHEAD):
        buffers.totals[ahead] = totals[ahead]


@deferred
def _average_otherwise(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Compute the same for averages other than over all of the past, agent by agent."""
    j, averaging, moment = resource, parameters.averaging, float(step)
    anchor, origin = state.anchor[j, 0], state.origin[j, 0]
    since, before = moment - anchor, age_at(anchor, origin, DISCRETE)
    for i in range(buffers.folded.shape[1]):
        held, kept, alpha = state.demand[j, i], state.accumulated[j, i], parameters.increase[j, i]
        folded = folded_at(averaging, kept, held, alpha, since, before, DISCRETE)
        line = (folded, kept, held, alpha, anchor, origin)
        buffers.folded[j, i] = folded
        buffers.average[j, i] = average_at(averaging, state.parts, j, i, *line, moment, DISCRETE)


@routine
def average_row(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Compute what all agents have accumulated of one resource, and their averages, at one step."""
    j, averaging, moment = resource, parameters.averaging, float(step)
    folded, average = buffers.folded[j], buffers.average[j]
    demand, accumulated, increase = state.demand[j], state.accumulated[j], parameters.increase[j]
    anchor, origin = state.anchor[j, 0], state.origin[j, 0]
    since, age = moment - anchor, age_at(moment, origin, DISCRETE)
    if averaging.kind == CUMULATIVE:  # on its own, so that it is computed for several agents at once
        for i in range(demand.shape[0]):
            folded[i] = accumulated_at(accumulated[i], demand[i], increase[i], since, DISCRETE)
            average[i] = time_average(folded[i], age)
    else:
        _average_otherwise(state, parameters, j, step, buffers)


@formula
def _draw_factors(parameters: AgentParameters, resource: int, saturated: Any, buffers: StepBuffers) -> None:
    """Compute what demand is multiplied by with the paper's rule, in passes along the agents."""
    # The probability takes the place of the derivative, and the factor that of the probability.  Loops are so
    # small that LLVM can see to it that their arrays do not overlap.
    factor, average, uniform = buffers.gradient[resource], buffers.average[resource], buffers.uniform
    normalization, decrease = parameters.normalization[resource], parameters.decrease[resource]
    above = 0
    for i in range(factor.shape[0]):
        probability = response_probability(normalization, factor[i], average[i])
        above += probability > 1.0
        factor[i] = probability
    if above > 0:
        for i in range(factor.shape[0]):
            saturated[i] += factor[i] > 1.0
    for i in range(factor.shape[0]):
        factor[i] = decrease[i] if uniform[i] < factor[i] else 1.0


@deferred
def _find_factors(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Compute what demand is multiplied by with any rule, agent by agent."""
    j, averaging, response = resource, parameters.averaging, parameters.response
    factor, average, normalization = buffers.gradient[j], buffers.average[j], parameters.normalization[j]
    since, age = step - state.anchor[j, 0], age_at(float(step), state.origin[j, 0], DISCRETE)
    for i in range(factor.shape[0]):
        increase, decrease = parameters.increase[j, i], parameters.decrease[j, i]
        present = demand_at(state.demand[j, i], increase, since, DISCRETE)
        found = (normalization, factor[i], average[i], present, increase, decrease)
        probability = probability_of(response, averaging, state.memory, j, i, *found, age)
        state.saturated[j, i] += is_saturated(response, probability, decrease)
        cut = (probability, buffers.uniform[i], present, decrease)
        factor[i] = cut_factor(response, averaging, state.memory, j, i, *cut)


@deferred
def _keep_window(state: State, parameters: AgentParameters, resource: int, step: int) -> None:
    """Keep what averages over a window will forget."""
    j = resource
    for i in range(state.demand.shape[1]):
        line = (state.accumulated[j, i], state.demand[j, i], parameters.increase[j, i], state.anchor[j, i])
        keep_parts(parameters.averaging, state.parts, j, i, *line, state.origin[j, i], float(step), DISCRETE)


@routine
def answer_row(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Let all agents answer one signal; their averages, derivatives and draws are in the buffers."""
    j, averaging, response = resource, parameters.averaging, parameters.response
    demand, accumulated, increase = state.demand[j], state.accumulated[j], parameters.increase[j]
    anchor, responses, factor, folded = (
        state.anchor[j],
        state.responses[j],
        buffers.gradient[j],
        buffers.folded[j],
    )
    since = step - anchor[0]
    if averaging.kind == WINDOW:
        _keep_window(state, parameters, j, step)
    if response.cut == DRAWN and response.divisor == AVERAGE:
        _draw_factors(parameters, j, state.saturated[j], buffers)
    else:
        _find_factors(state, parameters, j, step, buffers)
    for i in range(demand.shape[0]):
        demand[i] = demand_at(demand[i], increase[i], since, DISCRETE) * factor[i]
    for i in range(demand.shape[0]):
        accumulated[i] = folded[i]
    for i in range(demand.shape[0]):
        anchor[i] = step
    for i in range(demand.shape[0]):
        responses[i] += factor[i] < 1.0
