"""Optima for capacities that differ a little, each found from the one before.

Newton's method finds an optimum at which all agents hold something quickly from nearby; where it does not,
`solve_optimum` does.
"""

import numpy as np

from aimd_des.problem.optimum.interior_point import inverse_blocks, kkt_residual
from aimd_des.problem.optimum.optimum import solve_optimum
from aimd_des.problem.optimum.starting_point import ScaledCosts
from aimd_des.problem.problem import Problem
from aimd_des.utils.validation import FloatArray

_STEPS = 6
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
        multipliers = gradient.mean(axis=0)
        for _ in range(_STEPS):
            if kkt_residual(shares, gradient, multipliers) <= _RESIDUAL:
                return np.asarray(shares * scaled.equal_share)
            inverse = inverse_blocks(scaled.hessian(shares))
            free = np.einsum("ijk,ik->ij", inverse, gradient)
            multipliers = np.linalg.solve(inverse.sum(axis=0), (1.0 - shares).sum(axis=0) + free.sum(axis=0))
            shares = shares + inverse @ multipliers - free
            if not (shares > 0.0).all():
                return None
            gradient = scaled.gradient(shares)
    return None
