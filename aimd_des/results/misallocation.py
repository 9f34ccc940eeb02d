"""How far averages are from the optimum for what they use: the shares alone, for any use."""

import numpy as np

from aimd_des.problem.optimum import Optimum, solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.results import metrics
from aimd_des.utils.validation import FloatArray


def optimum_for_used(problem: Problem, average: FloatArray) -> Optimum | None:
    """Solve for the optimum of what averages, (n, m), use; None where they use nothing of a resource."""
    used = average.sum(axis=0)
    return solve_optimum(problem, capacity=used) if (used > 0.0).all() else None


def misallocation(problem: Problem, average: FloatArray) -> FloatArray:
    """Hold averages against the optimum for what they use, solved here, (m,): NaN where that is nothing."""
    best = optimum_for_used(problem, average)
    if best is None:
        return np.full(average.shape[1], np.nan)
    return metrics.relative_error(average, best.allocation)
