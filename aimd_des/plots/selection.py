"""Which agents and which samples are drawn: all are too many for the eye, and often for memory."""

import numpy as np
import numpy.typing as npt

from aimd_des.results.looks import looks
from aimd_des.results.result import Result
from aimd_des.utils.validation import FloatArray

IndexArray = npt.NDArray[np.intp]

# How many numbers a panel over time may look at: with very many agents, fewer looks are drawn.
_BUDGET = 10_000_000
_MOST_LOOKS = 200
_FEWEST_LOOKS = 12


def typical_agents(result: Result, count: int = 3) -> IndexArray:
    """Choose agents that stand for all: for each resource, spread evenly over the ranks of their averages."""
    n = result.problem.n_agents
    count = min(count, n)
    ranks = ((np.arange(count) + 0.5) / count * n).astype(np.intp)
    return np.asarray(np.argsort(result.average_at_end, axis=0, kind="stable")[ranks].T)


def few_looks(result: Result) -> IndexArray:
    """Choose the samples, spread over the logarithm of time, at which all agents can be read."""
    size = result.problem.n_agents * result.problem.n_resources
    count = int(np.clip(_BUDGET // size, _FEWEST_LOOKS, _MOST_LOOKS))
    return looks(result.observations.allocation_times, count, log=True)


def window(times: FloatArray, length: float, fewest: int = 20) -> IndexArray:
    """Choose the samples in the last units of time."""
    positions = np.flatnonzero(times >= times[-1] - length)
    if len(positions) < min(fewest, length):
        positions = np.arange(max(len(times) - int(length) - 1, 0), len(times))
    return np.asarray(positions)
