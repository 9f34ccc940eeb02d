"""Costs of some of the agents alone, of the same family."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.base import Costs
from aimd_des.problem.costs.coupled import CoupledCosts
from aimd_des.problem.costs.custom import CustomCosts
from aimd_des.problem.costs.polynomial import PolynomialCosts
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["selected_costs"]


def selected_costs(costs: Costs, chosen: npt.ArrayLike) -> Costs:
    """Take out the costs of some agents.

    Examples
    --------
    >>> costs = PolynomialCosts([2], [[[1.0]], [[2.0]], [[3.0]]])
    >>> selected_costs(costs, [True, False, True]).gradient(np.array([[1.0], [1.0]])).tolist()
    [[2.0], [6.0]]
    """
    kept = np.flatnonzero(chosen)
    if isinstance(costs, PolynomialCosts):
        return PolynomialCosts(costs.exponents, costs.coefficients[kept])
    if isinstance(costs, CoupledCosts):
        own = costs.separable_part
        return CoupledCosts(
            PolynomialCosts(own.exponents, own.coefficients[kept]),
            quadratic=costs.quadratic[kept],
            weights=costs.weights[kept],
            sum_exponents=costs.sum_exponents,
            sum_coefficients=costs.sum_coefficients[kept],
        )
    if isinstance(costs, CustomCosts):
        return _selected_custom(costs, kept.tolist())
    raise InputError.of("costs", type(costs).__name__, "PolynomialCosts, CoupledCosts or CustomCosts")


def _selected_custom(costs: CustomCosts, kept: list[int]) -> CustomCosts:
    def selected(function: Callable[[int, FloatArray], Any]) -> Callable[[int, FloatArray], Any]:
        return lambda agent, allocation: function(kept[agent], allocation)

    hessian = None if costs.agent_hessian is None else selected(costs.agent_hessian)
    return CustomCosts(
        len(kept),
        costs.n_resources,
        selected(costs.agent_value),
        selected(costs.agent_gradient),
        hessian,
        separable=costs.separable,
    )
