"""Clocks: tick q is at phase + q * period, never at the last tick plus a period.

With jitter it is at phase + q * period + jitter * u; compiled code and processes call the same functions.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from aimd_des.utils import rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.jit import kernel, shared
from aimd_des.utils.rng import Key, uniform_at
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray

# Addresses within the stream of clocks: what stands where a resource stands for signals.
_TICKS, _PHASES = 0, 1


@kernel
def tick_time(phase: float, period: float, jitter: float, key: Key, agent: int, tick: float) -> float:
    """Return the time of an agent's tick."""
    time = phase + tick * period
    return time + jitter * uniform_at(key, _TICKS, int(tick), 0, agent) if jitter > 0.0 else time


@kernel
def next_tick(phase: float, period: float, jitter: float, key: Key, agent: int, time: float) -> float:
    """Count an agent's ticks before a time; exact, though the division is not."""
    tick = max(np.ceil((time - phase) / period), 0.0)
    while tick > 0.0 and tick_time(phase, period, jitter, key, agent, tick - 1.0) >= time:
        tick -= 1.0
    while tick_time(phase, period, jitter, key, agent, tick) < time:
        tick += 1.0
    return float(tick)


@shared
def next_ticks(
    phase: FloatArray, period: FloatArray, jitter: FloatArray, key: Key, time: float, out: FloatArray
) -> None:
    """Count every agent's ticks before a time."""
    for i in range(out.shape[0]):
        out[i] = next_tick(phase[i], period[i], jitter[i], key, i, time)


@dataclass(frozen=True)
class Clock:
    """A clock that ticks for ever.

    Examples
    --------
    Adding 0.1 ten times misses 1.0; tick 10 does not:

    >>> Clock(period=0.1).time(10)
    1.0
    """

    period: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", validation.number("period", self.period, low=0.0, low_open=True))
        object.__setattr__(self, "phase", validation.number("phase", self.phase, low=0.0))

    def time(self, tick: int) -> float:
        """Return the time of a tick."""
        return self.phase + tick * self.period

    def next_tick(self, time: float) -> int:
        """Return the index of the first tick at or after a time: how many ticks are before it."""
        tick = max(math.ceil((time - self.phase) / self.period), 0)
        while tick > 0 and self.time(tick - 1) >= time:
            tick -= 1
        while self.time(tick) < time:
            tick += 1
        return tick


@brief
@dataclass(frozen=True, eq=False)
class Clocks:
    """The clocks of discrete agents: one for all, or each its own.

    Agent i's tick q is at phase_i + q * period_i * (1 + drift_i) + jitter_i * u, with u uniform
    on [0, 1) and drawn for each tick.

    Parameters
    ----------
    period : float or array_like, shape (n,)
        Nominal time between two ticks, greater than 0.
    phase : float, array_like of shape (n,), or "random"
        Time of tick 0, at least 0; "random": uniform over one period, for each agent its own.
    drift : float or array_like, shape (n,)
        Relative error of the period, greater than -1.
    jitter : float or array_like, shape (n,)
        Largest delay of a tick, at least 0 and less than the period, so that ticks keep their order.
    """

    period: float | FloatArray = 1.0
    phase: float | FloatArray | Literal["random"] = 0.0
    drift: float | FloatArray = 0.0
    jitter: float | FloatArray = 0.0

    def __post_init__(self) -> None:
        clean = {
            "period": validation.per_agent("period", self.period, low=0.0, low_open=True),
            "drift": validation.per_agent("drift", self.drift, low=-1.0, low_open=True),
            "jitter": validation.per_agent("jitter", self.jitter, low=0.0),
        }
        if isinstance(self.phase, str):
            if self.phase != "random":
                raise InputError.of("phase", self.phase, "'random', a number or an array of numbers")
        else:
            clean["phase"] = validation.per_agent("phase", self.phase, low=0.0)
        for name, value in clean.items():
            object.__setattr__(self, name, value)

    def start(self, n_agents: int, key: Key) -> "AgentClocks":
        """Set the clocks of one run."""
        rows = {}
        for name in ("period", "drift", "jitter"):
            validation.fits(name, getattr(self, name), n_agents)
            rows[name] = np.array(np.broadcast_to(getattr(self, name), (n_agents,)), dtype=np.float64)
        period = rows["period"] * (1.0 + rows["drift"])
        if isinstance(self.phase, str):
            phase = period * rng.uniforms(key, _PHASES, 0, n_agents)
        else:
            validation.fits("phase", self.phase, n_agents)
            phase = np.array(np.broadcast_to(self.phase, (n_agents,)), dtype=np.float64)
        late = rows["jitter"] >= period
        if late.any():
            agent = int(np.argmax(late))
            allowed = f"less than the period, {period[agent]:g}"
            raise InputError.of(f"jitter of agent {agent}", float(rows["jitter"][agent]), allowed)
        return AgentClocks(phase, period, rows["jitter"], key)


class AgentClocks:
    """The clocks of all agents in one run.

    Attributes
    ----------
    common : bool
        Whether all agents tick at the same times.
    rows : tuple of ndarray
        Phase, period and jitter.
    key : tuple of two uint64
        The run's key for clocks.
    """

    def __init__(self, phase: FloatArray, period: FloatArray, jitter: FloatArray, key: Key) -> None:
        self.rows = (phase, period, jitter)
        self._numbers = tuple(zip(phase.tolist(), period.tolist(), jitter.tolist(), strict=True))
        self.key = key
        self.common = bool(np.ptp(phase) == 0.0 and np.ptp(period) == 0.0 and not jitter.any())
        self._shared = Clock(*self._numbers[0][1::-1])
        self._ticks = np.empty(1 if self.common else len(phase))
        # All agents ask at the same instants where the clock is common.
        self._asked, self._answer = -1.0, 0

    def time(self, agent: int, tick: int) -> float:
        """Return the time of an agent's tick."""
        if self.common:
            return self._shared.time(tick)
        return tick_time(*self._numbers[agent], self.key, agent, float(tick))

    def next_tick(self, agent: int, time: float) -> int:
        """Return the index of an agent's first tick at or after a time."""
        if self.common:
            if time != self._asked:
                self._asked, self._answer = time, self._shared.next_tick(time)
            return self._answer
        return int(next_tick(*self._numbers[agent], self.key, agent, time))

    def next_ticks(self, time: float) -> FloatArray:
        """Return the index of every agent's first tick at or after a time."""
        if self.common:
            self._ticks[0] = self._shared.next_tick(time)
        else:
            next_ticks(*self.rows, self.key, time, self._ticks)
        return self._ticks
