r"""The agent's rule: how demand grows, what the average is, and how a capacity signal is answered.

Between two signals demand is a line, so nothing is stepped.  The state of an agent is kept at its
*anchor*, the last moment at which the line broke (a response, or a tick that held): the demand just
after it, and the demand accumulated up to it.  With c the moments since the anchor,

                 discrete, at tick k           continuous, at time t
    moment       k                             t
    demand       x + alpha * (c - 1)           x + alpha * c

and they differ in one number, the *tick weight*: 1 where a tick folds in a whole demand before it acts
(eq. (average_eqn) of the paper), 0 where the average is an integral.  A signal is answered with
probability lambda = Gamma * grad_j f(average) / average^j, eq. (prob_x).  The formulas below are
the rule, written once: kernels compile them, processes call them as they stand.
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
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray

__all__ = [
    "CONTINUOUS",
    "DISCRETE",
    "answer_row",
    "average_row",
    "demand_at",
    "response_probability",
]

#: The tick weight: what the moment at hand itself counts for in the average.
DISCRETE, CONTINUOUS = 1.0, 0.0


@formula
def demand_at(demand: float, increase: float, since: float, tick_weight: float) -> float:
    """Return the demand after growth."""
    return demand + increase * (since - tick_weight)


@formula
def response_probability(normalization: float, gradient: float, average: float) -> float:
    """Return lambda of eq. (prob_x), not cut off at 1.

    Parameters
    ----------
    normalization : float
        Gamma.
    gradient : float
        Derivative of the private cost at the averages.
    average : float
        The average; at 0 the agent has nothing to give back and lambda is 0.

    Returns
    -------
    float
        At least 0.
    """
    return normalization * gradient / average if average > 0.0 else 0.0


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
            folded[i] = folded_at(averaging, kept, held, alpha, since, tick_weight)
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
    for i in range(demand.shape[0]):
        present = demand_at(demand[i], increase[i], moment - anchor[i], tick_weight)
        probability = response_probability(normalization, gradient[i], average[i])
        decreases = uniform[i] < probability
        demand[i] = present * decrease[i] if decreases else present
        accumulated[i] = folded[i]
        anchor[i] = moment
        responses[i] += decreases
        saturated[i] += probability > 1.0
