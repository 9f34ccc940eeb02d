"""What all agents do about one resource at one step: averages, totals, draws and answers, in passes.

No agent is away and all answer at once, so the lines of all agents begin at the same step: they all have the
anchor and the origin of agent 0, and steps keep the anchor of that one alone.  Rows are filled up, behind the
n agents, to whole passes of vector instructions, with agents that hold nothing, ask for nothing and never
respond.
"""

from typing import Any, NamedTuple

from aimd_des.dynamics.averaging import (
    CUMULATIVE,
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
from aimd_des.utils.jit import deferred, formula, routine, row_formula
from aimd_des.utils.lanes import four_lanes, lanes_of
from aimd_des.utils.records import record
from aimd_des.utils.rng import FOUR, Key, WordArray, four_words, uniform_of
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray

#: How many totals are added up side by side: most signals come within so many steps after an answer.
AHEAD = 4


@record
class StepBuffers(NamedTuple):
    """Working memory, so that nothing is allocated per step; rows of all agents, but for the last three."""

    folded: FloatArray  # what is accumulated; unused where that is over all of the past
    average: FloatArray
    gradient: FloatArray
    words: WordArray  # random bits, a word for each agent
    spare: FloatArray
    draws: WordArray  # the beginning of `words`: the n agents, filled up to whole blocks of draws
    totals: FloatArray  # of the steps ahead
    acting: BoolArray  # for which resources agents answer a signal at the step at hand


@formula
def _since(state: State, resource: int, step: int) -> Any:
    """Return how long the anchor is past at a step and at the next three."""
    since = float(step - state.anchor[resource, 0])
    return four_lanes(since, since + 1.0, since + 2.0, since + 3.0)


@formula
def _keep(totals: Any, buffers: StepBuffers) -> None:
    """Keep the totals of the steps ahead."""
    one, two, three, four = lanes_of(totals)
    buffers.totals[0], buffers.totals[1], buffers.totals[2], buffers.totals[3] = one, two, three, four


@routine
def add_ahead(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Add up demand, in the order of agents, at this step and the next ones, if no agent responds."""
    # Each addition waits for the one before it, so four sums side by side take no longer than one.
    demand, increase = state.demand[resource], parameters.increase[resource]
    since, totals = _since(state, resource, step), four_lanes(0.0, 0.0, 0.0, 0.0)
    for i in range(buffers.draws.shape[0]):
        totals = totals + demand_at(demand[i], increase[i], since, DISCRETE)
    _keep(totals, buffers)


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
    # A draw is a chain of products, and a total one of sums: the one hides behind the other.  Words are made
    # to numbers later, since vectors are converted at once.
    demand, increase, words = state.demand[resource], parameters.increase[resource], buffers.draws
    since, totals = _since(state, resource, step), four_lanes(0.0, 0.0, 0.0, 0.0)
    for block in range(words.shape[0] // FOUR):
        i = FOUR * block
        words[i], words[i + 1], words[i + 2], words[i + 3] = four_words(key, resource, number, 0, block)
        totals = totals + demand_at(demand[i], increase[i], since, DISCRETE)
        totals = totals + demand_at(demand[i + 1], increase[i + 1], since, DISCRETE)
        totals = totals + demand_at(demand[i + 2], increase[i + 2], since, DISCRETE)
        totals = totals + demand_at(demand[i + 3], increase[i + 3], since, DISCRETE)
    _keep(totals, buffers)


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
    """Compute the averages of all agents of one resource at one step."""
    j, averaging, moment = resource, parameters.averaging, float(step)
    demand, accumulated, increase = state.demand[j], state.accumulated[j], parameters.increase[j]
    average, anchor, origin = buffers.average[j], state.anchor[j, 0], state.origin[j, 0]
    since, age = moment - anchor, age_at(moment, origin, DISCRETE)
    if averaging.kind == CUMULATIVE:  # on its own, so that it is computed for several agents at once
        for i in range(demand.shape[0]):
            folded = accumulated_at(accumulated[i], demand[i], increase[i], since, DISCRETE)
            average[i] = time_average(folded, age)
    else:
        _average_otherwise(state, parameters, j, step, buffers)


@row_formula
def _answer_as_drawn(
    demand: FloatArray,
    accumulated: FloatArray,
    responses: IntArray,
    increase: FloatArray,
    decrease: FloatArray,
    average: FloatArray,
    gradient: FloatArray,
    words: WordArray,
    normalization: float,
    since: float,
) -> int:
    """Let all agents answer by the paper's rule, and return how many have a probability above 1."""
    # In one pass, since all else hides behind the division.  What is accumulated is computed once more: that
    # takes less than to store it with the average and to load it here.
    above = 0
    for i in range(demand.shape[0]):
        accumulated[i] = accumulated_at(accumulated[i], demand[i], increase[i], since, DISCRETE)
        probability = response_probability(normalization, gradient[i], average[i])
        factor, responds = decrease[i], uniform_of(words[i]) < probability
        demand[i] = demand_at(demand[i], increase[i], since, DISCRETE) * (factor if responds else 1.0)
        responses[i] += responds
        above += probability > 1.0
    return above


@row_formula
def _count_saturated(
    saturated: IntArray, average: FloatArray, gradient: FloatArray, normalization: float
) -> None:
    """Count the answers of agents whose probability is above 1."""
    for i in range(saturated.shape[0]):
        saturated[i] += response_probability(normalization, gradient[i], average[i]) > 1.0


@deferred
def _answer_otherwise(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Let all agents answer by any rule and with any average, agent by agent."""
    j, averaging, response = resource, parameters.averaging, parameters.response
    normalization, anchor, origin = parameters.normalization[j], state.anchor[j, 0], state.origin[j, 0]
    since, age = step - anchor, age_at(float(step), origin, DISCRETE)
    for i in range(state.demand.shape[1]):
        held, kept, increase = state.demand[j, i], state.accumulated[j, i], parameters.increase[j, i]
        keep_parts(averaging, state.parts, j, i, kept, held, increase, anchor, origin, float(step), DISCRETE)
        present, decrease = demand_at(held, increase, since, DISCRETE), parameters.decrease[j, i]
        found = (normalization, buffers.gradient[j, i], buffers.average[j, i], present, increase, decrease)
        probability = probability_of(response, averaging, state.memory, j, i, *found, age)
        state.saturated[j, i] += is_saturated(response, probability, decrease)
        cut = (probability, uniform_of(buffers.words[i]), present, decrease)
        factor = cut_factor(response, averaging, state.memory, j, i, *cut)
        state.demand[j, i] = present * factor
        state.responses[j, i] += factor < 1.0
        if averaging.kind == CUMULATIVE:
            state.accumulated[j, i] = accumulated_at(kept, held, increase, since, DISCRETE)
        else:
            state.accumulated[j, i] = buffers.folded[j, i]


@routine
def answer_row(
    state: State, parameters: AgentParameters, resource: int, step: int, buffers: StepBuffers
) -> None:
    """Let all agents answer one signal; their averages, derivatives and draws are in the buffers."""
    j, averaging, response = resource, parameters.averaging, parameters.response
    if averaging.kind == CUMULATIVE and response.cut == DRAWN and response.divisor == AVERAGE:
        average, gradient, normalization = (
            buffers.average[j],
            buffers.gradient[j],
            parameters.normalization[j],
        )
        above = _answer_as_drawn(
            state.demand[j],
            state.accumulated[j],
            state.responses[j],
            parameters.increase[j],
            parameters.decrease[j],
            average,
            gradient,
            buffers.words,
            normalization,
            float(step - state.anchor[j, 0]),
        )
        if above > 0:
            _count_saturated(state.saturated[j], average, gradient, normalization)
    else:
        _answer_otherwise(state, parameters, j, step, buffers)
    state.anchor[j, 0] = step
