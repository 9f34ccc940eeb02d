"""Separable costs whose derivatives are sums of polynomials, exponentials and powers.

Value, gradient and second derivatives all follow from the table that compiled code reads, and so do the
scaled costs and those of some agents: a family of this kind only says what its terms are.
"""

import copy
from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.marginal import Marginal, table_marginal
from aimd_des.problem.costs.polynomial import horner
from aimd_des.problem.costs.table import CostTable
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.validation import FloatArray, IntArray


@built_in("costs", "terms")
class TermCosts:
    """Costs whose derivative by each resource is a sum of terms of that resource alone.

    grad_j f_i(x) = sum_d c_d x**d + sum_t scale_t exp(rate_t x) + sum_t scale_t (x + shift_t)**exponent_t

    A family of one's own may derive from this class: it is then compiled, like ours.

    Parameters
    ----------
    slopes : array_like, shape (n, m, D)
        The polynomial c, lowest power first; D may be 1, a constant price.
    exponentials : array_like, shape (n, m, T, 2), optional
        Scale and rate of each exponential, rates other than 0; default: none.
    powers : array_like, shape (n, m, T', 3), optional
        Scale, exponent and shift >= 0 of each power; default: none.  Without a shift the exponent is
        greater than 0.
    constant : array_like, shape (n, m), optional
        The part of f_i(0) that belongs to each resource, in units of cost; default: 0.

    Raises
    ------
    InputError
        If a shape differs, or a number is outside its range.

    Examples
    --------
    One agent, one resource, f = 3 x + exp(x) - 1:

    >>> costs = TermCosts([[[3.0]]], exponentials=[[[[1.0, 1.0]]]])
    >>> costs.gradient(np.array([[0.0]])).tolist()
    [[4.0]]
    """

    separable = True
    #: Whether the parameters alone prove the costs convex and increasing.
    proven = False
    #: Whether derivative over allocation is largest at a corner of every box.
    steepest_at_corners = False

    def __init__(
        self,
        slopes: npt.ArrayLike,
        exponentials: npt.ArrayLike | None = None,
        powers: npt.ArrayLike | None = None,
        constant: npt.ArrayLike | None = None,
    ) -> None:
        self._table = CostTable.of(slopes, exponentials=exponentials, powers=powers)
        shape = (self.n_agents, self.n_resources)
        given = np.zeros(shape) if constant is None else constant
        self._constant = validation.array("constant", given, shape)
        if self._table.exponentials.size and not self._table.exponentials[:, :, 1].all():
            raise InputError.of("rate in exponentials", 0.0, "other than 0", "add the constant to slopes")
        if self._table.powers.size:
            exponent, shift = self._table.powers[:, :, 1], self._table.powers[:, :, 2]
            if shift.min() < 0.0:
                raise InputError.of("shift in powers", float(shift.min()), "at least 0")
            if (bare := exponent[shift == 0.0]).size and bare.min() <= 0.0:
                raise InputError.of("exponent in powers", float(bare.min()), "greater than 0 without a shift")

    @property
    def n_agents(self) -> int:
        """Number of agents, n."""
        return self._table.n_agents

    @property
    def n_resources(self) -> int:
        """Number of resources, m."""
        return int(self._table.slopes.shape[0])

    def table(self) -> CostTable:
        """Lay out the derivatives for compiled code."""
        return self._table

    def marginal(self, agent: int) -> Marginal:
        """Return one agent's partial derivative, as a process calls it."""
        return table_marginal(self._table, agent)

    def scaled(self, weights: FloatArray) -> Self:
        """Multiply the costs by weights."""
        rows = np.broadcast_to(weights.T, (self.n_resources, self.n_agents))
        return self._with(self._table.scaled(rows), self._constant * weights)

    def select(self, agents: IntArray) -> Self:
        """Take out some agents."""
        return self._with(self._table.select(agents), self._constant[agents])

    def _with(self, table: CostTable, constant: FloatArray) -> Self:
        """Make costs of the same family with another table."""
        other = copy.copy(self)
        vars(other).update(_table=table, _constant=constant)
        return other

    def value(self, allocation: FloatArray) -> FloatArray:
        """Evaluate f_i(x_i)."""
        x, table = allocation.T, self._table
        rows = table.slopes.transpose(1, 0, 2)
        total = horner(rows / np.arange(1, len(rows) + 1)[:, None, None], x) * x
        for scale, rate in _terms(table.exponentials):
            total += scale / rate * np.expm1(rate * x)
        for scale, exponent, shift in _terms(table.powers):
            total += scale * _integral_of_power(x, exponent + 1.0, shift)
        return np.asarray((self._constant + total.T).sum(axis=1))

    def gradient(self, allocation: FloatArray) -> FloatArray:
        """Evaluate grad_j f_i(x_i)."""
        x, table = allocation.T, self._table
        total = horner(table.slopes.transpose(1, 0, 2), x)
        for scale, rate in _terms(table.exponentials):
            total += scale * np.exp(rate * x)
        for scale, exponent, shift in _terms(table.powers):
            total += scale * (x + shift) ** exponent
        return np.asarray(total.T)

    def hessian(self, allocation: FloatArray) -> FloatArray:
        """Evaluate the second derivatives of f_i at x_i, a diagonal matrix per agent."""
        x, table = allocation.T, self._table
        rows = table.slopes.transpose(1, 0, 2)
        total = horner(rows[1:] * np.arange(1, len(rows))[:, None, None], x)
        for scale, rate in _terms(table.exponentials):
            total += scale * rate * np.exp(rate * x)
        for scale, exponent, shift in _terms(table.powers):
            # At 0 the second derivative of a power below 2 is infinite, and that of a missing one is 0.
            with np.errstate(divide="ignore", invalid="ignore"):
                bend = scale * exponent * (x + shift) ** (exponent - 1.0)
            total += np.where(scale == 0.0, 0.0, bend)
        return np.asarray(total.T[:, :, None] * np.eye(self.n_resources))


def _terms(table: FloatArray) -> FloatArray:
    """Bring the terms to the front: (m, T, width, n) -> (T, width, m, n)."""
    return table.transpose(1, 2, 0, 3)


def _integral_of_power(x: FloatArray, power: FloatArray, shift: FloatArray) -> FloatArray:
    """Integrate (s + shift)**(power - 1) from 0 to x, without loss where shifts are large or powers small."""
    with np.errstate(divide="ignore", invalid="ignore"):
        grown = power * np.log1p(x / shift)
        steep = np.where(power == 0.0, np.log1p(x / shift), shift**power * np.expm1(grown) / power)
        return np.where(shift > 0.0, steep, x**power / power)


def each_agent(field: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Spread a number > 0 over agents and resources, or take one for each."""
    if validation.axes(value):
        return validation.array(field, value, shape, low=0.0, low_open=True)
    return np.full(shape, validation.number(field, value, low=0.0, low_open=True))


def common_price(price: float | Sequence[float] | FloatArray | None, gain: FloatArray) -> FloatArray:
    """Take a price for each resource, (m,), not below what any agent gains, (n, m); the least if None."""
    least: FloatArray = gain.max(axis=0)
    if price is None:
        return least
    clean = prices("price", price, len(least))
    if (clean < least).any():
        allowed = f"at least {least.tolist()}, so that costs increase with every resource"
        raise InputError.of("price", clean.tolist(), allowed, "leave it out, and it is just that")
    return clean


def prices(field: str, value: float | Sequence[float] | FloatArray, n_resources: int) -> FloatArray:
    """Spread a number over the resources, or take one for each."""
    if validation.axes(value):
        return validation.array(field, value, (n_resources,))
    return np.full(n_resources, validation.number(field, value))
