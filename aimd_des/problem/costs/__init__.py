"""Private costs: what each agent pays for its long-term averages.

A cost f_i is convex, twice differentiable and increasing on x >= 0 (the assumptions of the
paper's section II).  Every family evaluates all agents at once: a value per agent, a gradient
per agent and resource, a Hessian per agent.  Nothing inside the package asks of which family
costs are; `aimd_des.costs` hands out all of them.
"""

from aimd_des.problem.costs.base import CostMethods, Costs, family
from aimd_des.problem.costs.checks import check_costs, sample_box
from aimd_des.problem.costs.coupled import CoupledCosts
from aimd_des.problem.costs.custom import CustomCosts
from aimd_des.problem.costs.methods import (
    compiled_gradient,
    cost_table,
    marginal_cost,
    selected_costs,
    steepest_at_corners,
    weighted_costs,
)
from aimd_des.problem.costs.polynomial import PolynomialCosts
from aimd_des.problem.costs.table import CostTable

__all__ = [
    "CostMethods",
    "CostTable",
    "Costs",
    "CoupledCosts",
    "CustomCosts",
    "PolynomialCosts",
    "check_costs",
    "compiled_gradient",
    "cost_table",
    "family",
    "marginal_cost",
    "sample_box",
    "selected_costs",
    "steepest_at_corners",
    "weighted_costs",
]
