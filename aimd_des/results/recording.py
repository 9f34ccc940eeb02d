"""What is watched while a run goes on: declared before it starts, read without touching it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import locked
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray

#: When to look: "end", "auto" (a thousand times and the end), a period, or the times themselves.
Times = Literal["auto", "end"] | float | Sequence[float] | FloatArray


_AUTO_LOOKS = 1000
_MOST_LOOKS = 10_000_000


# Runs of a study end at the same time.
@lru_cache(maxsize=16)
def _spread(until: float) -> FloatArray:
    return locked(np.linspace(0.0, until, _AUTO_LOOKS + 1))


@brief
@dataclass(frozen=True, eq=False)
class Recording:
    """What a run keeps besides its signals and its end.

    Parameters
    ----------
    demand : "auto", "end", float or array_like of shape (q,)
        When to keep the totals over all agents: a thousand times over the run, at the end only,
        with a period, or at these times.  The end is always kept.
    allocations : "end", "auto", float or array_like of shape (q,)
        When to keep demand and average of every agent; likewise.
    tail : int
        Over how many of the last units of time both are kept at every unit, besides the above.
    overshoot : bool
        Whether to integrate total demand exactly: peak, time above capacity, mean excess, and whether it has
        run away from the capacity, which is not known otherwise.
        `run_synchronous` always does; it costs nothing there.
    events : bool
        Whether to keep the event log; event-driven runs only.

    Raises
    ------
    InputError
        If a period is not positive, times are negative, not finite or not ascending, the tail is
        no integer of at least 0, or `overshoot` or `events` is neither True nor False.
    """

    demand: Times = "auto"
    allocations: Times = "end"
    tail: int = 0
    overshoot: bool = True
    events: bool = False

    def __post_init__(self) -> None:
        for name in ("demand", "allocations"):
            value = getattr(self, name)
            if isinstance(value, str):
                if value not in ("auto", "end"):
                    raise InputError.of(name, value, "'auto', 'end', a period or an array of times")
            elif validation.axes(value):
                times = validation.array(name, value, ("n_times",), low=0.0)
                if (np.diff(times) <= 0).any():
                    raise InputError.of(name, times.tolist(), "strictly ascending times")
                object.__setattr__(self, name, times)
            else:
                remedy = "or 'auto', 'end', or an array of times"
                period = validation.number(name, value, low=0.0, low_open=True, remedy=remedy)
                object.__setattr__(self, name, period)
        object.__setattr__(self, "tail", validation.integer("tail", self.tail, low=0, high=_MOST_LOOKS))
        for name in ("overshoot", "events"):
            object.__setattr__(self, name, validation.flag(f"recording.{name}", getattr(self, name)))

    def times(self, name: Literal["demand", "allocations"], until: float, *, whole: bool) -> FloatArray:
        """List the instants of one kind of look over [0, until], the end included.

        Parameters
        ----------
        name : "demand" or "allocations"
            Which look.
        until : float
            The end of the run.
        whole : bool
            Whether only whole numbers make sense, as for steps of the discrete algorithm.

        Returns
        -------
        ndarray, shape (q,)
            Ascending, the last one is `until`.

        Raises
        ------
        InputError
            If a time given lies beyond the end, or is not whole where it must be.
        """
        value = getattr(self, name)
        if isinstance(value, str):
            spread = _spread(until) if value == "auto" else np.array([until])
            times = np.unique(np.floor(spread)) if whole or until >= _AUTO_LOOKS else spread
        elif np.ndim(value) == 0:
            if until / value > _MOST_LOOKS:
                raise InputError.of(
                    name, value, f"at least {until / _MOST_LOOKS:g}", "so many samples do not fit into memory"
                )
            times = np.arange(int(np.ceil(until / value))) * float(value)
        else:
            times = np.asarray(value)
        if times.size and times[-1] > until:
            raise InputError.of(name, float(times[-1]), f"times of at most {until:g}, the end of the run")
        if whole and (times % 1.0).any():
            broken = float(times[np.argmax(times % 1.0 > 0)])
            raise InputError.of(name, broken, "whole numbers: the discrete algorithm has no other instants")
        # Most are in order already, and end with the run.
        if not self.tail and times.size and times[-1] == until and (times[1:] > times[:-1]).all():
            return times.copy()
        last = until - np.arange(self.tail, -1.0, -1.0)
        return np.union1d(times, last[last >= 0.0])
