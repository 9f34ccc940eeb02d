"""Derivatives of private costs in compiled code: of all agents, and of one; with the same bits.

Polynomials are evaluated by Horner's scheme, in the same order in both, and powers by portable mathematics.
"""

from aimd_des.problem.costs.table import CostTable
from aimd_des.utils.jit import deferred, formula, kernel
from aimd_des.utils.opaque import opaque
from aimd_des.utils.portable_math import exp, log
from aimd_des.utils.validation import FloatArray


@formula
def horner_row(coefficients: FloatArray, agent: int, argument: FloatArray, out: FloatArray) -> None:
    """Evaluate a polynomial each of consecutive agents; passes run along agents, so that they vectorise."""
    n, top = out.shape[0], coefficients.shape[0] - 1
    row = coefficients[top][agent:]
    # Four powers to a pass: a quarter of the loads and stores; the first takes what is left over.  That rows
    # go downwards from pass to pass is kept from LLVM, which has vectors ready for what goes upwards only.
    rest = top % 4
    if rest == 0:
        for i in range(n):
            out[i] = row[i]
    elif rest == 1:
        second = coefficients[opaque(top) - 1][agent:]
        for i in range(n):
            out[i] = row[i] * argument[i] + second[i]
    elif rest == 2:
        second, third = coefficients[opaque(top) - 1][agent:], coefficients[opaque(top) - 2][agent:]
        for i in range(n):
            out[i] = (row[i] * argument[i] + second[i]) * argument[i] + third[i]
    else:
        second, third = coefficients[opaque(top) - 1][agent:], coefficients[opaque(top) - 2][agent:]
        fourth = coefficients[opaque(top) - 3][agent:]
        for i in range(n):
            x = argument[i]
            out[i] = ((row[i] * x + second[i]) * x + third[i]) * x + fourth[i]
    for four in range(top // 4):
        d = opaque(top - rest - 4 * four)
        first, second = coefficients[d - 1][agent:], coefficients[d - 2][agent:]
        third, fourth = coefficients[d - 3][agent:], coefficients[d - 4][agent:]
        for i in range(n):
            x = argument[i]
            out[i] = (((out[i] * x + first[i]) * x + second[i]) * x + third[i]) * x + fourth[i]


@deferred
def _add_terms(table: CostTable, resource: int, agent: int, average: float, total: float) -> float:
    """Add the terms, of which there are some."""
    for t in range(table.exponentials.shape[1]):
        scale, rate = table.exponentials[resource, t, 0, agent], table.exponentials[resource, t, 1, agent]
        total += scale * exp(rate * average)
    for t in range(table.powers.shape[1]):
        scale, exponent = table.powers[resource, t, 0, agent], table.powers[resource, t, 1, agent]
        total += scale * exp(exponent * log(average + table.powers[resource, t, 2, agent]))
    return total


@formula
def add_terms(table: CostTable, resource: int, agent: int, average: float, total: float) -> float:
    """Add one agent's exponentials and powers to the rest of its derivative."""
    if table.exponentials.shape[1] + table.powers.shape[1] > 0:
        return _add_terms(table, resource, agent, average, total)
    return total


@kernel
def gradient_row(
    table: CostTable, averages: FloatArray, resource: int, out: FloatArray, spare: FloatArray
) -> None:
    """Evaluate grad_j f_i of all agents at their averages."""
    horner_row(table.slopes[resource], 0, averages[resource], out)
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
        horner_row(table.sum_slopes, 0, spare[0], spare[1])
        for i in range(n):
            out[i] += table.weights[resource, i] * spare[1, i]
    if table.exponentials.shape[1] + table.powers.shape[1] > 0:
        for i in range(out.shape[0]):
            out[i] = add_terms(table, resource, i, averages[resource, i], out[i])


@formula
def horner_step(
    total: FloatArray, argument: FloatArray, coefficient: FloatArray, count: int, first: bool
) -> None:
    """Take one step of Horner's scheme for several polynomials."""
    for row in range(count):
        total[row] = coefficient[row] if first else total[row] * argument[row] + coefficient[row]


@formula
def horner_at(rows: FloatArray, agent: int, argument: float) -> float:
    """Evaluate one agent's polynomial."""
    top = rows.shape[0] - 1
    total = rows[top, agent]
    for d in range(top - 1, -1, -1):
        total = total * argument + rows[d, agent]
    return float(total)


@formula
def gradient_at(table: CostTable, averages: FloatArray, resource: int, agent: int) -> float:
    """Evaluate grad_j f_i of one agent at its averages: the bits that `gradient_row` has for it."""
    total = horner_at(table.slopes[resource], agent, averages[resource])
    m = table.quadratic.shape[0] if table.weights.shape[0] > 0 else 0
    if m > 0:
        weighted = 0.0
        for other in range(m):
            total += table.quadratic[resource, other, agent] * averages[other]
            weighted += table.weights[other, agent] * averages[other]
        total += table.weights[resource, agent] * horner_at(table.sum_slopes, agent, weighted)
    return add_terms(table, resource, agent, averages[resource], total)
