"""The measures that a run is judged by: pure functions of averages, optimum and capacities."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aimd_des.problem.costs import Costs
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray


@dataclass(frozen=True, eq=False)
class Overshoot:
    """How far total demand went beyond capacity."""

    # (m,): highest total demand over the capacity; 1.05 is 5 % above.  What it is for no time, between two
    # events of one instant, does not count.
    peak: FloatArray
    time: FloatArray  # (m,): share of time with total demand above capacity
    mean: FloatArray  # (m,): time average of what exceeds the capacity, over the capacity


@dataclass(frozen=True, eq=False)
class Stretch:
    """What total demand did over a stretch of time with one capacity; arrays have shape (m,)."""

    # From when to when.
    start: float
    end: float
    capacity: FloatArray  # C, in units of the resources
    peak: FloatArray  # highest total demand, in units of the resources
    above: FloatArray  # for how long it was above capacity
    # Integrals of what exceeded it, and of all, in units of the resources times time.
    excess: FloatArray
    used: FloatArray

    def overshoot(self) -> Overshoot:
        """Measure this stretch alone."""
        length = self.end - self.start
        return Overshoot(self.peak / self.capacity, self.above / length, self.excess / length / self.capacity)


def load_of(stretches: Sequence[Stretch]) -> FloatArray:
    """Integrate total demand over the capacity in force."""
    return np.asarray(np.sum([part.used / part.capacity for part in stretches], axis=0))


def overshoot_of(stretches: Sequence[Stretch]) -> Overshoot:
    """Put the overshoot of several stretches together."""
    length = stretches[-1].end - stretches[0].start
    peak, above, mean = np.zeros((3, len(stretches[0].capacity)))
    for part in stretches:
        peak = np.maximum(peak, part.peak / part.capacity)
        above += part.above
        mean += part.excess / length / part.capacity
    return Overshoot(peak, above / length, mean)


def joined(one: Stretch, other: Stretch) -> Stretch:
    """Put a stretch and the next one together, whose capacity is the same."""
    peak = np.maximum(one.peak, other.peak)
    sums = (getattr(one, name) + getattr(other, name) for name in ("above", "excess", "used"))
    return Stretch(one.start, other.end, one.capacity, peak, *sums)


@formula
def fold_total(
    resource: int,
    total: float,
    capacity: FloatArray,
    duration: float,
    peak: FloatArray,
    above: FloatArray,
    excess: FloatArray,
    used: FloatArray,
) -> None:
    """Fold in an interval over which total demand for one resource was constant."""
    j = resource
    peak[j] = max(peak[j], total)
    used[j] += total * duration
    over = total - capacity[j]
    if over > 0.0:
        above[j] += duration
        excess[j] += over * duration


@kernel
def fold_overshoot(
    total: FloatArray,
    capacity: FloatArray,
    duration: float,
    peak: FloatArray,
    above: FloatArray,
    excess: FloatArray,
    used: FloatArray,
) -> None:
    """Fold in an interval over which total demand was constant."""
    for j in range(capacity.shape[0]):
        fold_total(j, total[j], capacity, duration, peak, above, excess, used)


def relative_error(average: FloatArray, optimum: FloatArray) -> FloatArray:
    """Compute ``sum_i |x-bar_i - x*_i| / sum_i x*_i`` for each resource (the paper, section V).

    Parameters
    ----------
    average, optimum : ndarray, shape (..., n, m)
        Averages and optimal allocations, in units of the resources.

    Returns
    -------
    ndarray, shape (..., m)
        A pure number.  Against the optimum for the capacities actually used it is called misallocation.
    """
    return np.asarray(np.abs(average - optimum).sum(axis=-2) / optimum.sum(axis=-2))


def utilisation(average: FloatArray, capacity: FloatArray) -> FloatArray:
    """Compute ``sum_i x-bar_i^j / C^j``.

    Parameters
    ----------
    average : ndarray, shape (..., n, m)
        Averages, in units of the resources.
    capacity : ndarray, shape (m,)
        Capacities, in units of the resources.

    Returns
    -------
    ndarray, shape (..., m)
        A pure number; NaN where there is no agent.
    """
    if not average.shape[-2]:
        return np.full((*average.shape[:-2], len(capacity)), np.nan)
    return np.asarray(average.sum(axis=-2) / capacity)


def consensus_spread(costs: Costs, average: FloatArray) -> FloatArray:
    """Compute the standard deviation of grad_j f_i(x-bar_i) across agents over its mean.

    Parameters
    ----------
    costs : Costs
        The private costs.
    average : ndarray, shape (n, m)
        Averages, in units of the resources.

    Returns
    -------
    ndarray, shape (m,)
        0 where all derivatives agree, as they do at an optimum with no bound active: eq. (optimality).
    """
    gradient = costs.gradient(average)
    mean = gradient.mean(axis=0)
    return np.asarray(np.divide(gradient.std(axis=0), mean, out=np.zeros_like(mean), where=mean > 0))


def cost_ratio(costs: Costs, average: FloatArray, optimum: FloatArray) -> float:
    """Compute ``sum_i f_i(x-bar_i) / sum_i f_i(x*_i)`` (the paper, section V).

    Parameters
    ----------
    costs : Costs
        The private costs.
    average, optimum : ndarray, shape (n, m)
        Averages and optimal allocations, in units of the resources.

    Returns
    -------
    float
        Below 1 where the averages do not use up the capacities.
    """
    return float(costs.value(average).sum() / costs.value(optimum).sum())
