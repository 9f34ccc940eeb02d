"""What theory has for a single resource on either side of the critical loss."""

from functools import lru_cache
from typing import Literal

import numpy as np

from aimd_des import InputError, Problem, solve_optimum, theory


@lru_cache
def rate(problem: Problem) -> float:
    """Compute rho, the signals per unit of time that hold all of the capacity, without loss."""
    alpha, beta, mu = problem.increase[0], problem.decrease[0], solve_optimum(problem).multipliers
    return float(theory.signal_rate(alpha, beta, problem.normalization, mu)[0])


def critical(
    problem: Problem, hold_off: float, dynamics: Literal["continuous", "discrete"] = "continuous"
) -> float:
    """Compute the loss up to which demand is held; 0 where signals do not suffice even without loss."""
    return float(theory.critical_loss(rate(problem), dynamics, hold_off=hold_off))


@lru_cache
def held(
    problem: Problem,
    hold_off: float,
    latency: float = 0.0,
    loss: float = 0.0,
    dynamics: Literal["continuous", "discrete"] = "continuous",
    *,
    knows_hold_off: bool = False,
) -> tuple[float, float]:
    """Predict signals per unit of time, and mean total demand over capacity; NaN where there is no formula.

    Beyond the critical loss they are those at which demand comes to rest.  Below it, `theory.predict` may
    know of the hold-off, which then lifts what is used.
    """
    given: dict[str, float] = {"hold_off": hold_off} if knows_hold_off else {}
    if loss < critical(problem, hold_off, dynamics):
        try:
            expected = theory.predict(problem, dynamics, latency=latency, loss=loss, **given)
        except InputError:  # so near the critical loss that signals do not suffice after all
            return np.nan, np.nan
        if expected.signals[0] * hold_off >= 1.0:
            return np.nan, np.nan
        return float(expected.signals[0]), float(expected.utilisation[0])
    alpha, beta, gamma = problem.increase[0], problem.decrease[0], problem.normalization
    mu = theory.runaway_multiplier(alpha, beta, gamma, loss, dynamics, hold_off=hold_off)
    level = theory.allocation_at(problem, mu)
    cut_off = (gamma * mu / level > 1.0).any()  # responses at probability 1
    return 1.0 / hold_off, np.nan if cut_off else float(level.sum() / problem.capacity[0])
