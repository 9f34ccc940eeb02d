"""Private costs: the families that a `Problem` takes, and weights on them."""

from aimd_des.problem.costs import CostMethods, Costs, CostTable, weighted_costs
from aimd_des.problem.costs.coupled import CoupledCosts
from aimd_des.problem.costs.custom import CustomCosts
from aimd_des.problem.costs.exponential import ExponentialCosts
from aimd_des.problem.costs.polynomial import PolynomialCosts
from aimd_des.problem.costs.power import PowerCosts
from aimd_des.problem.costs.terms import TermCosts
from aimd_des.problem.costs.tracking import TrackingCosts
from aimd_des.problem.costs.utility import UtilityCosts

__all__ = [
    "CostMethods",
    "CostTable",
    "Costs",
    "CoupledCosts",
    "CustomCosts",
    "ExponentialCosts",
    "PolynomialCosts",
    "PowerCosts",
    "TermCosts",
    "TrackingCosts",
    "UtilityCosts",
    "weighted_costs",
]
