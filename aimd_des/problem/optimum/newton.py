"""Newton's method for the optimum from nearby, where all agents hold something of everything.

Bounds are left out of account: a step solves for the shares that add up and whose derivatives, taken for
linear, are the multipliers.  That is a third of the work of a step along the central path.
"""

import numpy as np

from aimd_des.problem.optimum.scaled_costs import Candidate, ScaledCosts
from aimd_des.utils.validation import FloatArray

#: The residual below which these steps are tried: above, most of them lead out of the bounds.
NEAR = 0.1
# Each step about squares the residual, so that from `NEAR` on four are enough.
_STEPS = 6
# A multiple of each block's diagonal that keeps it invertible where the Hessian is singular (costs
# that are linear in some direction).  It bends the Newton direction a little, never the solution.
_REGULARIZATION = 1e-14


def newton_steps(
    scaled: ScaledCosts, start: Candidate, tolerance: float, most: int = _STEPS
) -> tuple[Candidate | None, int]:
    """Take steps until the residual is within the tolerance: None if they do not arrive, and their number."""
    point, last = start, min(most, _STEPS)
    for taken in range(last + 1):
        if point.residual <= tolerance:
            return point, taken
        if taken < last:
            shares, multipliers = _step(scaled, point)
            if not (shares > 0.0).all():
                return None, taken + 1
            point = Candidate(shares, scaled.gradient(shares), multipliers)
    return None, last


def _step(scaled: ScaledCosts, point: Candidate) -> tuple[FloatArray, FloatArray]:
    """Solve for shares and multipliers; not a number where there are none."""
    lacking, hessian = (1.0 - point.shares).sum(axis=0), scaled.hessian(point.shares)
    if scaled.costs.separable:
        flatness = 1.0 / np.einsum("ijj->ij", hessian)
        free = flatness * point.gradient
        multipliers = (lacking + free.sum(axis=0)) / flatness.sum(axis=0)
        return point.shares + (flatness * multipliers - free), multipliers
    inverse = inverse_blocks(hessian)
    free = np.einsum("ijk,ik->ij", inverse, point.gradient)
    multipliers = solve_scaled(inverse.sum(axis=0), lacking + free.sum(axis=0))
    return point.shares + (inverse @ multipliers - free), multipliers


def inverse_blocks(blocks: FloatArray) -> FloatArray:
    """Invert the positive definite blocks (n, m, m), nearly singular ones included."""
    unit, scale = _unit_diagonal(blocks)
    np.einsum("ijj->ij", unit)[...] = 1.0 + _REGULARIZATION
    return np.asarray(np.linalg.inv(unit) * (scale[:, :, None] * scale[:, None, :]))


def solve_scaled(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve positive definite equations (m, m) for the multipliers."""
    unit, scale = _unit_diagonal(matrix)
    return np.asarray(scale * np.linalg.solve(unit, scale * right))


def _unit_diagonal(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Scale rows and columns, (..., m), so that the diagonals are 1: prices may differ by any factor."""
    scale = 1.0 / np.sqrt(np.einsum("...jj->...j", matrices))
    return matrices * (scale[..., :, None] * scale[..., None, :]), scale
