r"""The agent's rule: how demand grows, what the average is, and how a capacity signal is answered.

Between two signals demand is a line, so nothing is stepped.  The state of an agent is kept at its
*anchor*, the last moment at which the line broke (a response, or a tick that held): the demand just
after it, and the demand accumulated up to it.  With c the moments since the anchor,

                 discrete, at tick k           continuous, at time t
    moment       k                             t
    demand       x + alpha * (c - 1)           x + alpha * c

and they differ in one number, the *tick weight*: 1 where a tick folds in a whole demand before it acts
(eq. (average_eqn) of the paper), 0 where the average is an integral.  A signal is answered with
probability lambda = Gamma * grad_j f(average) / average^j, eq. (prob_x), or as another of
`responses` has it.  The formulas are the rule, written once: kernels compile them, processes call them.
"""

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
from aimd_des.dynamics.responses import (
    AVERAGE,
    DRAWN,
    cut_factor,
    is_saturated,
    probability_of,
    response_probability,
)
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray

#: The tick weight: what the moment at hand itself counts for in the average.
DISCRETE, CONTINUOUS = 1.0, 0.0


@formula
def demand_at(demand: float, increase: float, since: float, tick_weight: float) -> float:
    """Return the demand after growth."""
    return demand + increase * (since - tick_weight)


@kernel
def average_row(
    state: State,
    parameters: AgentParameters,
    resource: int,
    moment: float,
    tick_weight: float,
    folded: FloatArray,
    average: FloatArray,
) -> None:
    """Compute the averages that all agents have at one moment."""
    j, averaging = resource, parameters.averaging
    demand, accumulated, anchor = state.demand[j], state.accumulated[j], state.anchor[j]
    increase, origin = parameters.increase[j], state.origin[j]
    if averaging.kind == CUMULATIVE:  # on its own, so that it is computed for several agents at once
        for i in range(demand.shape[0]):
            since = moment - anchor[i]
            folded[i] = accumulated_at(accumulated[i], demand[i], increase[i], since, tick_weight)
            average[i] = time_average(folded[i], age_at(moment, origin[i], tick_weight))
    else:
        for i in range(demand.shape[0]):
            held, kept, alpha, since = demand[i], accumulated[i], increase[i], moment - anchor[i]
            before = age_at(anchor[i], origin[i], tick_weight)
            folded[i] = folded_at(averaging, kept, held, alpha, since, before, tick_weight)
            line = (folded[i], kept, held, alpha, anchor[i], origin[i])
            average[i] = average_at(averaging, state.parts, j, i, *line, moment, tick_weight)


@kernel
def answer_row(
    state: State,
    parameters: AgentParameters,
    resource: int,
    folded: FloatArray,
    average: FloatArray,
    gradient: FloatArray,
    uniform: FloatArray,
    moment: float,
    tick_weight: float,
) -> None:
    """Let all agents answer one capacity signal at the same moment."""
    j, averaging, normalization = resource, parameters.averaging, parameters.normalization[resource]
    demand, accumulated, anchor = state.demand[j], state.accumulated[j], state.anchor[j]
    increase, decrease, origin = parameters.increase[j], parameters.decrease[j], state.origin[j]
    responses, saturated = state.responses[j], state.saturated[j]
    if averaging.kind == WINDOW:
        for i in range(demand.shape[0]):
            line = (accumulated[i], demand[i], increase[i], anchor[i], origin[i])
            keep_parts(averaging, state.parts, j, i, *line, moment, tick_weight)
    # The factor takes the place of the derivative, which nothing reads any more.
    factor, response = gradient, parameters.response
    if response.cut == DRAWN and response.divisor == AVERAGE:  # on its own, as in `average_row`
        for i in range(demand.shape[0]):
            probability = response_probability(normalization, gradient[i], average[i])
            saturated[i] += probability > 1.0
            factor[i] = decrease[i] if uniform[i] < probability else 1.0
    else:
        for i in range(demand.shape[0]):
            present = demand_at(demand[i], increase[i], moment - anchor[i], tick_weight)
            found = (normalization, gradient[i], average[i], present, increase[i], decrease[i])
            age = age_at(moment, origin[i], tick_weight)
            probability = probability_of(response, averaging, state.memory, j, i, *found, age)
            saturated[i] += is_saturated(response, probability, decrease[i])
            cut = (probability, uniform[i], present, decrease[i])
            factor[i] = cut_factor(response, averaging, state.memory, j, i, *cut)
    for i in range(demand.shape[0]):
        present = demand_at(demand[i], increase[i], moment - anchor[i], tick_weight)
        demand[i] = present * factor[i]
        accumulated[i] = folded[i]
        anchor[i] = moment
        responses[i] += factor[i] < 1.0
