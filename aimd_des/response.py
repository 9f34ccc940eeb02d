r"""The agent's rule: how demand grows, what the average is, and how a capacity signal is answered.

Between two signals demand is a line, so nothing is stepped.  The state of an agent is kept at its
*anchor*, the last tick at which it answered a signal: the demand just after that tick, and the
demand accumulated over all ticks up to and including it.  At tick k, c ticks after the anchor,

    demand       x(k)           = x + alpha * (c - 1)
    accumulated  x(0)+...+x(k)  = s + c * x + alpha * c * (c - 1) / 2
    average      x-bar(k)       = accumulated / (k + 1)                   eq. (average_eqn)
    probability  lambda(k)      = Gamma * grad_j f(x-bar(k)) / x-bar^j(k)   eq. (prob_x)

of the paper.  The scalar formulas below are the rule; kernels compile them, processes call them.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.checks import FloatArray
from aimd_des.compiled import formula, kernel
from aimd_des.costs import Costs, CoupledCosts, PolynomialCosts

__all__ = [
    "CostTable",
    "accumulated_over_ticks",
    "answer_row",
    "answered",
    "cost_table",
    "gradient_row",
    "grown",
    "marginal_cost",
    "response_probability",
    "tick_averages",
]

IntArray = npt.NDArray[np.int64]


@formula
def grown(demand: float, increase: float, steps: float) -> float:
    """Return the demand after `steps` of additive increase, in units of the resource."""
    return demand + increase * steps


@formula
def accumulated_over_ticks(accumulated: float, demand: float, increase: float, ticks: float) -> float:
    """Add what `ticks` ticks fold in, the first of them at `demand`, each next one `increase` higher."""
    return accumulated + (ticks * demand + increase * (0.5 * ticks * (ticks - 1.0)))


@formula
def response_probability(normalization: float, gradient: float, average: float) -> float:
    """Return lambda of eq. (prob_x), not cut off at 1; an agent whose average is 0 has nothing to give back."""
    return normalization * gradient / average if average > 0.0 else 0.0


@formula
def answered(
    demand: float,
    accumulated: float,
    ticks: float,
    increase: float,
    decrease: float,
    normalization: float,
    gradient: float,
    average: float,
    uniform: float,
) -> tuple[float, float, bool, bool]:
    """Answer a capacity signal `ticks` ticks after the anchor: Algorithm 2, the branch S = 1.

    Returns the demand and the accumulated demand at the new anchor, whether the demand was
    decreased, and whether the response probability was above 1.
    """
    present = grown(demand, increase, ticks - 1.0)
    probability = response_probability(normalization, gradient, average)
    decreases = uniform < probability
    folded = accumulated_over_ticks(accumulated, demand, increase, ticks)
    return (present * decrease if decreases else present), folded, decreases, probability > 1.0


class CostTable(NamedTuple):
    """The parameters of a built-in cost family, with agents along the last, contiguous axis.

    Attributes
    ----------
    slopes : ndarray, shape (m, D, n)
        Derivatives by each resource as dense polynomials, lowest power first.
    quadratic : ndarray, shape (m, m, n) or (0, 0, 0)
        Quadratic forms; empty where costs are separable.
    weights : ndarray, shape (m, n) or (0, 0)
        Weights of the weighted sum; empty where costs are separable.
    sum_slopes : ndarray, shape (D', n) or (0, 0)
        Derivative of the function of the weighted sum; empty where costs are separable.
    """

    slopes: FloatArray
    quadratic: FloatArray
    weights: FloatArray
    sum_slopes: FloatArray

    @property
    def n_agents(self) -> int:
        """Number of agents that the table describes; 0 where the costs are no built-in family."""
        return int(self.slopes.shape[2])


def cost_table(costs: Costs) -> CostTable:
    """Lay out the costs for compiled code.

    Parameters
    ----------
    costs : Costs
        The private costs of all agents.

    Returns
    -------
    CostTable
        Empty (no agents) if the costs are the user's own functions, which kernels cannot call.
    """
    none = np.zeros((0, 0))
    if isinstance(costs, CoupledCosts):
        own = cost_table(costs.separable_part)
        return own._replace(
            quadratic=np.ascontiguousarray(costs.quadratic.transpose(1, 2, 0)),
            weights=np.ascontiguousarray(costs.weights.T),
            sum_slopes=costs.sum_slopes.copy(),
        )
    if isinstance(costs, PolynomialCosts):
        return CostTable(np.ascontiguousarray(costs.slopes.transpose(2, 0, 1)), none[None], none, none)
    return CostTable(none[None], none[None], none, none)


@formula
def _horner_row(rows: FloatArray, argument: FloatArray, out: FloatArray) -> None:
    """Evaluate one polynomial per agent; the passes run along agents, so that they vectorise."""
    n, d = out.shape[0], rows.shape[0] - 1
    top = rows[d]
    for i in range(n):
        out[i] = top[i]
    while d >= 4:  # four powers to a pass: a quarter of the loads and stores
        first, second, third, fourth = rows[d - 1], rows[d - 2], rows[d - 3], rows[d - 4]
        for i in range(n):
            x = argument[i]
            out[i] = (((out[i] * x + first[i]) * x + second[i]) * x + third[i]) * x + fourth[i]
        d -= 4
    while d >= 1:
        row = rows[d - 1]
        for i in range(n):
            out[i] = out[i] * argument[i] + row[i]
        d -= 1


@kernel
def gradient_row(
    table: CostTable, averages: FloatArray, resource: int, out: FloatArray, spare: FloatArray
) -> None:
    """Evaluate grad_j f_i of all agents at their averages.

    Parameters
    ----------
    table : CostTable
        The costs.
    averages : ndarray, shape (m, n)
        In units of the resources; only row `resource` is read where costs are separable.
    resource : int
        j.
    out : ndarray, shape (n,)
        Receives the derivatives.
    spare : ndarray, shape (2, n)
        Working memory.
    """
    _horner_row(table.slopes[resource], averages[resource], out)
    m = table.quadratic.shape[0] if table.weights.shape[0] > 0 else 0
    if m > 0:
        n = out.shape[0]
        for other in range(m):
            for i in range(n):
                out[i] += table.quadratic[resource, other, i] * averages[other, i]
        for i in range(n):
            spare[0, i] = 0.0
        for other in range(m):
            for i in range(n):
                spare[0, i] += table.weights[other, i] * averages[other, i]
        _horner_row(table.sum_slopes, spare[0], spare[1])
        for i in range(n):
            out[i] += table.weights[resource, i] * spare[1, i]


def _horner(coefficients: Sequence[float], argument: float) -> float:
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * argument + coefficient
    return total


def _without_leading_zeros(coefficients: FloatArray) -> list[float]:
    """Drop powers that the agent does not have: Horner's scheme gives the same bits without them."""
    present = np.flatnonzero(coefficients)
    return [float(value) for value in coefficients[: present[-1] + 1]] if len(present) else [0.0]


def marginal_cost(costs: Costs, agent: int) -> Callable[[Sequence[float], int], float]:
    """Return one agent's partial derivative in plain Python, bit for bit what the kernels compute.

    Parameters
    ----------
    costs : Costs
        The private costs of all agents.
    agent : int
        i.

    Returns
    -------
    callable
        ``marginal(averages, resource) -> float`` with the agent's averages of all m resources.
    """
    if isinstance(costs, PolynomialCosts):
        slopes = [_without_leading_zeros(row) for row in costs.slopes[:, agent, :].T]
        return lambda averages, resource: _horner(slopes[resource], averages[resource])
    if isinstance(costs, CoupledCosts):
        return _coupled_marginal_cost(costs, agent)

    def custom(averages: Sequence[float], resource: int) -> float:
        return float(costs.agent_gradient(agent, np.array(averages))[resource])  # type: ignore[attr-defined]

    return custom


def _coupled_marginal_cost(costs: CoupledCosts, agent: int) -> Callable[[Sequence[float], int], float]:
    own = marginal_cost(costs.separable_part, agent)
    quadratic = costs.quadratic[agent].tolist()
    weights = costs.weights[agent].tolist()
    slopes = _without_leading_zeros(costs.sum_slopes[:, agent])

    def marginal(averages: Sequence[float], resource: int) -> float:
        total = own(averages, resource)
        for factor, average in zip(quadratic[resource], averages, strict=True):
            total += factor * average
        weighted = 0.0
        for weight, average in zip(weights, averages, strict=True):
            weighted += weight * average
        slope = _horner(slopes, weighted)
        return float(total + weights[resource] * slope)

    return marginal


@kernel
def tick_averages(
    demand: FloatArray,
    accumulated: FloatArray,
    anchor: FloatArray,
    increase: FloatArray,
    tick: float,
    out: FloatArray,
) -> None:
    """Compute the averages that agents have at tick k, present demand included: eq. (average_eqn).

    Parameters
    ----------
    demand, accumulated, anchor : ndarray, shape (n,)
        State for one resource; the anchor as a tick's index.
    increase : ndarray, shape (n,)
        alpha.
    tick : float
        k, the index of the tick.
    out : ndarray, shape (n,)
        Receives the averages, in units of the resource.
    """
    for i in range(demand.shape[0]):
        ticks = tick - anchor[i]
        out[i] = accumulated_over_ticks(accumulated[i], demand[i], increase[i], ticks) / (tick + 1.0)


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
    average: FloatArray,
    gradient: FloatArray,
    uniform: FloatArray,
    tick: float,
) -> None:
    """Let all agents answer one capacity signal at tick k: Algorithm 2, the branch S = 1.

    Parameters
    ----------
    demand, accumulated, anchor : ndarray, shape (n,)
        State for the signal's resource; moved to tick k.
    responses, saturated : ndarray of int, shape (n,)
        Counts of decreases, and of those that had lambda > 1.
    increase, decrease : ndarray, shape (n,)
        alpha and beta.
    normalization : float
        Gamma.
    average, gradient : ndarray, shape (n,)
        x-bar(k) and the derivative of the cost there.
    uniform : ndarray, shape (n,)
        The draw of each agent for this broadcast.
    tick : float
        k.
    """
    for i in range(demand.shape[0]):
        demand[i], accumulated[i], decreases, certain = answered(
            demand[i],
            accumulated[i],
            tick - anchor[i],
            increase[i],
            decrease[i],
            normalization,
            gradient[i],
            average[i],
            uniform[i],
        )
        anchor[i] = tick
        responses[i] += decreases
        saturated[i] += certain
