"""The discrete-step algorithm as a NumPy loop: a Python loop over steps, arrays over agents."""

import numpy as np

from aimd_des import Problem
from benchmarks.harness import FloatArray, IntArray

__all__ = ["run"]


def run(problem: Problem, slopes: FloatArray, steps: int, seed: int) -> tuple[IntArray, FloatArray]:
    """Return the number of capacity events, shape (m,), and the averages over x(0)..x(K), (n, m).

    `slopes` are the derivatives' coefficients, (terms, n, m), lowest power first.
    """
    rng = np.random.default_rng(seed)
    n, m = problem.n_agents, problem.n_resources
    limit, normalization = problem.limit, problem.normalization
    # A row per resource: what is done for one resource is done on contiguous memory.
    increase, decrease = np.ascontiguousarray(problem.increase.T), np.ascontiguousarray(problem.decrease.T)
    slopes = np.ascontiguousarray(slopes.transpose(2, 0, 1))
    demand, average = np.zeros((m, n)), np.zeros((m, n))
    signal, signals = np.zeros(m, dtype=bool), np.zeros(m, dtype=np.int64)

    for k in range(steps):
        excess = demand.sum(axis=1) > limit
        signals += excess
        for j in range(m):
            if signal[j]:
                gradient = slopes[j, -1]
                for coefficients in slopes[j, -2::-1]:
                    gradient = gradient * average[j] + coefficients
                responds = rng.random(n) < normalization[j] * gradient / average[j]
                np.multiply(demand[j], decrease[j], out=demand[j], where=responds)
            else:
                demand[j] += increase[j]
        average += (demand - average) / (k + 2)
        signal = excess
    return signals, average.T
