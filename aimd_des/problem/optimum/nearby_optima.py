"""Optima for capacities that differ a little, each found from the one before.

Newton's method finds an optimum at which all agents hold something quickly from nearby; where it does not,
`solve_optimum` does.
"""

import numpy as np

from aimd_des.problem.optimum.newton import newton_steps
from aimd_des.problem.optimum.optimum import solve_optimum
from aimd_des.problem.optimum.scaled_costs import Candidate, ScaledCosts
from aimd_des.problem.problem import Problem
from aimd_des.utils.validation import FloatArray

_RESIDUAL = 1e-10


def optimal_allocations(problem: Problem, capacities: FloatArray) -> FloatArray:
    """Solve for the optimal allocations at capacities (k, m), in order: (k, n, m)."""
    found = np.empty((len(capacities), problem.n_agents, problem.n_resources))
    for row, capacity in enumerate(capacities):
        near = _from_near(problem, capacity, found[row - 1]) if row else None
        found[row] = solve_optimum(problem, capacity=capacity).allocation if near is None else near
    return found


def _from_near(problem: Problem, capacity: FloatArray, start: FloatArray) -> FloatArray | None:
    """Take Newton steps from the optimum for another capacity; None if they do not arrive."""
    scaled = ScaledCosts(problem.costs, capacity / problem.n_agents)
    shares = start / start.mean(axis=0)
    with np.errstate(all="ignore"):
        gradient = scaled.gradient(shares)
        point, _ = newton_steps(scaled, Candidate(shares, gradient, gradient.mean(axis=0)), _RESIDUAL)
    return None if point is None else np.asarray(point.shares * scaled.equal_share)
