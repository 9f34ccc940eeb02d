"""How far averages are from the optimum for what they use: the shares alone, whatever is used."""

import numpy as np

from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.results import metrics
from aimd_des.utils.validation import FloatArray


def misallocation(problem: Problem, average: FloatArray) -> FloatArray:
    """Hold averages against the optimum for what they use, solved here, (m,): NaN where that is nothing."""
    used = average.sum(axis=0)
    if not (used > 0.0).all():
        return np.full(len(used), np.nan)
    return metrics.relative_error(average, solve_optimum(problem, capacity=used).allocation)
