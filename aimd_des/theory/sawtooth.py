r"""What averages have of the present period of the sawtooth: the floor of the error of runs without draws.

The sum of an agent's deviations from its mean demand stays bounded, and an average that gives the newest
instant the weight w is off by w times this sum.  The weight is a / t with the gain a: no error falls faster.

Where crossings signal at once, all periods T are alike.  Demand falls by h at a signal, and after the part u
of the period the sum is h T (u (u - 1) / 2 + 1 / 12), with the root mean square h T / sqrt(720).  On a clock
periods are whole numbers of steps, and the sums are larger: they are followed step by step.

Demand answers to averages, which adds to this and is left out: measured floors are up to twice as high.
"""

import math
from typing import NamedTuple

import numpy as np

from aimd_des.dynamics.responses import DRAWN, FRACTIONAL, FULL
from aimd_des.problem.optimum.nearby_optima import optimal_allocations
from aimd_des.theory.mean_dynamics import Memory
from aimd_des.theory.prediction import Steady
from aimd_des.theory.setting import Setting
from aimd_des.theory.sways import follow_sums
from aimd_des.utils.validation import FloatArray

_ROOT_MEAN_SQUARE = 1.0 / math.sqrt(720.0)
# Relative change of the totals by which the answer of the optimum to them is found.
_MORE = 1e-4


class Sawtooth(NamedTuple):
    """Sums of deviations of demand from its mean."""

    sums: FloatArray  # (r, n, m): r independent parts, whose squares add up to the mean square
    beside: FloatArray  # the same, less what the optimum has of their total
    together: bool  # whether all agents have one phase; else each has its own

    def covariance(self, memory: Memory, time: float, used: bool) -> tuple[FloatArray, FloatArray | float]:
        """Compute the variance of averages, (n, m), and the covariances between agents, (m, n, n).

        `used` says that distances are from the optimum for what is used, which a common sum changes.
        """
        off = _newest(memory, time) * (self.beside if used else self.sums)
        own = np.asarray((off**2).sum(axis=0))
        if not self.together:
            return own, 0.0
        common = np.einsum("rij,rkj->jik", off, off)
        np.einsum("jii->ji", common)[...] = 0.0
        return own, np.asarray(common)


def sawtooth(setting: Setting, steady: Steady) -> Sawtooth:
    """Follow the sums of all agents."""
    sums, together = sums_of_deviations(setting, steady), setting.response.cut == FRACTIONAL
    if not together:
        return Sawtooth(sums, sums, together)
    totals = steady.average.sum(axis=0)
    steps = totals * np.array([[1.0 - _MORE], [1.0 + _MORE]])
    less, more = optimal_allocations(setting.problem, steps)
    part = (more - less) / (2.0 * _MORE * totals)
    return Sawtooth(sums, sums - part * sums.sum(axis=1, keepdims=True), together)


def sums_of_deviations(setting: Setting, steady: Steady) -> FloatArray:
    """Compute independent parts of the sums, (r, n, m): their squares add up to the mean square.

    They are 0 where agents draw: what their own cuts leave is part of the noise.
    """
    cut = setting.response.cut
    if cut == DRAWN:
        return np.zeros((1, *steady.found.shape))
    if cut == FULL:  # each agent has a period of its own
        return np.asarray(_ROOT_MEAN_SQUARE * steady.keep * steady.found / (steady.signals * steady.hit))[
            None
        ]
    if setting.discrete:
        return follow_sums(setting, steady, math.ceil(setting.latency))
    return np.asarray(_ROOT_MEAN_SQUARE * steady.keep * steady.hit * steady.found / steady.signals)[None]


def _newest(memory: Memory, time: float) -> float:
    """Weigh the newest instant; a window is off by what it has at both of its ends."""
    if memory.time_constant is not None:
        return 1.0 / memory.time_constant
    if memory.window is not None and time > memory.window:
        return math.sqrt(2.0) / memory.window
    return memory.gain / time
