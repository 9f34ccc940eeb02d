"""Clocks: tick q is at phase + q * period, never at the last tick plus a period."""

import math
from dataclasses import dataclass

from aimd_des import checks

__all__ = ["Clock"]


@dataclass(frozen=True)
class Clock:
    """A clock that ticks for ever.

    Parameters
    ----------
    period : float
        Time between two ticks, greater than 0.
    phase : float
        Time of tick 0, at least 0.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    Adding 0.1 ten times misses 1.0; tick 10 does not:

    >>> Clock(period=0.1).time(10)
    1.0
    """

    period: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", checks.number("period", self.period, low=0.0, low_open=True))
        object.__setattr__(self, "phase", checks.number("phase", self.phase, low=0.0))

    def time(self, tick: int) -> float:
        """Return the time of a tick.

        Parameters
        ----------
        tick : int
            Its index q, from 0.

        Returns
        -------
        float
            phase + q * period.
        """
        return self.phase + tick * self.period

    def next_tick(self, time: float) -> int:
        """Return the index of the first tick at or after a time: how many ticks are before it.

        Parameters
        ----------
        time : float
            Any time.

        Returns
        -------
        int
            At least 0; exact with respect to `time`, though the division is not.
        """
        tick = max(math.ceil((time - self.phase) / self.period), 0)
        while tick > 0 and self.time(tick - 1) >= time:
            tick -= 1
        while self.time(tick) < time:
            tick += 1
        return tick
