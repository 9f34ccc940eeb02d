r"""Costs in which the resources really interact.

f_i(x) = sum_jp c_ijp (x^j)^p + x' Q_i x / 2 + sum_p g_ip (w_i . x)^p

with Q_i symmetric and positive semidefinite and weights w_i >= 0: a separable part, a quadratic
form, and a convex function of a weighted sum (for cameras: the price of the hours of processing
that all resources cause together).
"""

from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.marginal import Marginal, table_marginal
from aimd_des.problem.costs.methods import one_each
from aimd_des.problem.costs.polynomial import PolynomialCosts, checked_powers, dense_slopes, horner
from aimd_des.problem.costs.table import CostTable, separable_table
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.validation import FloatArray, IntArray


class CoupledCosts:
    r"""A separable polynomial plus a quadratic form plus a polynomial of a weighted sum.

    .. math::

        f_i(x) = \sum_{j,p} c_{ijp}\,(x^j)^p + \frac{1}{2} x' Q_i x + \sum_p g_{ip}\,(w_i \cdot x)^p

    Parameters
    ----------
    separable_part : PolynomialCosts
        The part without interaction; it sets n and m.
    quadratic : array_like, shape (n, m, m), optional
        Q_i, symmetric and positive semidefinite; default: 0.
    weights : array_like, shape (n, m), optional
        w_i >= 0; default: 0.
    sum_exponents : sequence of int
        The powers of the weighted sum, integers >= 1; default: (2,).
    sum_coefficients : array_like, shape (n, len(sum_exponents)), optional
        g_ip >= 0; default: 0.

    Raises
    ------
    InputError
        If a shape differs, a matrix is not symmetric or not positive semidefinite (naming the
        agent), or a weight or a coefficient of the sum is negative.

    Examples
    --------
    One agent, two resources, f = x**2 + y**2 + (x + y)**2:

    >>> own = PolynomialCosts([2], [[[1.0], [1.0]]])
    >>> costs = CoupledCosts(own, weights=[[1.0, 1.0]], sum_coefficients=[[1.0]])
    >>> costs.gradient(np.array([[1.0, 2.0]])).tolist()
    [[8.0, 10.0]]
    """

    separable = False

    def __init__(
        self,
        separable_part: PolynomialCosts,
        quadratic: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
        sum_exponents: Sequence[int] = (2,),
        sum_coefficients: npt.ArrayLike | None = None,
    ) -> None:
        self.separable_part = validation.instance(
            "separable_part", separable_part, PolynomialCosts, "PolynomialCosts"
        )
        n, m = separable_part.n_agents, separable_part.n_resources
        powers = checked_powers("sum_exponents", sum_exponents)
        self.quadratic = validation.array(
            "quadratic", np.zeros((n, m, m)) if quadratic is None else quadratic, (n, m, m)
        )
        self.weights = validation.array(
            "weights", np.zeros((n, m)) if weights is None else weights, (n, m), low=0.0
        )
        self.sum_exponents = powers
        self.sum_coefficients = validation.array(
            "sum_coefficients",
            np.zeros((n, len(powers))) if sum_coefficients is None else sum_coefficients,
            (n, len(powers)),
            low=0.0,
        )
        self._check_quadratic()
        #: (D, n): the derivative of the function of the weighted sum, lowest power first.
        self.sum_slopes = dense_slopes(powers, self.sum_coefficients)

    @classmethod
    def from_coefficients(
        cls,
        exponents: Sequence[int],
        coefficients: npt.ArrayLike,
        quadratic: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
        sum_exponents: Sequence[int] = (2,),
        sum_coefficients: npt.ArrayLike | None = None,
    ) -> Self:
        """Make coupled costs of numbers alone, as a scenario file does.

        Parameters
        ----------
        exponents : sequence of int
            The powers of the part without interaction, integers from 1 to 64, each once.
        coefficients : array_like, shape (n, m, len(exponents))
            Of these powers, as for `PolynomialCosts`.
        quadratic : array_like, shape (n, m, m), optional
            Q_i, symmetric and positive semidefinite; default: 0.
        weights : array_like, shape (n, m), optional
            w_i >= 0; default: 0.
        sum_exponents : sequence of int
            The powers of the weighted sum, integers >= 1.
        sum_coefficients : array_like, shape (n, len(sum_exponents)), optional
            g_ip >= 0; default: 0.

        Returns
        -------
        CoupledCosts

        Raises
        ------
        InputError
            As for `PolynomialCosts` and `CoupledCosts`.
        """
        own = PolynomialCosts(exponents, coefficients)
        return cls(own, quadratic, weights, sum_exponents, sum_coefficients)

    def _check_quadratic(self) -> None:
        skew = np.abs(self.quadratic - self.quadratic.transpose(0, 2, 1)).max(axis=(1, 2))
        scale = np.maximum(np.abs(self.quadratic).max(axis=(1, 2)), 1e-300)
        if (skew > 1e-12 * scale).any():
            agent = int(np.argmax(skew > 1e-12 * scale))
            raise InputError.of(f"quadratic[{agent}]", self.quadratic[agent].tolist(), "symmetric")
        smallest = np.linalg.eigvalsh(self.quadratic)[:, 0]
        if (smallest < -1e-9 * scale).any():
            agent = int(np.argmax(smallest < -1e-9 * scale))
            raise InputError.of(
                f"quadratic[{agent}]",
                self.quadratic[agent].tolist(),
                "positive semidefinite",
                f"its smallest eigenvalue is {smallest[agent]:g}; costs must be convex",
            )

    @property
    def n_agents(self) -> int:
        """Number of agents, n."""
        return self.separable_part.n_agents

    @property
    def n_resources(self) -> int:
        """Number of resources, m."""
        return self.separable_part.n_resources

    @property
    def proven(self) -> bool:
        """True if the separable part is proven and no entry of a quadratic form is negative."""
        return self.separable_part.proven and bool((self.quadratic >= 0).all())

    @property
    def steepest_at_corners(self) -> bool:
        """Whether derivative over allocation is largest at a corner: as where nothing is negative."""
        return self.proven

    def table(self) -> CostTable:
        """Lay out the derivatives for compiled code."""
        return self._table(slice(None))

    def _table(self, agents: slice) -> CostTable:
        own = separable_table(self.separable_part.slopes[:, agents].transpose(2, 0, 1))
        return own._replace(
            quadratic=self.quadratic[agents].transpose(1, 2, 0).copy(),
            weights=self.weights[agents].T.copy(),
            sum_slopes=self.sum_slopes[:, agents].copy(),
        )

    def marginal(self, agent: int) -> Marginal:
        """Return one agent's partial derivative, as a process calls it."""
        return table_marginal(self._table(slice(agent, agent + 1)), 0)

    def scaled(self, weights: FloatArray) -> "CoupledCosts":
        """Multiply the costs by weights."""
        factors = one_each(weights)
        return CoupledCosts(
            self.separable_part.scaled(weights),
            quadratic=self.quadratic * factors[:, None, None],
            weights=self.weights,
            sum_exponents=self.sum_exponents,
            sum_coefficients=self.sum_coefficients * factors[:, None],
        )

    def select(self, agents: IntArray) -> "CoupledCosts":
        """Take out some agents."""
        return CoupledCosts(
            self.separable_part.select(agents),
            quadratic=self.quadratic[agents],
            weights=self.weights[agents],
            sum_exponents=self.sum_exponents,
            sum_coefficients=self.sum_coefficients[agents],
        )

    def _weighted_sum(self, allocation: FloatArray) -> FloatArray:
        return np.asarray((self.weights * allocation).sum(axis=1))

    def value(self, allocation: FloatArray) -> FloatArray:
        """Evaluate f_i(x_i)."""
        weighted = self._weighted_sum(allocation)
        dense = self.sum_slopes / np.arange(1, len(self.sum_slopes) + 1)[:, None]
        form = 0.5 * np.einsum("ij,ijk,ik->i", allocation, self.quadratic, allocation)
        return np.asarray(self.separable_part.value(allocation) + form + horner(dense, weighted) * weighted)

    def gradient(self, allocation: FloatArray) -> FloatArray:
        """Evaluate grad_j f_i(x_i)."""
        slope = horner(self.sum_slopes, self._weighted_sum(allocation))
        form = np.einsum("ijk,ik->ij", self.quadratic, allocation)
        return np.asarray(self.separable_part.gradient(allocation) + form + self.weights * slope[:, None])

    def hessian(self, allocation: FloatArray) -> FloatArray:
        """Evaluate the second derivatives of f_i at x_i."""
        curvature = self.sum_slopes[1:] * np.arange(1, len(self.sum_slopes))[:, None]
        bend = horner(curvature, self._weighted_sum(allocation))
        outer = self.weights[:, :, None] * self.weights[:, None, :]
        return np.asarray(
            self.separable_part.hessian(allocation) + self.quadratic + bend[:, None, None] * outer
        )


built_in("costs", "coupled")(CoupledCosts.from_coefficients)
