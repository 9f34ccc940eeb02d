"""Ticks of clocks with drift and jitter, for compiled code: tick q is at phase + q * period + jitter * u."""

import numpy as np

from aimd_des.utils.jit import kernel
from aimd_des.utils.rng import Key, uniform_at
from aimd_des.utils.validation import FloatArray

__all__ = ["PHASES", "next_tick", "next_ticks", "tick_time"]

# Addresses within the stream of clocks: what stands where a resource stands for signals.
_TICKS, PHASES = 0, 1


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


@kernel
def next_ticks(
    phase: FloatArray, period: FloatArray, jitter: FloatArray, key: Key, time: float, out: FloatArray
) -> None:
    """Count every agent's ticks before a time."""
    for i in range(out.shape[0]):
        out[i] = next_tick(phase[i], period[i], jitter[i], key, i, time)
