"""Utilities to be maximised: f_i(x) = sum_j price^j x^j - u_ij(x^j) with u concave."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.custom import CustomCosts
from aimd_des.problem.costs.terms import TermCosts, common_price, each_agent, prices
from aimd_des.utils import validation
from aimd_des.utils.compiled_call import is_compiled
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.validation import FloatArray

_Prices = float | Sequence[float] | FloatArray


@built_in("costs", "utility")
class UtilityCosts(TermCosts):
    r"""A price that is the same for all agents, less the utility of what an agent holds.

    .. math::

        f_i(x) = \sum_j \mathrm{price}^j x^j - u_{ij}(x^j), \quad
        u(x) = w\,\frac{(x + s)^{1 - \phi} - s^{1 - \phi}}{1 - \phi}
        \quad \mathrm{or} \quad w \log(1 + x / s) \; \mathrm{if} \; \phi = 1

    Utilities are alpha-fair, with fairness :math:`\phi`, and a shift s that makes their derivative at 0
    finite.  Where all of the capacity is allocated the price adds the same to the cost of every
    allocation: the sum of the costs is least where the sum of the utilities is largest.

    Parameters
    ----------
    weights : array_like, shape (n, m)
        w > 0, in units of cost per unit of the resource to the power 1 - fairness.
    shifts : float or array_like, shape (n, m)
        Greater than 0, in units of the resources.
    fairness : float
        Greater than 0: 1 is proportional fairness, and the larger, the more equal are shares.
    price : float or array_like, shape (m,), optional
        In units of cost per unit of the resource, at least the largest derivative of a utility at 0,
        w shift**-fairness; default: just that.

    Raises
    ------
    InputError
        If a shape differs, a number is outside its range, or a price is too low.

    Notes
    -----
    The elasticity of the cost, x f'' / f', is fairness u' x / ((price - u') (x + shift)): small where shares
    are large beside the shift, and averages then converge slowly.

    Examples
    --------
    >>> costs = UtilityCosts([[1.0], [4.0]], shifts=1.0)
    >>> costs.gradient(np.array([[1.0], [1.0]])).tolist()  # the price is 4
    [[3.5], [2.0]]
    """

    proven = True
    steepest_at_corners = True

    def __init__(
        self,
        weights: npt.ArrayLike,
        shifts: npt.ArrayLike,
        fairness: float = 1.0,
        price: _Prices | None = None,
    ) -> None:
        weight = validation.array("weights", weights, ("n_agents", "n_resources"), low=0.0, low_open=True)
        shift = each_agent("shifts", shifts, weight.shape)
        exponent = -validation.number("fairness", fairness, low=0.0, low_open=True)
        cost = common_price(price, weight * shift**exponent)
        terms = np.stack(np.broadcast_arrays(-weight, exponent, shift), axis=-1)
        super().__init__(np.broadcast_to(cost, weight.shape)[:, :, None], powers=terms[:, :, None])

    def utility(self, allocation: FloatArray) -> FloatArray:
        """Evaluate u_i(x_i).

        Parameters
        ----------
        allocation : ndarray, shape (n, m)
            In units of the resources.

        Returns
        -------
        ndarray, shape (n,)
            In units of cost; 0 for an agent that holds nothing.
        """
        return np.asarray((self.table().slopes[:, 0].T * allocation).sum(axis=1) - self.value(allocation))

    @staticmethod
    def from_functions(
        n_agents: int,
        n_resources: int,
        utility: Callable[[int, FloatArray], float],
        gradient: Callable[[int, FloatArray], npt.ArrayLike],
        price: _Prices,
        hessian: Callable[[int, FloatArray], npt.ArrayLike] | None = None,
        *,
        separable: bool = False,
    ) -> CustomCosts:
        """Take utilities as functions of (agent, allocation).

        Parameters
        ----------
        n_agents, n_resources : int
            n and m.
        utility : callable
            ``utility(agent, allocation) -> float``: u_i, concave.
        gradient : callable
            ``gradient(agent, allocation) -> (m,)``: its partial derivatives.  Decorated with `numba.njit`,
            a fleet can call it.
        price : float or array_like, shape (m,)
            In units of cost per unit of the resource, above all derivatives of utilities.
        hessian : callable, optional
            ``hessian(agent, allocation) -> (m, m)``: the second derivatives of u_i.
        separable : bool
            Whether no u_i couples resources.

        Returns
        -------
        CustomCosts
            f_i = price . x - u_i.

        Raises
        ------
        InputError
            If a size is no positive integer, a price is not finite, or a function cannot be called.
        """
        m = validation.integer("n_resources", n_resources, low=1)
        each = prices("price", price, m)
        for name, function in (("utility", utility), ("gradient", gradient)):
            if not callable(function):
                raise InputError.of(name, function, "a function of (agent, allocation)")

        def plain(agent: int, allocation: FloatArray) -> FloatArray:
            own, left = gradient(agent, allocation), np.empty(m)
            for j in range(m):
                left[j] = each[j] - own[j]  # type: ignore[index]  # an array, a list or a tuple
            return left

        slopes = plain
        if is_compiled(gradient):
            import numba

            slopes = numba.njit(plain)
        return CustomCosts(
            n_agents,
            m,
            lambda agent, x: float(each @ x - utility(agent, x)),
            slopes,
            None if hessian is None else lambda agent, x: -np.asarray(hessian(agent, x)),
            separable=separable,
        )
