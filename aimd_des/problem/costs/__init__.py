"""Private costs: what each agent pays for its long-term averages.

A cost f_i is convex, twice differentiable and increasing on x >= 0 (the assumptions of the
paper's section II).  Every family evaluates all agents at once: a value per agent, a gradient
per agent and resource, a Hessian per agent.
"""

from aimd_des.problem.costs.base import Costs, check_on_box
from aimd_des.problem.costs.coupled import CoupledCosts
from aimd_des.problem.costs.custom import CustomCosts
from aimd_des.problem.costs.polynomial import PolynomialCosts
from aimd_des.problem.costs.selected import selected_costs
from aimd_des.problem.costs.transforms import weighted_costs

__all__ = [
    "Costs",
    "CoupledCosts",
    "CustomCosts",
    "PolynomialCosts",
    "check_on_box",
    "selected_costs",
    "weighted_costs",
]
