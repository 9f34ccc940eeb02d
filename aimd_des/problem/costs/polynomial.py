"""Separable polynomial costs, f_i(x) = sum_jp c_ijp * (x^j)^p; eq. (cost_fn) of the paper is one."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.marginal import Marginal, polynomial_marginal
from aimd_des.problem.costs.table import CostTable, separable_table
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.spare_arrays import spare_zeros
from aimd_des.utils.validation import FloatArray, IntArray

_MAX_EXPONENT = 64

# Agents whose coefficients are laid out at a time: few enough that they stay in the cache.
_TOGETHER = 1 << 13


def dense_slopes(exponents: Sequence[int], coefficients: FloatArray) -> FloatArray:
    """Turn sum_p c_p x**p into the coefficients of its derivative, lowest power first."""
    # With agents next to each other, as compiled code reads them.
    n, *others, _ = coefficients.shape
    rows = spare_zeros((*others, max(exponents), n))
    for first in range(0, n, _TOGETHER):
        few = slice(first, first + _TOGETHER)
        columns = np.moveaxis(coefficients[few], 0, -1).copy()
        for place in np.ndindex(*others):
            for exponent, column in zip(exponents, columns[place], strict=True):
                # A power that no agent has is not written, and so takes no memory.
                if column.any():
                    rows[(*place, exponent - 1, few)] += exponent * column
    return np.moveaxis(rows, (-2, -1), (0, 1))


def horner(rows: FloatArray, x: FloatArray) -> FloatArray:
    """Evaluate polynomials elementwise by Horner's scheme."""
    # Laid out row by row, also where the others are not: in which order sums of it are taken depends on that.
    total = np.zeros(np.shape(x))
    for row in rows[::-1]:
        total = total * x + row
    return total


def checked_powers(field: str, exponents: object) -> tuple[int, ...]:
    """Return the powers of a polynomial, or refuse them."""
    given = list(exponents) if validation.axes(exponents) else []  # type: ignore[call-overload]  # it has elements
    powers = tuple(
        validation.integer(f"{field}[{position}]", power, low=1, high=_MAX_EXPONENT)
        for position, power in enumerate(given)
    )
    if not powers or len(set(powers)) != len(powers):
        raise InputError.of(field, exponents, "one or more different integers")
    return powers


@built_in("costs", "polynomial")
class PolynomialCosts:
    r"""Costs that are polynomials without cross terms, one per agent and resource.

    .. math::

        f_i(x) = \sum_{j,p} c_{ijp}\,(x^j)^p

    Parameters
    ----------
    exponents : sequence of int
        The powers p, integers from 1 to 64, each once.
    coefficients : array_like, shape (n, m, len(exponents))
        c_ijp, in units of cost per unit of resource j to the power p.  Negative ones are
        allowed where the sum still is convex and increasing (`Problem` checks that).

    Raises
    ------
    InputError
        If an exponent is no integer in the range or stands twice, or the coefficients have
        another shape or are not finite, or their products with the exponents are not.

    Examples
    --------
    Two agents, one resource, f_0 = x**2 and f_1 = 2 x**2 + x**4:

    >>> costs = PolynomialCosts(exponents=[2, 4], coefficients=[[[1, 0]], [[2, 1]]])
    >>> costs.gradient(np.array([[1.0], [1.0]])).tolist()
    [[2.0], [8.0]]
    """

    separable = True

    def __init__(self, exponents: Sequence[int], coefficients: npt.ArrayLike) -> None:
        powers = self.exponents = checked_powers("exponents", exponents)
        self.coefficients = validation.array(
            "coefficients",
            coefficients,
            ("n_agents", "n_resources", len(powers)),
            remedy="give one finite number for each agent, resource and exponent",
        )
        if 0 in self.coefficients.shape:
            raise InputError.of(
                "shape of coefficients", self.coefficients.shape, "at least 1 in each direction"
            )
        #: (D, n, m): the derivative by each resource as a dense polynomial, lowest power first.
        with np.errstate(over="ignore"):
            self.slopes = dense_slopes(powers, self.coefficients)
        if not np.isfinite(self.slopes).all():
            largest = float(abs(self.coefficients).max())
            raise InputError.of(
                "largest of coefficients", largest, "small enough for derivatives to be finite"
            )

    def __getstate__(self) -> dict[str, Any]:
        # Pickled slopes would take memory for powers that no agent has, in the process that reads them.
        state = {name: part for name, part in vars(self).items() if name not in ("_table", "_proven")}
        return {**state, "slopes": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.slopes = dense_slopes(self.exponents, self.coefficients)

    @property
    def n_agents(self) -> int:
        """Number of agents, n."""
        return int(self.coefficients.shape[0])

    @property
    def n_resources(self) -> int:
        """Number of resources, m."""
        return int(self.coefficients.shape[1])

    @property
    def proven(self) -> bool:
        """True if no coefficient is negative and every polynomial has a term: nothing need be sampled."""
        return self._proven

    @cached_property
    def _proven(self) -> bool:
        # Kept, since the check that these are costs reads all that costs must have.
        return bool((self.coefficients >= 0).all() and (self.coefficients > 0).any(axis=2).all())

    @property
    def steepest_at_corners(self) -> bool:
        """Whether derivative over allocation is largest at a corner: as where nothing is negative."""
        return self.proven

    def table(self) -> CostTable:
        """Lay out the derivatives for compiled code."""
        return self._table

    @cached_property
    def _table(self) -> CostTable:
        # Of the same memory as the slopes.
        return separable_table(self.slopes.transpose(2, 0, 1))

    def marginal(self, agent: int) -> Marginal:
        """Return one agent's partial derivative, as a process calls it."""
        return polynomial_marginal(self.slopes[:, agent, :].T)

    def scaled(self, weights: FloatArray) -> "PolynomialCosts":
        """Multiply the costs by weights."""
        return PolynomialCosts(self.exponents, self.coefficients * weights[:, :, None])

    def select(self, agents: IntArray) -> "PolynomialCosts":
        """Take out some agents."""
        return PolynomialCosts(self.exponents, self.coefficients[agents])

    def value(self, allocation: FloatArray) -> FloatArray:
        """Evaluate f_i(x_i)."""
        dense = self.slopes / np.arange(1, len(self.slopes) + 1)[:, None, None]
        return np.asarray((horner(dense, allocation) * allocation).sum(axis=1))

    def gradient(self, allocation: FloatArray) -> FloatArray:
        """Evaluate grad_j f_i(x_i)."""
        return horner(self.slopes, allocation)

    def hessian(self, allocation: FloatArray) -> FloatArray:
        """Evaluate the second derivatives of f_i at x_i, a diagonal matrix per agent."""
        curvature = self.slopes[1:] * np.arange(1, len(self.slopes))[:, None, None]
        diagonal = horner(curvature, allocation)
        return np.asarray(diagonal[:, :, None] * np.eye(self.n_resources))
