"""What compiled code needs to know of private costs: the parameters of their derivatives, as arrays."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray, IntArray


@record
class CostTable(NamedTuple):
    """The parameters of derivatives that compiled code evaluates, with agents along the last axis.

    The derivative by resource j is the sum of four parts: a polynomial, what couples resources (a
    quadratic form and a polynomial of a weighted sum), exponentials ``scale * exp(rate * x)``, and powers
    ``scale * (x + shift) ** exponent``.

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
    exponentials : ndarray, shape (m, T, 2, n)
        Scale and rate of each exponential.
    powers : ndarray, shape (m, T', 3, n)
        Scale, exponent and shift of each power.
    """

    slopes: FloatArray
    quadratic: FloatArray
    weights: FloatArray
    sum_slopes: FloatArray
    exponentials: FloatArray
    powers: FloatArray

    @classmethod
    def of(
        cls,
        slopes: npt.ArrayLike,
        *,
        exponentials: npt.ArrayLike | None = None,
        powers: npt.ArrayLike | None = None,
    ) -> "CostTable":
        """Lay out the derivatives of costs that do not couple resources.

        Parameters
        ----------
        slopes : array_like, shape (n, m, D)
            The polynomial of each agent and resource, lowest power first; D may be 1, a constant.
        exponentials : array_like, shape (n, m, T, 2), optional
            Scale and rate of each exponential; default: none.
        powers : array_like, shape (n, m, T', 3), optional
            Scale, exponent and shift of each power; default: none.

        Returns
        -------
        CostTable
            The arrays as compiled code reads them.

        Raises
        ------
        InputError
            If a shape differs, or a number is not finite.
        """
        rows = validation.array("slopes", slopes, ("n_agents", "n_resources", "degree + 1"))
        if 0 in rows.shape:
            raise InputError.of("shape of slopes", rows.shape, "at least 1 in each direction")
        tables = {}
        for name, given, width in (("exponentials", exponentials, 2), ("powers", powers, 3)):
            if given is not None:
                terms = validation.array(name, given, (*rows.shape[:2], "terms", width))
                tables[name] = terms.transpose(1, 2, 3, 0).copy()
        return separable_table(rows.transpose(1, 2, 0))._replace(**tables)

    @property
    def n_agents(self) -> int:
        """Number of agents that the table describes; 0 where costs have none."""
        return int(self.slopes.shape[2])

    def scaled(self, weights: FloatArray) -> "CostTable":
        """Multiply all derivatives by a weight for each agent.

        Parameters
        ----------
        weights : ndarray, shape (n,) or (m, n)
            With a row for each resource only where no resources are coupled.

        Returns
        -------
        CostTable
            Of the same layout.
        """
        rows = weights.reshape(-1, 1, weights.shape[-1])
        exponentials, powers = self.exponentials.copy(), self.powers.copy()
        for terms in (exponentials, powers):
            terms[:, :, 0] *= rows
        return self._replace(
            slopes=self.slopes * rows,
            quadratic=self.quadratic * weights if self.quadratic.size else self.quadratic,
            sum_slopes=self.sum_slopes * weights if self.sum_slopes.size else self.sum_slopes,
            exponentials=exponentials,
            powers=powers,
        )

    def select(self, agents: IntArray) -> "CostTable":
        """Take out some agents.

        Parameters
        ----------
        agents : ndarray of int
            Their indices, in ascending order.

        Returns
        -------
        CostTable
            Of the same layout.
        """
        return CostTable(*(part[..., agents].copy() if part.size else part for part in self))


def separable_table(slopes: FloatArray) -> CostTable:
    """Lay out polynomials alone, given with shape (m, D, n)."""
    none, (m, _, n) = np.zeros((0, 0)), slopes.shape
    # Kernels would be compiled once more for arrays that are read-only or lie in memory in another order.
    rows = slopes if slopes.flags.c_contiguous and slopes.flags.writeable else slopes.copy()
    return CostTable(rows, none[None], none, none, np.zeros((m, 0, 2, n)), np.zeros((m, 0, 3, n)))


def no_table() -> CostTable:
    """Stand for costs that compiled code knows no formula of."""
    return separable_table(np.zeros((1, 0, 0)))
