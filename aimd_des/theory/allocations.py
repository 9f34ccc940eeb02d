"""Allocations that theory points to: optima of weighted costs, and points with given derivatives."""

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs import Costs, weighted_costs
from aimd_des.problem.optimum import Optimum, solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import FloatArray

# After the doublings the solution lies in the upper half of its interval, or below the start; so many
# halvings reach the rounding of that.
_DOUBLINGS = 1000
_HALVINGS = 60
_SWEEPS = 500


def reweighted_optimum(
    problem: Problem, weights: npt.ArrayLike, *, capacity: npt.ArrayLike | None = None
) -> Optimum:
    r"""Minimise the weighted sum of costs.

    .. math::

        \min_x \sum_i w_i f_i(x_i)

    Parameters
    ----------
    problem : Problem
        The agents' costs and the capacities.
    weights : array_like, shape (n,) or (n, m)
        w_i > 0, as from `loss_weights`; with alpha and beta that differ from agent to agent multiply by
        (1 - beta_i) / alpha_i.  One for each resource too if the costs are `PolynomialCosts`.
    capacity : array_like, shape (m,), optional
        Capacities > 0 to use instead of the problem's: the totals of the averages in a run.

    Returns
    -------
    Optimum
        Its multipliers are the weighted derivatives that agents have in common, its cost is the
        weighted one.

    Raises
    ------
    InputError
        If weights or capacities have another shape or are not positive, or weights differ from
        resource to resource for other costs.
    SimulationError
        If no optimum is found.

    Examples
    --------
    A camera that loses half of its signals takes twice the share, if costs are quadratic:

    >>> from aimd_des import PolynomialCosts
    >>> from aimd_des.problem import Resource
    >>> from aimd_des.theory import loss_weights
    >>> memory = Resource("memory", capacity=3.0, increase=0.01, decrease=0.5, normalization=0.01)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]], [[1.0]]]))
    >>> reweighted_optimum(problem, loss_weights([0.5, 0.0])).allocation.round(6).tolist()
    [[2.0], [1.0]]
    """
    validation.instance("problem", problem, Problem, "a Problem")
    costs = weighted_costs(problem.costs, weights)
    weighted = Problem(problem.resources, costs, agent_names=problem.agent_names)
    return solve_optimum(weighted, capacity=capacity)


def allocation_at(problem: Problem, multipliers: npt.ArrayLike) -> FloatArray:
    """Find what agents hold where their derivatives have given values.

    Parameters
    ----------
    problem : Problem
        The agents' costs; its capacities only set the scale of the search.
    multipliers : array_like, shape (m,)
        mu > 0, in units of cost per unit of the resource.

    Returns
    -------
    ndarray, shape (n, m)
        x with grad_j f_i(x_i) = mu_j, in units of the resources, or next to 0 where the derivative is
        larger even there.  Column sums are the total demand.

    Raises
    ------
    InputError
        If multipliers have another shape or are not positive, or a derivative never reaches its own.
    SimulationError
        If coupled costs do not come to rest.

    Notes
    -----
    Minimises f_i(x) - mu . x, one resource after the other, by bisection of the derivative for all
    agents at once; costs that couple resources need several sweeps.
    """
    validation.instance("problem", problem, Problem, "a Problem")
    wanted = validation.array("multipliers", multipliers, (problem.n_resources,), low=0.0, low_open=True)
    costs = problem.costs
    allocation = np.tile(problem.capacity / problem.n_agents, (problem.n_agents, 1))
    for _ in range(_SWEEPS):
        before = allocation.copy()
        for resource in range(problem.n_resources):
            slope = partial(_slope, costs, allocation, resource)
            allocation[:, resource] = solve_increasing(
                slope, float(wanted[resource]), allocation[:, resource]
            )
        moved = np.abs(allocation - before).max(axis=0)
        if costs.separable or (moved <= 1e-12 * allocation.max(axis=0)).all():
            return allocation
    raise SimulationError(
        f"no allocation found with derivatives {wanted.tolist()} after {_SWEEPS} sweeps: check that the costs"
        " are strictly convex"
    )


def _slope(costs: Costs, allocation: FloatArray, resource: int, column: FloatArray) -> FloatArray:
    """Evaluate the derivative by one resource where agents hold `column` of it, (n,) -> (n,)."""
    trial = allocation.copy()
    trial[:, resource] = column
    return costs.gradient(trial)[:, resource]


def solve_increasing(
    slope: Callable[[FloatArray], FloatArray], wanted: float, start: FloatArray
) -> FloatArray:
    """Solve slope(x) = wanted for all agents at once; slopes do not decrease."""
    high = start.copy()
    # Steep costs may overflow on the way up: an infinite slope is high enough.
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            short = slope(high) < wanted
            if not short.any():
                break
            high[short] *= 2.0
        else:
            agent = int(np.argmax(short))
            raise InputError.of(
                "multipliers", wanted, f"reached by the derivatives; that of agent {agent} stays below"
            )
        low = np.zeros_like(high)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            above = slope(middle) >= wanted
            high, low = np.where(above, middle, high), np.where(above, low, middle)
    return high
