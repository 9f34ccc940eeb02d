r"""The way of the averages from demand 0 on where signals come late: the first swings, step by step.

From demand 0 on total demand passes its threshold and goes on growing until the first signals act, then falls
far below it.  What averages are off by after these swings decays with the exponents, and lasts where these
are small.  So the mean dynamics are followed here as agents on the clock without draws carry them out,

    x <- x + alpha  where no signal acts,   x <- (1 - kappa) x + p alpha  where one does,

with kappa at the averages that agents have by then.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aimd_des.theory.prediction import Steady
from aimd_des.theory.setting import Setting
from aimd_des.utils.validation import FloatArray

# kappa is computed anew after one step, and later after this part of the age of the run.
_ANEW = 64


class _Memory(Protocol):
    """What has to be known of a way of averaging."""

    def rate(self, age: FloatArray | float) -> FloatArray: ...

    def age(self, turns: float) -> float: ...


@dataclass(frozen=True, eq=False)
class FirstSwings:
    """Averages step by step, by the turns of their memory, and where they are at the end."""

    memory: _Memory
    averages: FloatArray  # (steps, n, m)
    middle: float  # the time at which averages are in the mean over the last swing
    state: FloatArray  # (2, n, m): averages, and those of what signals find, in the mean over the last swing

    def __call__(self, turn: float) -> FloatArray:
        """Give the averages at a turn, (1, n, m): between steps on a line."""
        last = len(self.averages) - 1
        time = min(self.memory.age(turn), float(last))
        step = min(int(time), last - 1)
        before, after = self.averages[step], self.averages[step + 1]
        return np.asarray((before + (time - step) * (after - before))[None])


def follow_first_swings(
    setting: Setting,
    steady: Steady,
    memory: _Memory,
    kappa: Callable[[FloatArray, FloatArray], FloatArray],
    lag: int,
    steps: int,
) -> FirstSwings:
    """Follow all agents from demand 0 on; `kappa` of averages, and of averages of what signals find."""
    growth, limit, less = setting.problem.increase, setting.problem.limit, 1.0 - setting.loss
    demand = average = np.zeros_like(growth)
    divisor = growth.copy()
    signals, count = np.zeros((steps + lag, growth.shape[1])), np.zeros(growth.shape[1])
    averages, divisors = np.empty((2, steps, *growth.shape))
    anew, taken = 0, np.zeros_like(growth)
    for step in range(steps):
        average = average + np.minimum(memory.rate(step + 1.0), 1.0) * (demand - average)
        signals[step + lag] = demand.sum(axis=0) > limit
        acts = signals[step]
        if acts.any():
            count += acts
            # As often renewed as an average over time of the age at which there are so many signals.
            weight = np.minimum(memory.rate(np.maximum(count, 1.0) / steady.signals) / steady.signals, 1.0)
            divisor = divisor + acts * weight * (demand - divisor)
            if step >= anew:
                taken, anew = kappa(average, divisor), step + 1 + step // _ANEW
        averages[step], divisors[step] = average, divisor
        demand = demand + growth - acts * (taken * demand + less * growth)
    swing = min(round((lag + 1) / float(steady.signals.min())), steps)
    state = np.stack([part[-swing:].mean(axis=0) for part in (averages, divisors)])
    return FirstSwings(memory, averages, steps - 0.5 * (swing + 1), state)
