"""Costs with a weight for each agent: w_i f_i, of the same family as f_i, so that a run can use them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.base import Costs
from aimd_des.problem.costs.coupled import CoupledCosts
from aimd_des.problem.costs.custom import CustomCosts
from aimd_des.problem.costs.polynomial import PolynomialCosts
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["weighted_costs"]


def weighted_costs(costs: Costs, weights: npt.ArrayLike) -> Costs:
    """Scale the costs of each agent.

    Parameters
    ----------
    costs : Costs
        Of one of the three families.
    weights : array_like, shape (n,) or (n, m)
        Greater than 0; with a column for each resource only for `PolynomialCosts`.

    Returns
    -------
    Costs
        Of the same family.

    Raises
    ------
    InputError
        If the weights do not fit these costs.

    Examples
    --------
    >>> costs = PolynomialCosts([2], [[[1.0]], [[1.0]]])
    >>> weighted_costs(costs, [1.0, 3.0]).gradient(np.array([[1.0], [1.0]])).tolist()
    [[2.0], [6.0]]
    """
    n, m = costs.n_agents, costs.n_resources
    shape = (n,) if validation.axes(weights) == 1 else (n, m)
    table = validation.array("weights", weights, shape, low=0.0, low_open=True).reshape(n, -1)
    if isinstance(costs, PolynomialCosts):
        return PolynomialCosts(costs.exponents, costs.coefficients * table[:, :, None])
    if (table != table[:, :1]).any():
        raise InputError.of(
            "weights", "that differ from resource to resource", "one number for each agent with these costs"
        )
    factors = table[:, 0]
    if isinstance(costs, CoupledCosts):
        return _weighted_coupled(costs, factors)
    if isinstance(costs, CustomCosts):
        return _weighted_custom(costs, factors)
    raise InputError.of("costs", type(costs).__name__, "PolynomialCosts, CoupledCosts or CustomCosts")


def _weighted_coupled(costs: CoupledCosts, factors: FloatArray) -> CoupledCosts:
    own = costs.separable_part
    return CoupledCosts(
        PolynomialCosts(own.exponents, own.coefficients * factors[:, None, None]),
        quadratic=costs.quadratic * factors[:, None, None],
        weights=costs.weights,
        sum_exponents=costs.sum_exponents,
        sum_coefficients=costs.sum_coefficients * factors[:, None],
    )


def _weighted_custom(costs: CustomCosts, factors: FloatArray) -> CustomCosts:
    def weighted(function: Callable[[int, FloatArray], Any]) -> Callable[[int, FloatArray], Any]:
        return lambda agent, allocation: factors[agent] * np.asarray(function(agent, allocation))

    hessian = None if costs.agent_hessian is None else weighted(costs.agent_hessian)
    return CustomCosts(
        costs.n_agents,
        costs.n_resources,
        weighted(costs.agent_value),
        weighted(costs.agent_gradient),
        hessian,
        separable=costs.separable,
    )
