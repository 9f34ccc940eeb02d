"""Which agents and which looks are drawn: all of them are too many for the eye, and often for memory."""

import numpy as np
import numpy.typing as npt

from aimd_des.results.result import Result
from aimd_des.utils.validation import FloatArray

__all__ = ["few_looks", "looks", "typical_agents", "window"]

IndexArray = npt.NDArray[np.intp]

# How many numbers a panel over time may look at: with very many agents, fewer looks are drawn.
_BUDGET = 10_000_000
_MOST_LOOKS = 200
_FEWEST_LOOKS = 12


def typical_agents(result: Result, count: int = 3) -> IndexArray:
    """Choose agents that stand for all: for each resource, spread evenly over the ranks of their averages.

    Parameters
    ----------
    result : Result
        The run.
    count : int
        How many for each resource; fewer where there are not so many.

    Returns
    -------
    ndarray of int, shape (m, count)
        Agents, for each resource from the least to the most that they hold.
    """
    n = result.problem.n_agents
    count = min(count, n)
    ranks = ((np.arange(count) + 0.5) / count * n).astype(np.intp)
    return np.asarray(np.argsort(result.average_at_end, axis=0, kind="stable")[ranks].T)


def looks(times: FloatArray, count: int, *, log: bool = False) -> IndexArray:
    """Choose which of the recorded looks are drawn.

    Parameters
    ----------
    times : ndarray, shape (r,)
        When looks were recorded, ascending.
    count : int
        At most how many to draw.
    log : bool
        Whether to spread them evenly over the logarithm of time, leaving out times of 0.

    Returns
    -------
    ndarray of int, shape (q,)
        Positions in `times`, ascending; the last look is always among them.
    """
    first = int(np.searchsorted(times, 0.0, side="right")) if log else 0
    kept = times[first:]
    if not kept.size:
        return np.empty(0, dtype=np.intp)
    spread = np.geomspace if log else np.linspace
    wanted = spread(kept[0], kept[-1], count)
    after = np.clip(np.searchsorted(kept, wanted), 1, max(len(kept) - 1, 1))
    after = np.minimum(after, len(kept) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(wanted - kept[before] < kept[after] - wanted, before, after)
    return np.asarray(first + np.unique(np.append(nearest, len(kept) - 1)))


def few_looks(result: Result) -> IndexArray:
    """Choose the looks, spread over the logarithm of time, at which all agents can be looked at.

    Parameters
    ----------
    result : Result
        The run.

    Returns
    -------
    ndarray of int, shape (q,)
        Positions in the times of its allocations, ascending.
    """
    size = result.problem.n_agents * result.problem.n_resources
    count = int(np.clip(_BUDGET // size, _FEWEST_LOOKS, _MOST_LOOKS))
    return looks(result.observations.allocation_times, count, log=True)


def window(times: FloatArray, length: float, fewest: int = 20) -> IndexArray:
    """Choose the looks in the last units of time.

    Parameters
    ----------
    times : ndarray, shape (r,)
        When looks were recorded, ascending.
    length : float
        How many units of time.
    fewest : int
        Where fewer looks lie in it, as without a tail in the recording, take the last `length`
        looks whenever they were.

    Returns
    -------
    ndarray of int, shape (q,)
        Positions in `times`, ascending.
    """
    positions = np.flatnonzero(times >= times[-1] - length)
    if len(positions) < min(fewest, length):
        positions = np.arange(max(len(times) - int(length) - 1, 0), len(times))
    return np.asarray(positions)
