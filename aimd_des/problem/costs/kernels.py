"""Derivatives of private costs, twice: as rows for kernels, as numbers for processes; with the same bits.

A power is never taken: polynomials are evaluated by Horner's scheme, in the same order in both.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from aimd_des.problem.costs import Costs, CoupledCosts, CustomCosts, PolynomialCosts
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray

__all__ = ["CostTable", "cost_table", "gradient_at", "gradient_row", "horner_step", "marginal_cost"]


class CostTable(NamedTuple):
    """The parameters of a built-in cost family, with agents along the last, contiguous axis."""

    slopes: FloatArray  # (m, D, n): derivatives by each resource as dense polynomials, lowest power first
    quadratic: FloatArray  # (m, m, n): quadratic forms; empty where costs are separable
    weights: FloatArray  # (m, n): weights of the weighted sum; empty where costs are separable
    # (D', n): derivative of the function of the weighted sum; empty where costs are separable.
    sum_slopes: FloatArray

    @property
    def n_agents(self) -> int:
        """Number of agents that the table describes; 0 where the costs are no built-in family."""
        return int(self.slopes.shape[2])


def cost_table(costs: Costs) -> CostTable:
    """Lay out the costs for compiled code."""
    none = np.zeros((0, 0))
    if isinstance(costs, CoupledCosts):
        own = cost_table(costs.separable_part)
        return own._replace(
            # Copies, since a kernel would be compiled once more for arrays that are read-only.
            quadratic=costs.quadratic.transpose(1, 2, 0).copy(),
            weights=costs.weights.T.copy(),
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
    """Evaluate grad_j f_i of all agents at their averages."""
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


@formula
def horner_step(
    total: FloatArray, argument: FloatArray, coefficient: FloatArray, count: int, first: bool
) -> None:
    """Take one step of Horner's scheme for several polynomials."""
    for row in range(count):
        total[row] = coefficient[row] if first else total[row] * argument[row] + coefficient[row]


@formula
def _horner_at(rows: FloatArray, agent: int, argument: float) -> float:
    """Evaluate one agent's polynomial."""
    top = rows.shape[0] - 1
    total = rows[top, agent]
    for d in range(top - 1, -1, -1):
        total = total * argument + rows[d, agent]
    return float(total)


@formula
def gradient_at(table: CostTable, averages: FloatArray, resource: int, agent: int) -> float:
    """Evaluate grad_j f_i of one agent at its averages: the bits that `gradient_row` has for it."""
    total = _horner_at(table.slopes[resource], agent, averages[resource])
    m = table.quadratic.shape[0] if table.weights.shape[0] > 0 else 0
    if m > 0:
        weighted = 0.0
        for other in range(m):
            total += table.quadratic[resource, other, agent] * averages[other]
            weighted += table.weights[other, agent] * averages[other]
        total += table.weights[resource, agent] * _horner_at(table.sum_slopes, agent, weighted)
    return total


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
    """Return one agent's partial derivative in plain Python, bit for bit what the kernels compute."""
    if isinstance(costs, PolynomialCosts):
        return _polynomial_marginal_cost(costs, agent)
    if isinstance(costs, CoupledCosts):
        return _coupled_marginal_cost(costs, agent)

    if isinstance(costs, CustomCosts):
        own = costs.agent_gradient
        return lambda averages, resource: float(np.asarray(own(agent, np.array(averages)))[resource])

    def one_of_all(averages: Sequence[float], resource: int) -> float:
        everybody = np.tile(averages, (costs.n_agents, 1))
        return float(costs.gradient(everybody)[agent, resource])

    return one_of_all


def _polynomial_marginal_cost(costs: PolynomialCosts, agent: int) -> Callable[[Sequence[float], int], float]:
    slopes = [_without_leading_zeros(row) for row in costs.slopes[:, agent, :].T]
    # Horner's scheme written out: processes spend a good part of their time here.
    tops = [row[-1] for row in slopes]
    rests = [row[-2::-1] for row in slopes]

    def marginal(averages: Sequence[float], resource: int) -> float:
        average, total = averages[resource], tops[resource]
        for coefficient in rests[resource]:
            total = total * average + coefficient
        return total

    return marginal


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
