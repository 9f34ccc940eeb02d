r"""How averages move in the mean: the balance of growth and cuts on the way to where they settle.

A signal that is sent takes kappa_i y_i of agent i in the mean, y_i being the demand that signals find.  As
all y_i add up to the same total, signals come at the rate sigma that lets growth make up for cuts,

    dy_i / dt = alpha_i - sigma kappa_i y_i,   sigma = sum alpha / sum(kappa y),   kappa = kappa(averages),

(on the clock alpha_i counts in steps without a received signal only), and averages follow at the rate r(t) of
their averaging: 1 / t over all of the past, a / t with the gain a, 1 / tau with forgetting,

    d theta_i / dt = r (y_i - h_i - theta_i),

h_i being half the height of the sawtooth.  Once the run is much older than the time x / alpha in which agents
find new shares, y is what the balance makes it for the averages at hand, and only these are followed.  Where
signals come late the way begins with swings that are no balance: `first_swings` follows them step by step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from aimd_des.dynamics.responses import AT_CUTS, AT_SIGNALS
from aimd_des.theory.first_swings import follow_first_swings
from aimd_des.theory.prediction import Steady, found_by_signals
from aimd_des.theory.response_rule import chance
from aimd_des.theory.setting import Setting
from aimd_des.theory.trajectory import Slope, Trajectory
from aimd_des.utils.validation import BoolArray, FloatArray

# In multiples of the time until all capacities are reached.
_SETTLED = 20.0
# The same for what is followed by steps, and the lag up to which that is not necessary.
_FOLLOWED, _AT_ONCE = 40.0, 1
# Turns of the averages after which nothing moves any more.
_ENDLESS = 500.0
# Just after the first signal the average over signals would follow it at any rate.
_NOT_YET = 0.05

# The state of averages by their turns; averages come first.
Way = Callable[[float], FloatArray]


class Memory(NamedTuple):
    """What theory has to know of a way of averaging."""

    gain: float = 1.0  # a of averages that follow at the rate a / t
    time_constant: float | None = None  # tau of averages that forget
    window: float | None = None  # W of averages over a window

    def rate(self, age: FloatArray | float) -> FloatArray:
        """Return at what rate averages of this age follow demand."""
        past = np.asarray(age)
        if self.time_constant is not None:
            return np.asarray(-1.0 / (np.expm1(-past / self.time_constant) * self.time_constant))
        if self.window is not None:
            return np.where(past > self.window, 2.0 / self.window, 1.0 / past)  # as fast in the mean
        return np.asarray(self.gain / past)

    def turns(self, age: FloatArray | float) -> FloatArray:
        """Integrate the rate: how often an average of this age has been renewed, but for a constant."""
        if self.time_constant is not None:
            past = np.asarray(age) / self.time_constant
            return np.asarray(past + np.log(-np.expm1(-past)))
        if self.window is not None:
            full = np.minimum(age, self.window)
            return np.asarray(np.log(full) + 2.0 * (age - full) / self.window)
        return np.asarray(self.gain * np.log(age))

    def age(self, turns: float) -> float:
        """Return the age at which an average has been renewed so often."""
        if self.time_constant is not None:
            return float(self.time_constant * np.logaddexp(0.0, turns))
        if self.window is not None:
            beyond = max(turns - np.log(self.window), 0.0)
            return float(np.exp(turns - beyond) + 0.5 * beyond * self.window)
        return float(np.exp(turns / self.gain))


def first_signals(setting: Setting, steady: Steady) -> FloatArray:
    """Compute when each total is reached for the first time, (m,)."""
    return np.asarray(steady.found.sum(axis=0) / setting.problem.increase.sum(axis=0))


class Origin(NamedTuple):
    """Where a path begins, if not from nothing."""

    time: float
    state: FloatArray  # (3, n, m): averages, what signals find, and the average of that
    joined: FloatArray  # (n, 1): since when there are agents


@dataclass(frozen=True, eq=False)
class MeanPath:
    """Averages over time in the mean, from demand 0 or another origin on."""

    setting: Setting  # what a prediction is asked for
    steady: Steady  # where averages settle
    memory: Memory  # how agents average
    origin: Origin | None = None  # what is known of all agents at a time

    @cached_property
    def joined(self) -> FloatArray:
        """Since when there are agents, shape (n, 1)."""
        return np.zeros((self.setting.problem.n_agents, 1)) if self.origin is None else self.origin.joined

    @cached_property
    def _growth(self) -> FloatArray:
        return np.asarray(self.setting.problem.increase.sum(axis=0))

    @cached_property
    def _held_back(self) -> FloatArray | float:
        """Growth that a signal costs on the clock besides its cut, (n, m)."""
        return self.setting.problem.increase * (1.0 - self.setting.loss) if self.setting.discrete else 0.0

    @cached_property
    def _largest_cut(self) -> FloatArray:
        """Mean part of its demand that a signal takes of an agent that answers for certain, (n, m)."""
        return np.asarray((1.0 - self.setting.problem.decrease) * (1.0 - self.setting.loss))

    @cached_property
    def _settled_tooth(self) -> FloatArray:
        return self.steady.found - self.steady.average

    @cached_property
    def starts(self) -> FloatArray:
        """When each total is reached for the first time from the origin on, shape (m,)."""
        if self.origin is None:
            return first_signals(self.setting, self.steady)
        missing = self.steady.found.sum(axis=0) - self.origin.state[1].sum(axis=0)
        growing = self.setting.problem.increase.sum(axis=0)
        return np.asarray(self.origin.time + np.maximum(missing, 0.0) / growing)

    def at(self, times: FloatArray) -> FloatArray:
        """Compute the averages at times from the origin on, (k,) -> (k, n, m)."""
        return np.stack([self._average(time) for time in times.tolist()])

    def _average(self, time: float) -> FloatArray:
        begin = self._stages[0][0]
        if time < begin and self.origin is None:
            return np.asarray(self._ramp(time) * self.setting.problem.increase)
        stages = [stage for stage in self._stages if stage[0] <= max(time, begin)]
        first, way = stages[-1]
        start = float(self.memory.turns(first))
        turn = float(self.memory.turns(max(time, begin)))
        averages: FloatArray = way(min(max(turn, start), start + _ENDLESS))[0]
        return averages

    @cached_property
    def _lag(self) -> int:
        """After how many steps a signal acts on the clock."""
        return math.ceil(self.setting.latency) if self.setting.discrete else 0

    def _from_first_swings(self) -> list[tuple[float, Way]]:
        """Follow the first swings of a late system by steps, and go on from where they have led."""
        steps = math.ceil(_FOLLOWED * float(self.starts.max()))
        parts = self.setting, self.steady, self.memory, self._kappa, self._lag, steps
        swings = follow_first_swings(*parts)
        slope, middle = self._by_turns(self._slow), float(self.memory.turns(swings.middle))
        return [(float(self.starts.min()), swings), (steps - 1.0, Trajectory(slope, middle, swings.state))]

    @cached_property
    def _stages(self) -> list[tuple[float, Way]]:
        """The ways between the times at which something begins, each with the time where it begins."""
        if self.origin is None and self._lag > _AT_ONCE:
            return self._from_first_swings()
        if self.origin is None:
            begin, change = float(self.starts.min()), _SETTLED * float(self.starts.max())
            first = self.setting.problem.increase * begin
            state = np.stack([self._ramp(begin) * self.setting.problem.increase, first, first])
        else:
            begin, state = self.origin.time, self.origin.state
            change = begin + _SETTLED * float(first_signals(self.setting, self.steady).max())
        stages: list[tuple[float, Way]] = []
        times = [begin, *(start for start in np.unique(self.starts).tolist() if start > begin), change]
        for time, end in pairwise(times):
            slope = self._by_turns(partial(self._fast, self.starts <= time))
            last = float(self.memory.turns(end))
            way = Trajectory(slope, float(self.memory.turns(time)), state, last)
            state = way(last)
            stages.append((time, way))
        slow = Trajectory(self._by_turns(self._slow), float(self.memory.turns(change)), state[[0, 2]])
        return [*stages, (change, slow)]

    def _by_turns(self, slope: Slope) -> Slope:
        """Let a state change with the turns of the averages, not with time."""

        def by_turns(turn: float, state: FloatArray) -> FloatArray:
            time = self.memory.age(turn)
            return np.asarray(slope(time, state) / self.memory.rate(time))

        return by_turns

    def fallen(self, state: FloatArray) -> FloatArray:
        """Take away by signals, all at once, what a state as of an `Origin` has above the level."""
        average, found, divisor = state
        limit, kappa, demand = self.steady.found.sum(axis=0), self._kappa(average, divisor), found.copy()
        for j in np.flatnonzero(found.sum(axis=0) > limit).tolist():
            cuts, before, level = kappa[:, j], found[:, j], float(limit[j])
            most = 2.0 * np.log(before.sum() / level) / cuts.min()
            signals = brentq(_beyond, 0.0, most, (before, cuts, level))
            demand[:, j] = before * np.exp(-signals * cuts)
        return np.stack([average, demand, divisor])

    def _ramp(self, time: float) -> float:
        """Average the time since the start, as demand that grows from 0 makes it."""
        tau = self.memory.time_constant
        if tau is not None:
            return float(time / -np.expm1(-time / tau)) - tau
        return time * self.memory.gain / (1.0 + self.memory.gain)

    def _kappa(self, average: FloatArray, divisor: FloatArray) -> FloatArray:
        """Compute what part of the demand that it finds a signal takes in the mean."""
        setting = self.setting
        below = divisor - average if setting.response.divisor == AT_SIGNALS else self._settled_tooth
        part = chance(setting.problem, setting.response, average, below)
        if setting.response.divisor == AT_CUTS:
            part = part * average / (divisor - self._settled_tooth)
        return part * self._largest_cut

    def _fast(self, begun: BoolArray, time: float, state: FloatArray) -> FloatArray:
        average, found, divisor = state
        increase = self.setting.problem.increase
        # An agent that receives a signal on the clock does not grow in its step.
        taken = self._kappa(average, divisor) * found + self._held_back
        share = self._growth / taken.sum(axis=0)
        moved = increase - np.where(begun, share, 0.0) * taken
        tooth = begun * self._tooth(found)
        if self.origin is not None:  # agents that have just come hold less than the height of the sawtooth
            tooth *= np.minimum(found / self.steady.found, 1.0)
        follows = np.where(begun, self._counting(time) * (found - divisor), increase * (self.origin is None))
        return np.stack([self.memory.rate(time - self.joined) * (found - tooth - average), moved, follows])

    def _slow(self, time: float, state: FloatArray) -> FloatArray:
        average, divisor = state
        _, found = found_by_signals(self.setting, self._kappa(average, divisor))
        tooth = self._tooth(found)
        follows = self._counting(time) * (found - divisor)
        return np.stack([self.memory.rate(time - self.joined) * (found - tooth - average), follows])

    def _tooth(self, found: FloatArray) -> FloatArray:
        """Compute how far demand in the mean over time is below what signals find."""
        following, tooth = self.setting.following, self._settled_tooth
        return tooth if following is None else tooth + (1.0 - following.mean) * (found - self.steady.found)

    def _counting(self, time: float) -> FloatArray:
        """Compute at what rates averages over signals follow, (m,) or (n, m): they begin with the first."""
        if self.origin is not None:
            return self.memory.rate(time - self.joined)
        return self.memory.rate(np.maximum(time - self.starts, _NOT_YET * self.starts))


def _beyond(signals: float, demand: FloatArray, kappa: FloatArray, level: float) -> float:
    """Compute what is left above a level after so many signals."""
    return float((demand * np.exp(-signals * kappa)).sum()) - level
