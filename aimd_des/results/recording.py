"""What is watched while a run goes on: declared before it starts, read without touching it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation as checks
from aimd_des.utils.validation import FloatArray
from aimd_des.utils.errors import InputError
from aimd_des.results.metrics import Overshoot, Stretch

__all__ = ["Account", "Observations", "Recording", "Signals", "Times"]

#: When to look: "end", "auto" (a thousand times and the end), a period, or the times themselves.
Times = Literal["auto", "end"] | float | Sequence[float] | FloatArray

IntArray = npt.NDArray[np.int64]

_AUTO_LOOKS = 1000
_MOST_LOOKS = 10_000_000


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
        run away from the capacity, which nobody tells otherwise.
        `run_discrete` always does; it costs nothing there.
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
            elif checks.axes(value):
                times = checks.array(name, value, ("n_times",), low=0.0)
                if (np.diff(times) <= 0).any():
                    raise InputError.of(name, times.tolist(), "strictly ascending times")
                object.__setattr__(self, name, times)
            else:
                remedy = "or 'auto', 'end', or an array of times"
                period = checks.number(name, value, low=0.0, low_open=True, remedy=remedy)
                object.__setattr__(self, name, period)
        object.__setattr__(self, "tail", checks.integer("tail", self.tail, low=0, high=_MOST_LOOKS))
        for name in ("overshoot", "events"):
            object.__setattr__(self, name, checks.flag(f"recording.{name}", getattr(self, name)))

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
            spread = np.linspace(0.0, until, _AUTO_LOOKS + 1) if value == "auto" else np.array([until])
            times = np.unique(np.floor(spread)) if whole or until >= _AUTO_LOOKS else spread
        elif np.ndim(value) == 0:
            if until / value > _MOST_LOOKS:
                raise InputError.of(
                    name, value, f"at least {until / _MOST_LOOKS:g}", "that many looks fit nowhere"
                )
            times = np.arange(int(np.ceil(until / value))) * float(value)
        else:
            times = np.asarray(value)
        if times.size and times[-1] > until:
            raise InputError.of(name, float(times[-1]), f"times of at most {until:g}, the end of the run")
        if whole and (times % 1.0).any():
            broken = float(times[np.argmax(times % 1.0 > 0)])
            raise InputError.of(name, broken, "whole numbers: the discrete algorithm has no other instants")
        last = until - np.arange(self.tail, -1.0, -1.0)
        return np.union1d(times, last[last >= 0.0])


@dataclass(frozen=True, eq=False)
class Signals:
    """The capacity events of a run, in the order in which they were broadcast.

    Attributes
    ----------
    time : ndarray, shape (s,)
        Time of the look that caused the broadcast.
    resource : ndarray of int, shape (s,)
        j.
    number : ndarray of int, shape (s,)
        b, counted from 0 for each resource.
    """

    time: FloatArray
    resource: npt.NDArray[np.int64]
    number: npt.NDArray[np.int64]

    def counts(self, n_resources: int) -> npt.NDArray[np.int64]:
        """Count the signals of each resource, shape (m,).

        Parameters
        ----------
        n_resources : int
            m.

        Returns
        -------
        ndarray of int, shape (m,)
            The bits that were broadcast.
        """
        return np.bincount(self.resource, minlength=n_resources)


@dataclass(frozen=True, eq=False)
class Account:
    """What was communicated and how it was answered.

    Attributes
    ----------
    delivered, lost, in_flight : ndarray of int, shape (m, n)
        Copies of the signals by what became of them: each broadcast makes one for each agent.
    duplicated : ndarray of int, shape (m, n)
        Duplicates that arrived besides.
    responses, saturated : ndarray of int, shape (m, n)
        Decreases of each agent, and those of them that had a response probability above 1.
    """

    delivered: IntArray
    lost: IntArray
    in_flight: IntArray
    duplicated: IntArray
    responses: IntArray
    saturated: IntArray


@dataclass(frozen=True, eq=False)
class Observations:
    """What the observers saw.

    Attributes
    ----------
    demand_times : ndarray, shape (q,)
        When totals were kept.
    total_demand, total_average : ndarray, shape (q, m)
        Sums over the agents of demand and of average, in units of the resources.
    allocation_times : ndarray, shape (r,)
        When allocations were kept; the last is the end of the run.
    demand, average : ndarray, shape (r, m, n)
        Of every agent, in units of the resources.
    overshoot : Overshoot
        Exact integrals over the whole run.
    second_half : ndarray, shape (m,)
        Mean total demand in the second half of the run over the capacity in force; NaN if not integrated.
    stretches : tuple of Stretch
        The same between interventions; empty if overshoot was not integrated.
    """

    demand_times: FloatArray
    total_demand: FloatArray
    total_average: FloatArray
    allocation_times: FloatArray
    demand: FloatArray
    average: FloatArray
    overshoot: Overshoot
    second_half: FloatArray
    stretches: tuple[Stretch, ...] = ()
