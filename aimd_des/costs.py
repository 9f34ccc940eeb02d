"""Private costs: the families that a `Problem` takes, and weights on them."""

from aimd_des.problem.costs import (
    Costs,
    CostTable,
    CoupledCosts,
    CustomCosts,
    PolynomialCosts,
    weighted_costs,
)

__all__ = ["CostTable", "Costs", "CoupledCosts", "CustomCosts", "PolynomialCosts", "weighted_costs"]
