"""The derivative of one agent's cost in plain Python, bit for bit what compiled code computes of a table.

Processes spend a good part of their time here, so what an agent does not have is left out beforehand.
"""

from collections.abc import Callable, Sequence

import numpy as np

from aimd_des.problem.costs.table import CostTable
from aimd_des.utils.portable_math import exp, log
from aimd_des.utils.validation import FloatArray

#: The partial derivative by a resource, of one agent's averages: ``marginal(averages, resource)``.
Marginal = Callable[[Sequence[float], int], float]


def _horner(coefficients: Sequence[float], argument: float) -> float:
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * argument + coefficient
    return total


def _without_leading_zeros(coefficients: FloatArray) -> list[float]:
    """Drop powers that the agent does not have: Horner's scheme gives the same bits without them."""
    present = np.flatnonzero(coefficients)
    return [float(value) for value in coefficients[: present[-1] + 1]] if len(present) else [0.0]


def polynomial_marginal(rows: FloatArray) -> Marginal:
    """Evaluate polynomials, (m, D), lowest power first."""
    slopes = [_without_leading_zeros(row) for row in rows]
    # Horner's scheme written out: it is most runs' way.
    polynomials = [(row[-1], row[-2::-1]) for row in slopes]

    def marginal(averages: Sequence[float], resource: int) -> float:
        average = averages[resource]
        total, rest = polynomials[resource]
        for coefficient in rest:
            total = total * average + coefficient
        return total

    return marginal


def table_marginal(table: CostTable, agent: int) -> Marginal:
    """Evaluate one agent's derivatives as a table has them."""
    own = polynomial_marginal(table.slopes[:, :, agent])
    if table.weights.size:
        own = _with_coupling(own, table, agent)
    return _with_terms(own, table, agent) if table.exponentials.size + table.powers.size else own


def _with_coupling(own: Marginal, table: CostTable, agent: int) -> Marginal:
    quadratic, weights = table.quadratic[:, :, agent].tolist(), table.weights[:, agent].tolist()
    slopes = _without_leading_zeros(table.sum_slopes[:, agent])

    def marginal(averages: Sequence[float], resource: int) -> float:
        total = own(averages, resource)
        for factor, average in zip(quadratic[resource], averages, strict=True):
            total += factor * average
        weighted = 0.0
        for weight, average in zip(weights, averages, strict=True):
            weighted += weight * average
        return float(total + weights[resource] * _horner(slopes, weighted))

    return marginal


def _with_terms(own: Marginal, table: CostTable, agent: int) -> Marginal:
    exponentials, powers = table.exponentials[..., agent].tolist(), table.powers[..., agent].tolist()

    def marginal(averages: Sequence[float], resource: int) -> float:
        total, average = own(averages, resource), averages[resource]
        for scale, rate in exponentials[resource]:
            total += scale * exp(rate * average)
        for scale, exponent, shift in powers[resource]:
            total += scale * exp(exponent * log(average + shift))
        return total

    return marginal
