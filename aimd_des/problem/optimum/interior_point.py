"""The primal-dual interior point method that solves for the optimum.

With y the shares x_i^j / (C^j / n), nu the multipliers of the capacities and z >= 0 those of the
bounds, Newton's method is applied to

    grad f_i(y_i) - nu - z_i = 0,   sum_i y_i = n,   y_i^j z_i^j = tau w^j

while tau goes to 0; w^j, the mean price paid for resource j, puts resources of any price on one
scale.  A step costs n solves with the m x m blocks of the agents and one with the m x m Schur
complement, so the work is linear in n.

Sources: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., 2006, chapter 14.2 for predictor
and corrector, 16.6 for quadratic and 19.2 for general costs; M. Colombo and J. Gondzio, Comput.
Optim. Appl. 41 (2008), for the weight of the corrector.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aimd_des.problem.optimum.newton import inverse_blocks, solve_scaled
from aimd_des.problem.optimum.scaled_costs import Candidate, ScaledCosts
from aimd_des.utils.validation import FloatArray

# Where share and reduced gradient both vanish, each ends at the square root of this.
_SMALLEST_TAU = 1e-22


@dataclass(frozen=True, eq=False)
class _Iterate(Candidate):
    """A point on the way to the optimum."""

    bound_multipliers: FloatArray

    @cached_property
    def tau(self) -> float:
        """The mean of y z / w: how far down the central path the point is."""
        return float((self.shares * self.bound_multipliers / self.price).mean())


@dataclass(frozen=True, eq=False)
class _Direction:
    shares: FloatArray
    multipliers: FloatArray
    bound_multipliers: FloatArray


def follow_central_path(
    scaled: ScaledCosts, start: Candidate, tolerance: float, max_iterations: int
) -> tuple[Candidate, int]:
    """Take Newton steps until the residual is within the tolerance, and count them."""
    point = _with_bounds(start)
    for iteration in range(max_iterations):
        if point.residual <= tolerance:
            return point, iteration
        following = _newton_step(scaled, point)
        if following is None:
            return point, iteration
        point = following
    return point, max_iterations


def _with_bounds(start: Candidate) -> _Iterate:
    """Put bound multipliers to the shares that a power law gives, near the central path of tau = 1."""
    central = 0.1 * start.price / np.maximum(start.shares, 0.1)
    bounds = np.maximum(start.gradient - start.multipliers, central)
    return _Iterate(start.shares, start.gradient, start.multipliers, bounds)


def _newton_step(scaled: ScaledCosts, point: _Iterate) -> _Iterate | None:
    """Take one step: a predictor chooses the next tau, a corrected direction goes there; None if it fails."""
    y, z, price = point.shares, point.bound_multipliers, point.price
    blocks = scaled.hessian(y)
    np.einsum("ijj->ij", blocks)[...] += z / y
    inverse = inverse_blocks(blocks)
    predictor = _newton_direction(point, inverse, y * z)
    reach_y = _step_to_bound(y, predictor.shares, 1.0)
    reach_z = _step_to_bound(z, predictor.bound_multipliers, 1.0)
    products = (y + reach_y * predictor.shares) * (z + reach_z * predictor.bound_multipliers)
    # Mehrotra's rule: aim low if the predictor could go far.
    centring = np.clip((float((products / price).mean()) / point.tau) ** 3, 1e-6, 1.0)
    target = max(centring * point.tau, _SMALLEST_TAU) * price
    # The corrector saves steps, but misleads where the predictor could not go far, and may lead uphill.
    corrector = min(reach_y, reach_z) ** 2 * predictor.shares * predictor.bound_multipliers
    for correction, halvings in ((corrector, 3), (0.0, 40)):
        direction = _newton_direction(point, inverse, y * z + correction - target)
        found = _line_search(scaled, point, direction, target, halvings)
        if found is not None:
            break
    else:
        return None
    step, gradient = found
    step_z = _step_to_bound(z, direction.bound_multipliers, _fraction_to_bound(point.tau))
    return _Iterate(
        y + step * direction.shares,
        gradient,
        point.multipliers + step * direction.multipliers,
        z + step_z * direction.bound_multipliers,
    )


def _newton_direction(point: _Iterate, inverse: FloatArray, products: FloatArray) -> _Direction:
    """Solve the Newton system in which y z is to change by -`products`.

    dz is eliminated first, then the blocks of the agents, which leaves m equations for d nu.
    """
    y, z = point.shares, point.bound_multipliers
    free = np.einsum("ijk,ik->ij", inverse, point.multipliers + z - point.gradient - products / y)
    lacking = (1 - y).sum(axis=0) - free.sum(axis=0)
    multipliers = solve_scaled(inverse.sum(axis=0), lacking)
    shares = free + inverse @ multipliers
    return _Direction(shares, multipliers, -(products + z * shares) / y)


def _step_to_bound(values: FloatArray, direction: FloatArray, fraction: float) -> float:
    """Return the longest step, at most 1, that goes no further than a fraction of the way to the bound 0."""
    shrinking = direction < 0
    if not shrinking.any():
        return 1.0
    return min(1.0, fraction * float((-values[shrinking] / direction[shrinking]).min()))


def _fraction_to_bound(tau: float) -> float:
    """Go nearer to the bound as tau vanishes, so that convergence is fast, but never onto it."""
    return float(np.clip(1.0 - tau, 0.995, 1.0 - 1e-8))


def _line_search(
    scaled: ScaledCosts, point: _Iterate, direction: _Direction, target: FloatArray, halvings: int
) -> tuple[float, FloatArray] | None:
    """Halve the step until the barrier function sum_i f_i - sum target log(y) no longer rises steeply.

    Slopes decide, not values: near the optimum differences of values are rounding.  nu is taken off
    the gradient because shares move along the capacity constraint, where it adds only rounding.
    """

    def slope(shares: FloatArray, gradient: FloatArray) -> float:
        return float(((gradient - point.multipliers - target / shares) * direction.shares).sum())

    steepest = 0.5 * abs(slope(point.shares, point.gradient))
    step = _step_to_bound(point.shares, direction.shares, _fraction_to_bound(point.tau))
    for _ in range(halvings):
        shares = point.shares + step * direction.shares
        gradient = scaled.gradient(shares)
        rounding = float((gradient * (1e-12 * np.abs(direction.shares) + 1e-15 * shares)).sum())
        if np.isfinite(gradient).all() and slope(shares, gradient) <= steepest + rounding:
            return step, gradient
        step /= 2
    return None
