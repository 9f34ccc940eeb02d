"""Normalization factors, eq. (gamma) of the paper, and membership of the set F_delta, eq. (def_F_delta).

An agent responds with probability Gamma^j s, where s = grad_j f_i(x) / x^j is called the steepness
here.  Gamma^j is the reciprocal of the largest steepness, and f_i is in F_delta if delta_j s < 1.
"""

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs import Costs, family, sample_box, steepest_at_corners
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import BoolArray, FloatArray

_N_SAMPLES = 64
# The search moves by this factor at first, and halves the move where it leads no further up.
_FIRST_FACTOR = 2.0
_ROUNDS = 48
# Where the box reaches down to 0, samples stop at this part of its upper corner: 0 is looked at on its own.
_NEAREST_ZERO = 1e-9
# Rounding in a Hessian's eigenvalues is of the order of its norm times the machine epsilon.
_ROUNDING = 1e-9


def normalization_factors(
    costs: Costs, upper: npt.ArrayLike, *, lower: float | npt.ArrayLike = 0.0
) -> FloatArray:
    """Compute Gamma^j = inf x^j / grad_j f_i(x) over all agents i and a box of allocations.

    The paper takes the infimum over all of R_+; for costs that grow faster than quadratically that
    is 0, and no probability would be left.  Averages stay in a box: name one they do not leave.

    Parameters
    ----------
    costs : Costs
        The costs of all agents.
    upper : array_like, shape (m,)
        Upper corner of the box, > 0, in units of the resources: the capacities hold for any run,
        a few times the largest optimal allocation gives larger factors and so fewer signals.
    lower : float or array_like, shape (m,)
        Lower corner of the box lower < x <= upper, in units of the resources.

    Returns
    -------
    ndarray, shape (m,)
        Gamma, in units of the resource squared per unit of cost.  With any factor at most this, Theorem 1
        holds in the box.  0 if the steepness has no bound, as with ``lower=0`` where a derivative does
        not vanish with its own resource. That holds for linear terms, and for costs that couple
        resources: one's derivative stays positive while another is held.  A lower corner above 0 gives
        these a factor.

    Raises
    ------
    InputError
        If a corner has another shape or is not positive, or `lower` is not below `upper`.

    Notes
    -----
    Where no coefficient is negative, the result is exact up to rounding for all families except
    `CustomCosts`. Their steepness does not fall with any other resource. It is convex in the logarithm of
    its own or falls with that, so it is largest at a corner. For all other costs samples of the box are
    improved by a local search for each agent at once. The result then is an upper bound on the infimum;
    how close depends on how smooth the costs are.

    Examples
    --------
    f = 2 x**2 + x**4 up to 3: the steepness 4 + 4 x**2 is largest at 3.

    >>> from aimd_des import PolynomialCosts
    >>> normalization_factors(PolynomialCosts([2, 4], [[[2.0, 1.0]]]), upper=[3.0]).tolist()
    [0.025]
    """
    low, high = _box(costs, lower, upper)
    # Divisions by 0 and by infinity are meant: 1 / inf is the factor 0.
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(1.0 / _largest_steepness(costs, low, high).max(axis=0))


def in_f_delta(
    costs: Costs, delta: npt.ArrayLike, upper: npt.ArrayLike, *, lower: float | npt.ArrayLike = 0.0
) -> BoolArray:
    """Tell which costs satisfy eq. (def_F_delta) over a box instead of all of R_+.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts
    >>> costs = PolynomialCosts([2], [[[1.0]], [[3.0]]])
    >>> in_f_delta(costs, delta=[0.25], upper=[10.0]).tolist()
    [True, False]
    """
    low, high = _box(costs, lower, upper)
    bound = validation.array("delta", delta, (costs.n_resources,), low=0.0, low_open=True)
    with np.errstate(divide="ignore", over="ignore"):
        flat_enough = (bound * _largest_steepness(costs, low, high) < 1.0).all(axis=1)
    return np.asarray(flat_enough if costs.proven else flat_enough & _increasing_and_convex(costs, low, high))


def _box(costs: Costs, lower: float | npt.ArrayLike, upper: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    shape = (family(costs).n_resources,)
    high = validation.array("upper", upper, shape, low=0.0, low_open=True)
    spread = lower if validation.axes(lower) else np.full(shape, validation.number("lower", lower))
    low = validation.array("lower", spread, shape, low=0.0)
    if not (low < high).all():
        raise InputError.of("lower", low.tolist(), f"below upper = {high.tolist()}")
    return low, high


def _steepness(costs: Costs, allocation: FloatArray) -> FloatArray:
    """Evaluate grad_j f_i / x^j, (n, m), and its limit where x^j = 0."""
    gradient = costs.gradient(allocation)
    steepness = np.divide(gradient, allocation, out=np.full_like(gradient, np.inf), where=allocation > 0)
    if (allocation > 0).all():
        return steepness
    own_curvature = np.einsum("ijj->ij", costs.hessian(allocation))
    return np.asarray(np.where((allocation == 0) & (gradient <= 0), own_curvature, steepness))


def _largest_steepness(costs: Costs, low: FloatArray, high: FloatArray) -> FloatArray:
    """Maximise each agent's steepness, (n, m), over the box."""
    largest = np.empty((costs.n_agents, costs.n_resources))
    corner = np.tile(high, (costs.n_agents, 1))
    at_high = _steepness(costs, corner)
    for resource in range(costs.n_resources):
        edge = corner.copy()
        edge[:, resource] = low[resource]
        largest[:, resource] = np.maximum(at_high, _steepness(costs, edge))[:, resource]
    if steepest_at_corners(costs):
        return largest
    inner = np.maximum(low, _NEAREST_ZERO * high)
    for resource in range(costs.n_resources):
        if np.isfinite(largest[:, resource]).any():
            found = _search(costs, resource, inner, high)
            largest[:, resource] = np.maximum(largest[:, resource], found)
    return largest


def _search(costs: Costs, resource: int, low: FloatArray, high: FloatArray) -> FloatArray:
    """Maximise the steepness of one resource from samples on, (n,): a compass search for all agents at once.

    Costs evaluate all agents together, so a search from agent to agent would cost n times as much.
    """
    best = np.tile(high, (costs.n_agents, 1))
    value = _steepness(costs, best)[:, resource]

    def keep_better(trial: FloatArray) -> BoolArray:
        found = _steepness(costs, trial)[:, resource]
        better = found > value
        value[better], best[better] = found[better], trial[better]
        return better

    for point in sample_box(high, _N_SAMPLES):
        keep_better(np.tile(np.maximum(point, low), (costs.n_agents, 1)))
    log_factor = np.full(costs.n_agents, np.log(_FIRST_FACTOR))
    for _ in range(_ROUNDS):
        moved = np.zeros(costs.n_agents, dtype=bool)
        for coordinate in range(costs.n_resources):
            for sign in (1.0, -1.0):
                trial = best.copy()
                trial[:, coordinate] *= np.exp(sign * log_factor)
                moved |= keep_better(np.clip(trial, low, high))
        log_factor[~moved] /= 2.0
    return value


def _increasing_and_convex(costs: Costs, low: FloatArray, high: FloatArray) -> BoolArray:
    """Look at samples of the box, (n,): derivatives positive, eigenvalues of the Hessian not negative."""
    fine = np.ones(costs.n_agents, dtype=bool)
    for point in sample_box(high - low, _N_SAMPLES):
        allocation = np.tile(low + point, (costs.n_agents, 1))
        eigenvalues = np.linalg.eigvalsh(costs.hessian(allocation))
        convex = eigenvalues[:, 0] >= -_ROUNDING * np.abs(eigenvalues).max(axis=1)
        fine &= convex & (costs.gradient(allocation) > 0).all(axis=1)
    return fine
