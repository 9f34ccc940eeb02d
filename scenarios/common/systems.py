"""What the studies share beside the paper's system: a part of it, and losses that differ."""

import numpy as np

from aimd_des import PolynomialCosts, Problem
from aimd_des.lowlevel import FloatArray
from models.smart_cameras import smart_cameras


def spread(low: float, high: float, n: int = 60) -> FloatArray:
    """Spread values evenly over n agents, in an order that has nothing to do with their costs, (n,)."""
    return np.random.default_rng(2018).permutation(np.linspace(low, high, n))


def elasticity(problem: Problem, x: FloatArray) -> FloatArray:
    """Compute how steep costs are at x, (n, m): x f'' / f', 1 for quadratic ones."""
    gradient = problem.costs.gradient(x)
    return np.asarray(x * np.einsum("ijj->ij", problem.costs.hessian(x)) / gradient)


def memory_alone(n: int = 60, normalization: float = 1 / 90) -> Problem:
    """Take the memory of the paper's system of n cameras by itself: the costs do not couple resources."""
    full = smart_cameras(0, n_cameras=n, normalization=normalization)
    costs = full.costs
    assert isinstance(costs, PolynomialCosts)  # noqa: S101 - the model's costs are
    return Problem(full.resources[:1], PolynomialCosts(costs.exponents, costs.coefficients[:, :1]))
