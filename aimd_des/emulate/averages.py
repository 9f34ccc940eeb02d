"""How an agent of an emulation averages its demand: formulas of its own, written from the page on the model.

Between two answers demand is the line ``demand + increase * (t - since)``.  Each class carries one number,
the state, from the start of such a line to any later time, and turns it into the average.  Times are in units
of the run, and agents are there from 0 on.  All methods take floats, or arrays of them.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np


class Average(Protocol):
    """What is made of the past of a demand."""

    def fold(self, state: Any, since: Any, demand: Any, increase: Any, time: Any) -> Any:
        """Carry the state from `since`, where the line begins with `demand`, to `time`."""
        ...

    def mean(self, state: Any, time: Any) -> Any:
        """Return the average at a time greater than 0 to which the state has been carried."""
        ...


@dataclass(frozen=True)
class OverAll:
    """All of the past counts alike; the state is the integral of demand."""

    def fold(self, state: Any, since: Any, demand: Any, increase: Any, time: Any) -> Any:
        """Carry the state from `since` to `time`."""
        length = time - since
        return state + length * (demand + 0.5 * increase * length)

    def mean(self, state: Any, time: Any) -> Any:
        """Return the average."""
        return state / time


@dataclass(frozen=True)
class Fading:
    """Demand at age s counts ``exp(-s / T)``; the state is the integral with these weights."""

    time_constant: float  # T, in units of time

    def fold(self, state: Any, since: Any, demand: Any, increase: Any, time: Any) -> Any:
        """Carry the state from `since` to `time`."""
        long, length = self.time_constant, time - since
        kept = np.exp(-length / long)
        faded = long * (1.0 - kept)
        return state * kept + demand * faded + increase * long * (length - faded)

    def mean(self, state: Any, time: Any) -> Any:
        """Return the average."""
        return state / (self.time_constant * (1.0 - np.exp(-time / self.time_constant)))


@dataclass(frozen=True)
class Rising:
    """Demand at the time s counts ``s ** (gain - 1)``; the state is the average itself."""

    gain: float

    def fold(self, state: Any, since: Any, demand: Any, increase: Any, time: Any) -> Any:
        """Carry the state from `since` to `time`, which is greater than 0."""
        gain, share = self.gain, since / time
        older = share**gain
        intercept = demand - increase * since
        slope = increase * time * (gain / (gain + 1.0)) * (1.0 - older * share)
        return state * older + intercept * (1.0 - older) + slope

    def mean(self, state: Any, time: Any) -> Any:
        """Return the average."""
        del time
        return state
