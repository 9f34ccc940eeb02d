"""Costs that are sums of real powers: f_i(x) = sum_jp a_ijp (x^j)**p, p > 1."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.terms import TermCosts
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in


@built_in("costs", "power")
class PowerCosts(TermCosts):
    r"""Costs that are sums of powers with real exponents, without cross terms.

    .. math::

        f_i(x) = \sum_{j,p} a_{ijp}\,(x^j)^p, \quad p > 1

    With whole exponents `PolynomialCosts` are the same and faster.

    Parameters
    ----------
    exponents : sequence of float
        The powers p > 1.
    coefficients : array_like, shape (n, m, len(exponents))
        a_ijp >= 0, in units of cost per unit of resource j to the power p; of each agent and resource one is
        greater than 0.

    Raises
    ------
    InputError
        If a shape differs, or a number is outside its range.

    Notes
    -----
    The elasticity x f'' / f' lies between the smallest and the largest p - 1.  With an exponent below 2
    response probabilities grow without bound near 0, as x**(p - 2): compute Gamma by
    `normalization_factors` with a lower corner.

    Examples
    --------
    >>> costs = PowerCosts([1.5], [[[2.0]]])
    >>> costs.gradient(np.array([[4.0]])).tolist()
    [[6.0]]
    """

    proven = True
    steepest_at_corners = True

    def __init__(self, exponents: Sequence[float], coefficients: npt.ArrayLike) -> None:
        powers = validation.array("exponents", exponents, ("powers",), low=1.0, low_open=True)
        scale = validation.array(
            "coefficients", coefficients, ("n_agents", "n_resources", len(powers)), low=0.0
        )
        if not (scale > 0.0).any(axis=2).all():
            agent, resource = np.argwhere(~(scale > 0.0).any(axis=2))[0].tolist()
            field = f"coefficients[{agent}, {resource}]"
            raise InputError.of(field, scale[agent, resource].tolist(), "greater than 0 in one place")
        terms = np.stack(np.broadcast_arrays(scale * powers, powers - 1.0, 0.0), axis=-1)
        super().__init__(np.zeros((*scale.shape[:2], 1)), powers=terms)
