"""The total alone, as one number: walks of it side by side, which growth raises and signals lower.

Demand is above the threshold and in units of the growth of all agents, so that a walk rises by 1 per unit of
time.  Random numbers are drawn outside, with the shape (steps, 2, walks): cuts in units of their mean, and
what is new in the slow sway of that.
"""

import numpy as np

from aimd_des.utils.jit import formula, routine
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray


@formula
def _taken(total: float, part: float) -> float:
    """Return what a signal takes of a total: at least nothing, at most all."""
    return total * min(max(part, 0.0), 1.0)


@routine
def follow_looks(
    draws: FloatArray,
    share: float,
    sways: float,
    memory: float,
    limit: float,
    period: float,
    offset: float,
    lost: float,
    first: int,
    flags: BoolArray,
    coming: IntArray,
    level: FloatArray,
    sway: FloatArray,
    signals: BoolArray,
    bottom: FloatArray,
    top: FloatArray,
    duration: FloatArray,
) -> None:
    """Sample from number `first` on; signals act `offset` units of time after the sample `lag` later."""
    # flags, (lag + 1, walks), is a ring: which signals were due; coming, (walks,), how many have not acted.
    # bottom, top, duration: (steps, 2, walks), before and after the signal; (steps, 1, walks) on the clock.
    slots, clock = flags.shape[0], bottom.shape[1] == 1
    for step in range(draws.shape[0]):
        now, then = (first + step) % slots, (first + step + 1) % slots
        for walk in range(level.shape[0]):
            due = level[walk] > 0.0
            looks = 1.0 if due or coming[walk] > 0 else np.floor(-level[walk] / period) + 1.0
            flags[now, walk] = due
            acts = flags[then, walk]
            signals[step, walk] = acts
            coming[walk] += int(due) - int(acts)
            left = peak = level[walk] + offset
            if acts:
                sway[walk] = memory * sway[walk] + draws[step, 1, walk]
                left -= _taken(limit + peak, share * (draws[step, 0, walk] + sways * sway[walk]))
            bottom[step, 0, walk] = level[walk]
            if clock:
                top[step, 0, walk], duration[step, 0, walk] = level[walk] + looks - 1.0, looks
                level[walk] = left + (lost if acts else looks)
            else:
                after = left + (looks * period - offset)
                top[step, 0, walk], duration[step, 0, walk] = peak, peak - level[walk]
                bottom[step, 1, walk], top[step, 1, walk] = left, after
                duration[step, 1, walk] = after - left
                level[walk] = after


@routine
def follow_crossings(
    draws: FloatArray,
    share: float,
    sways: float,
    memory: float,
    limit: float,
    hold_off: float,
    latency: float,
    arrivals: FloatArray,
    ends: IntArray,
    free: FloatArray,
    time: FloatArray,
    level: FloatArray,
    sway: FloatArray,
    signals: BoolArray,
    bottom: FloatArray,
    top: FloatArray,
) -> None:
    """Let signals leave, not before the hold-off ends, and act: in each walk the next of the two."""
    # arrivals, (walks, slots), is a ring: when signals act, infinite if there are none; ends, (walks, 2): the
    # slots of the next to act and of the next to leave; free: ends of hold-offs. bottom, top: (steps, walks).
    slots = arrivals.shape[1]
    for step in range(draws.shape[0]):
        for walk in range(level.shape[0]):
            leaves = max(free[walk], time[walk] + max(-level[walk], 0.0))
            arrives = arrivals[walk, ends[walk, 0]]
            acts = arrives <= leaves
            now = arrives if acts else leaves
            peak = level[walk] + (now - time[walk])
            signals[step, walk], bottom[step, walk], top[step, walk] = acts, level[walk], peak
            level[walk], time[walk] = peak, now
            if acts:
                sway[walk] = memory * sway[walk] + draws[step, 1, walk]
                level[walk] -= _taken(limit + peak, share * (draws[step, 0, walk] + sways * sway[walk]))
                arrivals[walk, ends[walk, 0]] = np.inf
                ends[walk, 0] = (ends[walk, 0] + 1) % slots
            else:
                arrivals[walk, ends[walk, 1]] = now + latency
                ends[walk, 1] = (ends[walk, 1] + 1) % slots
                free[walk] = now + hold_off
