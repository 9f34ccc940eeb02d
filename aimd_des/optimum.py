"""The centralised solution that every run is held against.

minimise sum_i f_i(x_i)  subject to  sum_i x_i^j = C^j and x_i^j >= 0   (eq. obj_fn1 of the paper).

A primal-dual interior point method: with nu the multipliers of the capacities and z >= 0 those of
the bounds, Newton's method is applied to

    grad f_i(x_i) - nu - z_i = 0,   sum_i x_i = C,   x_i^j z_i^j = tau w^j

while tau goes to 0.  Each Newton step costs n solves with the m x m blocks of the agents and one
with their m x m Schur complement, so the work is linear in n.  Source: J. Nocedal and S. J. Wright,
Numerical Optimization, 2nd ed., 2006, chapters 14.2 (predictor and corrector) and 19.3 (line search).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.checks import FloatArray
from aimd_des.costs import Costs
from aimd_des.errors import SimulationError
from aimd_des.problem import Problem

__all__ = ["Optimum", "solve_optimum"]

# A multiple of each block's diagonal that keeps it invertible where the Hessian is singular (costs
# that are linear in some direction).  It bends the Newton direction a little, never the solution.
_REGULARIZATION = 1e-14
# The residual takes the smaller of share and reduced gradient, which is sqrt(tau) where both vanish.
_SMALLEST_TAU = 1e-22
# How far z may stray from the central path: A. Waechter and L. T. Biegler, Math. Program. 106 (2006), eq. 16.
_STRAY = 1e10
_SWEEPS = 8
_SMALLEST_SHARE = 1e-13


@dataclass(frozen=True, eq=False)
class Optimum:
    """The solution of the centralised problem.

    Attributes
    ----------
    allocation : ndarray, shape (n, m)
        x*, in units of the resources.  An agent that should get nothing gets a positive amount
        far below ``tolerance`` of the equal share C / n.
    multipliers : ndarray, shape (m,)
        nu: the derivative of the cost common to all agents that hold some of the resource, in
        units of cost per unit of the resource.
    cost : float
        sum_i f_i(x*_i), in units of cost.
    kkt_residual : float
        How far the Karush-Kuhn-Tucker conditions are from holding, as `solve_optimum` defines it.
    iterations : int
        Newton steps taken.
    """

    allocation: FloatArray
    multipliers: FloatArray
    cost: float
    kkt_residual: float
    iterations: int


def solve_optimum(
    problem: Problem,
    *,
    capacity: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_iterations: int = 500,
) -> Optimum:
    """Minimise the total cost of using up the capacities.

    Parameters
    ----------
    problem : Problem
        The agents' costs and the capacities.
    capacity : array_like, shape (m,), optional
        Capacities > 0 to use instead of the problem's, in units of the resources: with the totals
        of the averages in a run, the optimum that `misallocation` compares with.
    tolerance : float
        The KKT residual to reach, 1e-14 to 1e-2.
    max_iterations : int
        Newton steps after which to give up.

    Returns
    -------
    Optimum
        Allocation, multipliers, cost and the residual reached.

    Raises
    ------
    InputError
        If a capacity, the tolerance or the number of iterations is outside its range.
    SimulationError
        If the residual stays above the tolerance; the message names the residual reached.

    Notes
    -----
    The KKT residual is the largest, over agents i and resources j, of

    - feasibility: abs(sum_i x_i^j - C^j) / C^j,
    - stationarity, nonnegativity and complementarity in one: abs(min(s, d)),
    - complementarity as a share of what an equal share costs: s * max(d, 0),

    with the share s = x_i^j / (C^j / n) and the reduced gradient d = grad_j f_i(x_i) / nu^j - 1.
    It is free of units and 0 exactly at an optimum.  Where the costs are strictly convex the
    optimum is unique; where they are not, the allocation is one of several of the same cost.

    Examples
    --------
    Costs x**2 and 3 x**2: the second agent gets a third of what the first gets.

    >>> from aimd_des.costs import PolynomialCosts
    >>> from aimd_des.problem import Resource
    >>> memory = Resource("memory", capacity=4.0, increase=0.01, decrease=0.5, normalization=0.01)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]], [[3.0]]]))
    >>> solve_optimum(problem).allocation.round(6).tolist()
    [[3.0], [1.0]]
    """
    given = problem.capacity if capacity is None else capacity
    total = checks.array("capacity", given, (problem.n_resources,), low=0.0, low_open=True)
    limit = checks.number("tolerance", tolerance, low=1e-14, high=1e-2)
    last = checks.integer("max_iterations", max_iterations, low=1)
    scaled = _ScaledCosts(problem.costs, total / problem.n_agents)
    # Trial points may overflow steep costs: the line search turns back from values that are not
    # finite, and a residual that is not finite ends in the error below.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        point, iterations = _follow_central_path(scaled, limit, last)
    residual = _kkt_residual(point.shares, point.gradient, point.multipliers)
    if not residual <= limit:
        raise SimulationError(
            f"optimum not found: KKT residual {residual:.3g} after {iterations} iterations, wanted at most"
            f" {limit:g}; check that the costs are convex, increasing and smooth, or raise max_iterations"
        )
    allocation = point.shares * scaled.equal_share
    return Optimum(
        allocation=_read_only(allocation),
        multipliers=_read_only(point.multipliers / scaled.equal_share),
        cost=float(problem.costs.value(allocation).sum()),
        kkt_residual=residual,
        iterations=iterations,
    )


@dataclass(frozen=True, eq=False)
class _ScaledCosts:
    """Costs of shares, which are multiples of C / n: units and numbers of agents drop out."""

    costs: Costs
    equal_share: FloatArray

    def gradient(self, shares: FloatArray) -> FloatArray:
        return self.costs.gradient(shares * self.equal_share) * self.equal_share

    def hessian(self, shares: FloatArray) -> FloatArray:
        scale = self.equal_share[:, None] * self.equal_share
        return self.costs.hessian(shares * self.equal_share) * scale


@dataclass(frozen=True, eq=False)
class _Point:
    """A point on the way: shares (n, m), their gradient, nu (m,) and z (n, m)."""

    shares: FloatArray
    gradient: FloatArray
    multipliers: FloatArray
    bound_multipliers: FloatArray

    @property
    def price(self) -> FloatArray:
        """The mean price paid, w (m,): equal to nu at the optimum, and positive everywhere."""
        return np.asarray((self.shares * self.gradient).mean(axis=0))

    @property
    def tau(self) -> float:
        """The mean of x z / w, how far down the central path the point is."""
        return float((self.shares * self.bound_multipliers / self.price).mean())


@dataclass(frozen=True, eq=False)
class _Direction:
    shares: FloatArray
    multipliers: FloatArray
    bound_multipliers: FloatArray


def _read_only(values: FloatArray) -> FloatArray:
    values.setflags(write=False)
    return values


def _kkt_residual(shares: FloatArray, gradient: FloatArray, multipliers: FloatArray) -> float:
    """Evaluate the residual that `solve_optimum` defines; infinite where a multiplier is not positive."""
    if not ((multipliers > 0).all() and np.isfinite(gradient).all()):
        return float(np.inf)
    reduced = gradient / multipliers - 1
    feasibility = np.abs(shares.mean(axis=0) - 1).max()
    stationarity = np.abs(np.minimum(shares, reduced)).max()
    complementarity = (shares * np.maximum(reduced, 0)).max()
    return float(max(feasibility, stationarity, complementarity))


def _power_law_multipliers(log_shares: FloatArray, log_gradient: FloatArray, elasticity: FloatArray) -> FloatArray:
    """Solve sum_i y_i (nu / g_i)**(1 / e_i) = n for log(nu): convex in it, so Newton's method cannot fail."""
    log_nu = log_gradient.max(axis=0)
    for _ in range(50):
        exponents = log_shares + (log_nu - log_gradient) / elasticity
        top = exponents.max(axis=0)
        terms = np.exp(exponents - top)
        excess = top + np.log(terms.mean(axis=0))
        log_nu = log_nu - excess * terms.sum(axis=0) / (terms / elasticity).sum(axis=0)
        if np.abs(excess).max() < 1e-6:
            break
    return log_nu


def _start(scaled: _ScaledCosts, n_agents: int) -> _Point:
    """Find a start that fits the scales, by sweeps that take each derivative for a power of the share.

    From equal shares alone Newton's method would need very many steps where derivatives differ by
    many orders of magnitude: on y**p it only gains a factor (p - 2) / (p - 1) each time.
    """
    tiny = np.finfo(float).tiny
    shares = np.ones((n_agents, len(scaled.equal_share)))
    gradient = scaled.gradient(shares)
    for _ in range(_SWEEPS):
        halved = np.maximum(scaled.gradient(shares / 2), tiny)
        log_gradient, log_shares = np.log(np.maximum(gradient, tiny)), np.log(shares)
        # Elasticity 1 at least: a nearly linear cost then gets a share of about nu / gradient, where
        # share times reduced gradient is about nu: on the central path and not at the bound.
        elasticity = np.clip((log_gradient - np.log(halved)) / np.log(2.0), 1.0, 100.0)
        log_nu = _power_law_multipliers(log_shares, log_gradient, elasticity)
        moved = log_shares + (log_nu - log_gradient) / elasticity
        shares = np.exp(np.clip(moved, np.log(_SMALLEST_SHARE), np.log(n_agents)))
        shares /= shares.mean(axis=0)
        gradient = scaled.gradient(shares)
        if np.abs(np.log(shares) - log_shares).max() < 0.5:
            break
    price = (shares * gradient).mean(axis=0)
    bound_multipliers = np.maximum(gradient - np.exp(log_nu), 0.1 * price / np.maximum(shares, 0.1))
    return _Point(shares, gradient, np.exp(log_nu), bound_multipliers)


def _follow_central_path(scaled: _ScaledCosts, tolerance: float, max_iterations: int) -> tuple[_Point, int]:
    """Take Newton steps until the residual is within the tolerance, or no longer a number."""
    point = _start(scaled, scaled.costs.n_agents)
    for iteration in range(max_iterations):
        residual = _kkt_residual(point.shares, point.gradient, point.multipliers)
        if residual <= tolerance or not np.isfinite(point.gradient).all():
            return point, iteration
        point = _newton_step(scaled, point)
    return point, max_iterations


def _inverse(matrices: FloatArray) -> FloatArray:
    """Invert positive definite matrices, (..., m, m), whose rows may differ in scale by any factor."""
    diagonal = np.einsum("...jj->...j", matrices)
    scale = 1.0 / np.sqrt(diagonal)
    outer = scale[..., :, None] * scale[..., None, :]
    unit = matrices * outer
    np.einsum("...jj->...j", unit)[...] = 1.0 + _REGULARIZATION
    return np.asarray(np.linalg.inv(unit) * outer)


def _newton_direction(
    point: _Point, inverse: FloatArray, schur: FloatArray, products: FloatArray
) -> _Direction:
    """Solve the Newton system in which x z + dx z + x dz + (the given excess) = 0.

    `products` is that excess over the target, x z - tau w with or without the corrector.  dz is
    eliminated first, then the blocks of the agents, which leaves m equations for d nu.
    """
    y, z = point.shares, point.bound_multipliers
    right = -(point.gradient - point.multipliers - z) - products / y
    free = np.einsum("ijk,ik->ij", inverse, right)
    excess = (y - 1).sum(axis=0)
    multipliers = np.linalg.solve(schur, -excess - free.sum(axis=0))
    shares = free + inverse @ multipliers
    return _Direction(shares, multipliers, -(products + z * shares) / y)


def _step_to_bound(values: FloatArray, direction: FloatArray, fraction: float = 1.0) -> float:
    """Return the longest step, at most 1, that goes no further than a fraction of the way to the bound 0."""
    shrinking = direction < 0
    if not shrinking.any():
        return 1.0
    return min(1.0, fraction * float((-values[shrinking] / direction[shrinking]).min()))


def _newton_step(scaled: _ScaledCosts, point: _Point) -> _Point:
    """Take one step: a predictor chooses the target tau, a corrected step goes there."""
    y, z, price, tau = point.shares, point.bound_multipliers, point.price, point.tau
    blocks = scaled.hessian(y)
    np.einsum("ijj->ij", blocks)[...] += z / y
    inverse = _inverse(blocks)
    schur = inverse.sum(axis=0)
    predictor = _newton_direction(point, inverse, schur, y * z)
    ahead_y = y + _step_to_bound(y, predictor.shares) * predictor.shares
    ahead_z = z + _step_to_bound(z, predictor.bound_multipliers) * predictor.bound_multipliers
    centring = np.clip((float((ahead_y * ahead_z / price).mean()) / tau) ** 3, 1e-6, 1.0)
    target = max(centring * tau, _SMALLEST_TAU) * price
    corrector = predictor.shares * predictor.bound_multipliers
    # The corrector saves iterations but need not lead downhill; without it the direction does.
    for correction, halvings in ((corrector, 3), (np.zeros_like(y), 40)):
        direction = _newton_direction(point, inverse, schur, y * z + correction - target)
        accepted, step, gradient = _line_search(scaled, point, direction, target, halvings)
        if accepted:
            break
    fraction = _fraction_to_bound(tau)
    step_z = _step_to_bound(z, direction.bound_multipliers, fraction)
    shares = y + step * direction.shares
    central = target / shares
    return _Point(
        shares,
        gradient,
        point.multipliers + step * direction.multipliers,
        np.clip(z + step_z * direction.bound_multipliers, central / _STRAY, central * _STRAY),
    )


def _fraction_to_bound(tau: float) -> float:
    """Go nearer to the bound as tau vanishes, so that convergence is fast, but never onto it."""
    return float(np.clip(1.0 - tau, 0.995, 1.0 - 1e-8))


def _line_search(
    scaled: _ScaledCosts, point: _Point, direction: _Direction, target: FloatArray, halvings: int
) -> tuple[bool, float, FloatArray]:
    """Halve the step until the barrier function sum_i f_i - sum target log(x) no longer rises steeply.

    Slopes decide, not values: near the optimum differences of values are rounding.  nu is taken off
    the gradient because shares move along the capacity constraint, where it adds rounding and nothing
    else.  Separable costs are a problem per resource, and no dear resource may hide a cheap one.
    """

    def total(terms: FloatArray) -> FloatArray:
        return np.asarray(terms.sum(axis=0 if scaled.costs.separable else None))

    def slope(shares: FloatArray, gradient: FloatArray) -> FloatArray:
        return total((gradient - point.multipliers - target / shares) * direction.shares)

    steepest = 0.5 * np.abs(slope(point.shares, point.gradient))
    step = _step_to_bound(point.shares, direction.shares, _fraction_to_bound(point.tau))
    for _ in range(halvings):
        shares = point.shares + step * direction.shares
        gradient = scaled.gradient(shares)
        rounding = total(gradient * (1e-12 * np.abs(direction.shares) + 1e-15 * shares))
        if np.isfinite(gradient).all() and (slope(shares, gradient) <= steepest + rounding).all():
            return True, step, gradient
        step /= 2
    return False, step, gradient
