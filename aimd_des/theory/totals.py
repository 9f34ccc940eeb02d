r"""The total alone: all demand as one number that growth raises and random cuts lower.

Whether total demand exceeds the capacity is decided by its peaks, and those by three things: how far it grows
until a signal acts, how often one cut is not enough, and which signals are on their way meanwhile.  None
of them depends on what each agent holds.  In units of the growth of all agents, g = sum_i alpha_i, with W the
total above its threshold,

    W grows by 1 per unit of time;  a signal takes X = c (threshold C / g + W) (1 + v Z)

with c the share of the total that a signal takes in the mean, v its coefficient of variation, and Z a gamma
variate of mean 0, variance 1 and the right skewness; to which comes a slow sway of c, as for a while the
agents that hold much are those that answer often.  Many such walks are followed side by side, always with the
same random numbers, so that the results are nearly a smooth function of the arguments.
"""

import math
from typing import NamedTuple

import numpy as np

from aimd_des.dynamics.total_walks import follow_crossings, follow_looks
from aimd_des.utils.validation import BoolArray, FloatArray

# 200 walks with 300 signals each, besides those on the way to the steady state: the share of time above a
# level, where it is 1 %, comes out with a standard error of 2 to 3 % of itself.
_WALKS = 200
_SIGNALS = 300
_SETTLING = 60
_HALVINGS = 50
_LONG_RUN = 10
# Steps whose random numbers are drawn at once.
_BATCH = 256


class Cuts(NamedTuple):
    """What a signal takes of one resource."""

    share: float  # mean, as a share of the total that the signal finds
    # Coefficient of variation, and third central moment over the cube of the standard deviation.
    variation: float
    skewness: float
    # Coefficient of variation of the mean as the holdings of agents change, and how much of that is left at
    # the next signal.
    sway: float = 0.0
    memory: float = 0.0


class Levels(NamedTuple):
    """Where the total was: pieces of a line, or of a stair if `bottom` and `top` are the same."""

    # (q,): both ends of each piece above the threshold, in units of growth.
    bottom: FloatArray
    top: FloatArray
    duration: FloatArray  # (q,): how long each took
    found: float  # mean of the total at the signals that act, in units of growth above the threshold

    @property
    def mean(self) -> float:
        """Mean over time, in units of growth above the threshold."""
        middle = 0.5 * (self.bottom + self.top)
        return float((middle * self.duration).sum() / self.duration.sum())

    def time_above(self, level: float) -> float:
        """Share of time above a level."""
        return _time_above(self, level) / float(self.duration.sum())

    def level_exceeded(self, share: float) -> float:
        """Find the level that is exceeded for a given share of the time."""
        wanted, pieces = share * float(self.duration.sum()), self
        low, high = float(self.bottom.min()), float(self.top.max())
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _time_above(pieces, middle) > wanted:
                low = middle
                reach = pieces.top > low  # the others are below all that come
                bottom, top, duration, found = pieces
                pieces = Levels(bottom[reach], top[reach], duration[reach], found)
            else:
                high = middle
        return high


def _time_above(pieces: Levels, level: float) -> float:
    length = pieces.top - pieces.bottom
    part = np.clip(pieces.top - level, 0.0, length) / np.where(length > 0.0, length, 1.0)
    part = np.where(length > 0.0, part, pieces.top > level)
    return float((part * pieces.duration).sum())


def cuts(found: FloatArray, keep: FloatArray, hit: FloatArray) -> list[Cuts]:
    """Compute the moments of what a signal takes that cuts the part `keep` with the probability `hit`.

    Notes
    -----
    Responses are independent, so variances d^2 q (1 - q) E y^2 and third moments d^3 q (1 - q) (1 - 2 q)
    E y^3 add up. Here y is the demand at a signal, d the part and q the probability, 1 - beta and (1 - p)
    lambda by the paper's rule; kappa = d q.  E y^2 = (E y)^2 (2 - kappa) / (2 - d) is exact for evenly
    spaced signals; E y^3 is that of a gamma variate with this second moment.  The present demand of
    agents changes the mean of the next cuts by sum_i (kappa_i - c) (y_i - E y_i), with c the mean of the
    kappa_i. Agents forget it at the rate c per signal.
    """
    square = (2.0 - keep * hit) / (2.0 - keep)  # E y^2 / (E y)^2
    mean = (keep * hit * found).sum(axis=0)
    one = keep * found
    variance = (one**2 * hit * (1.0 - hit) * square).sum(axis=0)
    third = (one**3 * hit * (1.0 - hit) * (1.0 - 2.0 * hit) * square * (2.0 * square - 1.0)).sum(axis=0)
    skewness = third / np.where(variance > 0.0, variance, 1.0) ** 1.5
    kappa, part = keep * hit, found / found.sum(axis=0)
    share = (kappa * part).sum(axis=0)
    sway = (((kappa / share - 1.0) * part) ** 2 * np.maximum(square - 1.0, 0.0)).sum(axis=0)
    columns = np.array([share, np.sqrt(variance) / mean, skewness, np.sqrt(sway), 1.0 - share])
    return [Cuts(*row) for row in columns.T.tolist()]


def walk_by_looks(
    limit: float, law: Cuts, period: float, latency: float, lost: float | None = None
) -> Levels:
    """Follow the total under a control unit that samples once a period.

    Notes
    -----
    Samples that find no crossing while no signal is on its way are taken at once.  On the clock they are a
    stair, which then counts as the line with the same mean.
    """
    clock = lost is not None
    lag = max(math.ceil(latency / period) - (0 if clock else 1), 0)
    draws = _Draws(law)
    level = -draws.rng.random(_WALKS) * period
    flags, coming = np.zeros((lag + 1, _WALKS), dtype=bool), np.zeros(_WALKS, dtype=np.int64)
    # After a look that many more units of growth until the signal of `lag` looks ago acts.
    offset = 0.0 if clock else latency - lag * period
    # Looks with signals come in runs that are longer than the lag; of long ones fewer will do.
    least = 1 + min(lag, _LONG_RUN) + max(lag - _LONG_RUN, 0) / _LONG_RUN
    looks, settled = int((_SIGNALS + _SETTLING) * (1 + least)), math.ceil(_SETTLING * (1 + least))
    bottom, top, duration = np.empty((3, looks, 1 if clock else 2, _WALKS))
    acts = np.empty((looks, _WALKS), dtype=bool)
    for some in _batches(looks):
        follow_looks(
            draws.of(some),
            law.share,
            law.sway,
            law.memory,
            limit,
            period,
            offset,
            lost or 0.0,
            some.start,
            flags,
            coming,
            level,
            draws.sway,
            acts[some],
            bottom[some],
            top[some],
            duration[some],
        )
    bottom, top, duration, acts = bottom[settled:], top[settled:], duration[settled:], acts[settled:]
    found = _mean_found((bottom if clock else top)[:, 0], acts)
    return Levels(bottom.ravel(), top.ravel(), duration.ravel(), found)


def walk_by_crossings(limit: float, law: Cuts, hold_off: float, latency: float) -> Levels:
    """Follow the total of continuous agents under a control unit that senses crossings."""
    draws = _Draws(law)
    level, time, free = -draws.rng.random(_WALKS), np.zeros(_WALKS), np.zeros(_WALKS)
    slots = int(latency / hold_off) + 2 if latency > 0.0 else 1
    arrivals, ends = np.full((_WALKS, slots), math.inf), np.zeros((_WALKS, 2), dtype=np.int64)
    events, settled = 2 * (_SIGNALS + _SETTLING), 2 * _SETTLING
    bottom, top = np.empty((2, events, _WALKS))
    acts = np.empty((events, _WALKS), dtype=bool)
    for some in _batches(events):
        follow_crossings(
            draws.of(some),
            law.share,
            law.sway,
            law.memory,
            limit,
            hold_off,
            latency,
            arrivals,
            ends,
            free,
            time,
            level,
            draws.sway,
            acts[some],
            bottom[some],
            top[some],
        )
    bottom, top = bottom[settled:], top[settled:]
    found = _mean_found(top, acts[settled:])
    bottom, top = bottom.ravel(), top.ravel()
    return Levels(bottom, top, top - bottom, found)


def _batches(steps: int) -> list[slice]:
    """Cut a walk into parts whose draws fit into the cache of a processor."""
    return [slice(first, min(first + _BATCH, steps)) for first in range(0, steps, _BATCH)]


def _mean_found(peaks: FloatArray, acts: BoolArray) -> float:
    """Average the total over the signals that act."""
    total = 0.0
    for peak, there in zip(peaks, acts, strict=True):
        total += float(peak[there].sum())
    return total / max(int(acts.sum()), 1)


class _Draws:
    """Draws what signals take, for all walks at once."""

    def __init__(self, law: Cuts) -> None:
        self.law = law
        self.rng = np.random.default_rng(0)
        self.sway = self.rng.standard_normal(_WALKS)

    def of(self, steps: slice) -> FloatArray:
        """Draw, (steps, 2, walks), cuts without the sway in units of their mean, and what is new in it."""
        law, draws = self.law, np.empty((steps.stop - steps.start, 2, _WALKS))
        standard, fresh = draws[:, 0], draws[:, 1]
        if abs(law.skewness) < 1e-3:
            self.rng.standard_normal(out=draws)
        else:
            shape = 4.0 / law.skewness**2
            for row in draws:
                self.rng.standard_gamma(shape, out=row[0])
                self.rng.standard_normal(out=row[1])
            standard -= shape
            standard *= math.copysign(1.0, law.skewness) / math.sqrt(shape)
        standard *= law.variation
        standard += 1.0
        fresh *= math.sqrt(1.0 - law.memory**2)
        return draws
