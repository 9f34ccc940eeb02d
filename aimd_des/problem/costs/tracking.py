"""Targets to be tracked: f_i(x) = sum_j price^j x^j + w_ij (x^j - target_ij)**2 / 2."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.terms import TermCosts, common_price, each_agent
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in
from aimd_des.utils.validation import FloatArray


@built_in("costs", "tracking")
class TrackingCosts(TermCosts):
    r"""Costs of being away from a target, and a price that is the same for all agents.

    .. math::

        f_i(x) = \sum_j \mathrm{price}^j x^j + \frac{1}{2} w_{ij}\,(x^j - \mathrm{target}_{ij})^2

    The price makes costs increase, as the algorithm needs it, below the target as well.  Where all of the
    capacity is allocated it adds the same to the cost of every allocation, and the optimum is that without
    it.

    Parameters
    ----------
    targets : array_like, shape (n, m)
        What each agent would like to hold, at least 0, in units of the resources.
    weights : float or array_like, shape (n, m)
        w > 0, in units of cost per unit of the resource squared.
    price : float or array_like, shape (m,), optional
        In units of cost per unit of the resource, at least the largest w * target; default: just that.

    Raises
    ------
    InputError
        If a shape differs, a number is outside its range, or a price is too low.

    Notes
    -----
    The elasticity x f'' / f' is w x / (price + w (x - target)): the lower the price, the faster averages
    converge.

    Examples
    --------
    >>> costs = TrackingCosts([[1.0], [3.0]])
    >>> costs.gradient(np.array([[1.0], [1.0]])).tolist()  # the price is 3
    [[3.0], [1.0]]
    """

    proven = True
    steepest_at_corners = True

    def __init__(
        self,
        targets: npt.ArrayLike,
        weights: npt.ArrayLike = 1.0,
        price: float | Sequence[float] | FloatArray | None = None,
    ) -> None:
        target = validation.array("targets", targets, ("n_agents", "n_resources"), low=0.0)
        weight = each_agent("weights", weights, target.shape)
        pull = weight * target
        slopes = np.stack([common_price(price, pull) - pull, weight], axis=-1)
        super().__init__(slopes, constant=0.5 * pull * target)
