"""Costs that grow exponentially: f_i(x) = sum_j a_ij (exp(b_ij x^j) - 1)."""

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.terms import TermCosts, each_agent
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in


@built_in("costs", "exponential")
class ExponentialCosts(TermCosts):
    r"""Costs that grow exponentially, one for each agent and resource.

    .. math::

        f_i(x) = \sum_j a_{ij} \left(e^{b_{ij} x^j} - 1\right)

    Parameters
    ----------
    scales : array_like, shape (n, m)
        a_ij > 0, in units of cost.
    rates : float or array_like, shape (n, m)
        b_ij > 0, in units of 1 / resource.

    Raises
    ------
    InputError
        If a shape differs, or a number is not greater than 0.

    Notes
    -----
    The elasticity x f'' / f' is b x.  The derivative at 0 is a b, so that response probabilities grow without
    bound there: compute Gamma by `normalization_factors` with a lower corner.

    Examples
    --------
    >>> costs = ExponentialCosts([[2.0]], rates=0.5)
    >>> costs.gradient(np.array([[0.0]])).tolist()
    [[1.0]]
    """

    proven = True
    steepest_at_corners = True

    def __init__(self, scales: npt.ArrayLike, rates: npt.ArrayLike = 1.0) -> None:
        scale = validation.array("scales", scales, ("n_agents", "n_resources"), low=0.0, low_open=True)
        rate = each_agent("rates", rates, scale.shape)
        super().__init__(np.zeros((*scale.shape, 1)), np.stack([scale * rate, rate], axis=-1)[:, :, None])
