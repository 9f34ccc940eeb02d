r"""The agent's rule: how demand grows, what the average is, and how a capacity signal is answered.

Between two signals demand is a line, so nothing is stepped.  The state of an agent is kept at its
*anchor*, the last moment at which the line broke (a response, or a tick that held): the demand just
after it, and the demand accumulated up to it.  With c the moments since the anchor,

                 discrete, at tick k           continuous, at time t
    moment       k                             t
    demand       x + alpha * (c - 1)           x + alpha * c
    accumulated  s + c*x + alpha*c*(c-1)/2     s + c*x + alpha*c*c/2
    average      accumulated / (k + 1)         accumulated / t

and they differ in one number, the *grain*: 1 where a tick folds in a whole demand before it acts
(eq. (average_eqn) of the paper), 0 where the average is an integral.  A signal is answered with
probability lambda = Gamma * grad_j f(average) / average^j, eq. (prob_x).  The formulas below are
the rule, written once: kernels compile them, processes call them as they stand.
"""

import numpy as np
import numpy.typing as npt

from aimd_des.checks import FloatArray
from aimd_des.compiled import formula, kernel

__all__ = [
    "CONTINUOUS",
    "DISCRETE",
    "accumulated_at",
    "answer_row",
    "average_row",
    "demand_at",
    "response_probability",
    "time_average",
]

IntArray = npt.NDArray[np.int64]

#: The grain of time: what the moment at hand itself counts for in the average.
DISCRETE, CONTINUOUS = 1.0, 0.0


@formula
def demand_at(demand: float, increase: float, since: float, grain: float) -> float:
    """Return the demand after growth.

    Parameters
    ----------
    demand : float
        Demand just after the anchor, in units of the resource.
    increase : float
        alpha.
    since : float
        Moments since the anchor.
    grain : float
        Grain of time.

    Returns
    -------
    float
        In units of the resource.
    """
    return demand + increase * (since - grain)


@formula
def accumulated_at(accumulated: float, demand: float, increase: float, since: float, grain: float) -> float:
    """Return the demand accumulated so far: a sum over ticks, or an integral over time.

    Parameters
    ----------
    accumulated, demand : float
        At the anchor.
    increase : float
        alpha.
    since : float
        Moments since the anchor.
    grain : float
        Grain of time.

    Returns
    -------
    float
        In units of the resource, times ticks or time.
    """
    return accumulated + (since * demand + increase * (0.5 * since * (since - grain)))


@formula
def time_average(accumulated: float, moment: float, grain: float) -> float:
    """Return the long-term average, 0 where no time has passed.

    Parameters
    ----------
    accumulated : float
        Demand accumulated from moment 0 on.
    moment : float
        The moment at hand.
    grain : float
        Grain of time.

    Returns
    -------
    float
        In units of the resource.
    """
    passed = moment + grain
    return accumulated / passed if passed > 0.0 else 0.0


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
    demand: FloatArray,
    accumulated: FloatArray,
    anchor: FloatArray,
    increase: FloatArray,
    moment: float,
    grain: float,
    folded: FloatArray,
    average: FloatArray,
) -> None:
    """Compute the averages that all agents have at one moment.

    Parameters
    ----------
    demand, accumulated, anchor : ndarray, shape (n,)
        State for one resource.
    increase : ndarray, shape (n,)
        alpha.
    moment : float
        The moment at hand, common to all.
    grain : float
        Grain of time.
    folded, average : ndarray, shape (n,)
        Receive the demand accumulated up to this moment, and the average.
    """
    for i in range(demand.shape[0]):
        folded[i] = accumulated_at(accumulated[i], demand[i], increase[i], moment - anchor[i], grain)
        average[i] = time_average(folded[i], moment, grain)


@kernel
def answer_row(
    demand: FloatArray,
    accumulated: FloatArray,
    anchor: FloatArray,
    responses: IntArray,
    saturated: IntArray,
    increase: FloatArray,
    decrease: FloatArray,
    normalization: float,
    folded: FloatArray,
    average: FloatArray,
    gradient: FloatArray,
    uniform: FloatArray,
    moment: float,
    grain: float,
) -> None:
    """Let all agents answer one capacity signal at the same moment.

    Parameters
    ----------
    demand, accumulated, anchor : ndarray, shape (n,)
        State for the signal's resource; moved to this moment.
    responses, saturated : ndarray of int, shape (n,)
        Counts of decreases, and of those that had lambda > 1.
    increase, decrease : ndarray, shape (n,)
        alpha and beta.
    normalization : float
        Gamma.
    folded, average, gradient : ndarray, shape (n,)
        Demand accumulated up to this moment, averages, and derivatives of the costs there.
    uniform : ndarray, shape (n,)
        The draw of each agent for this broadcast.
    moment : float
        The moment at hand.
    grain : float
        Grain of time.
    """
    for i in range(demand.shape[0]):
        present = demand_at(demand[i], increase[i], moment - anchor[i], grain)
        probability = response_probability(normalization, gradient[i], average[i])
        decreases = uniform[i] < probability
        demand[i] = present * decrease[i] if decreases else present
        accumulated[i] = folded[i]
        anchor[i] = moment
        responses[i] += decreases
        saturated[i] += probability > 1.0
