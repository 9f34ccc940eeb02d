"""What the studies share beside the paper's system: a part of it, losses that differ, and its theory."""

from dataclasses import replace
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from aimd_des import InputError, PolynomialCosts, Problem, SimulationError, solve_optimum, theory
from aimd_des.lowlevel import FloatArray
from models.smart_cameras import smart_cameras

# Elasticities of costs that are as steep as each other.
_ALIKE = 1e-6

# How closely a usable loss is found, and a threshold that is hardly below the capacity.
_HALVINGS, _HARDLY = 6, 5e-4

#: Of a single resource; the walks that it takes last tenths of a second, so what has been predicted is kept.
held = lru_cache(theory.steady_total)
#: The steady state of continuous agents; studies ask for that of one draw of the costs again and again.
predicted = lru_cache(maxsize=1024)(partial(theory.predict, dynamics="continuous"))


def spread(low: float, high: float, n: int = 60) -> FloatArray:
    """Spread values evenly over n agents, in an order that has nothing to do with their costs, (n,)."""
    return np.random.default_rng(2018).permutation(np.linspace(low, high, n))


@lru_cache
def memory_alone(n: int = 60, normalization: float = 1 / 90, draw: int = 0) -> Problem:
    """Take the memory of the paper's system of n cameras by itself: the costs do not couple resources.

    The costs are those of one draw.
    """
    full = smart_cameras(draw, n_cameras=n, normalization=normalization)
    costs = full.costs
    assert isinstance(costs, PolynomialCosts)  # noqa: S101 - the model's costs are
    return Problem(full.resources[:1], PolynomialCosts(costs.exponents, costs.coefficients[:, :1]))


def lowered(problem: Problem, threshold: float) -> Problem:
    """Make the same problem with another threshold, for all resources."""
    resources = [replace(resource, threshold=threshold) for resource in problem.resources]
    return Problem(resources, problem.costs, agent_names=problem.agent_names)


def used(problem: Problem, latency: float = 0.0) -> float:
    """Predict the mean total demand for a single resource, in its unit."""
    return float(predicted(problem, latency=latency).utilisation[0] * problem.capacity[0])


@lru_cache
def optimum(problem: Problem) -> FloatArray:
    """Compute the optimal allocation of a single resource, (n,)."""
    return np.asarray(solve_optimum(problem).allocation[:, 0])


@lru_cache
def elasticity(problem: Problem) -> FloatArray:
    """Compute how steep the costs of a single resource are at its optimum, (n,)."""
    return theory.elasticity(problem, optimum(problem)[:, None])[:, 0]


def alike(problem: Problem, steepness: float) -> list[int]:
    """List the agents whose costs have an elasticity, which is an integer but for mixtures."""
    return np.flatnonzero(np.abs(elasticity(problem) - steepness) < _ALIKE).tolist()


@lru_cache
def rate(problem: Problem) -> float:
    """Compute rho of a single resource, the signals per unit of time that hold its capacity, without loss."""
    return float(theory.needed_rate(problem)[0])


def critical(
    problem: Problem, hold_off: float, dynamics: Literal["continuous", "discrete"] = "continuous"
) -> float:
    """Compute the loss up to which demand is held; 0 where signals do not suffice even without loss."""
    return float(theory.critical_loss(rate(problem), dynamics, hold_off=hold_off))


def usable(problem: Problem, hold_off: float, latency: float = 0.0) -> float:
    """Find the loss up to which the problem's threshold is low enough for 1 % of the time above the capacity.

    By theory; 0 where it is not even without loss.
    """
    gamma = float(problem.threshold[0])
    needed = theory.needed_rate(problem, capacity=gamma * problem.capacity)
    low, high = 0.0, float(theory.critical_loss(needed, hold_off=hold_off)[0])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        try:
            safe = theory.safe_threshold(
                problem, "continuous", latency=latency, hold_off=hold_off, loss=middle
            )
            enough = float(safe[0]) >= gamma - _HARDLY
        except (InputError, SimulationError):  # so near the critical loss that signals hardly suffice
            enough = False
        low, high = (middle, high) if enough else (low, middle)
    return low
