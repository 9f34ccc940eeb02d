"""What compiled agents have heard and answered, as entries of the log in the order of events."""

from array import array
from bisect import bisect
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.engine.delivery import Signal
from aimd_des.engine.environment import EventKind
from aimd_des.fleet.arrays import LAST, Answers, BoolArray, IntArray
from aimd_des.results.event_log import Entry
from aimd_des.utils.validation import FloatArray

# Turns at one instant: the copy with order number r lands at 2 r and is answered at 2 r + 1; ticks are later
# than all copies, and go by agents and then by resources.
_TICKS = 1 << 62


def turn_limit(kind: int, order: int, own: EventKind) -> int:
    """Return the order below which what is of a kind of its own comes before (kind, order)."""
    # At one instant, all of a kind come before a later kind, and none before an earlier one.
    return LAST if kind > own else order if kind == own else 0


class EventEntries:
    """Makes entries of what has been computed in another order, and keeps copies until they land."""

    def __init__(self, n_resources: int, *, ticking: bool) -> None:
        self.n_resources, self.ticking = n_resources, ticking
        # Of copies that have not landed: order number, resource, agent, number of the broadcast, copy.
        self._time, self._about = np.empty(0), np.empty((5, 0), dtype=np.int64)
        # Order numbers of the copies of agent 0, ascending, and of which broadcasts they are.
        self._first, self._number = array("q"), array("q")

    def state(self) -> dict[str, Any]:
        """Return the copies that have not landed, and of which broadcasts there may be answers."""
        # Arrays that are never written to; the others grow, and are copied.
        return {
            "time": self._time,
            "about": self._about,
            "first": np.array(self._first),
            "number": np.array(self._number),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self._time, self._about = state["time"], state["about"]
        self._first, self._number = (array("q", state[name].tobytes()) for name in ("first", "number"))

    def send(self, signal: Signal, arrival: FloatArray, arrives: BoolArray, first_order: int) -> None:
        """Take note of copies of a broadcast; those that arrive will land."""
        agents = np.flatnonzero(arrives)
        about = np.empty((5, len(agents)), dtype=np.int64)
        about[0], about[1], about[2], about[3], about[4] = (
            first_order + agents,
            signal.resource,
            agents,
            *signal[1:],
        )
        self._time = np.concatenate([self._time, arrival[agents]])
        self._about = np.concatenate([self._about, about], axis=1)
        # Mostly at the end: only a signal with another sensing delay can leave before those of earlier looks.
        place = bisect(self._first, first_order)
        self._first.insert(place, first_order)
        self._number.insert(place, signal.number)

    def take(self, answers: Answers, reached: tuple[float, int, int], away: BoolArray) -> FloatArray:
        """Return the entries, shape (q, 6), of all that comes before an event, and forget it."""
        entries, turn = self._answered(answers)
        if self._first:
            landed, landed_turn = self._landed(reached, away)
            entries, turn = np.concatenate([landed, entries]), np.concatenate([landed_turn, turn])
        answers.held[0] = 0
        return np.asarray(entries[np.lexsort((turn, entries[:, 0]))])

    def _landed(self, reached: tuple[float, int, int], away: BoolArray) -> tuple[FloatArray, IntArray]:
        """Make entries of copies that have landed, and their turns."""
        time, kind, order = reached
        limit = turn_limit(kind, order, EventKind.DELIVER)
        lands = (self._time < time) | ((self._time == time) & (self._about[0] < limit))
        about = self._about[:, lands]
        # As it is now is as it was when a copy landed: a change of the present agents settles first.
        kinds = np.where(away[about[2]], Entry.LOST, Entry.DELIVER)
        entries = _entries(self._time[lands], kinds, *about[1:4], about[4])
        self._time, self._about = self._time[~lands], self._about[:, ~lands]
        return entries, 2 * about[0]

    def _answered(self, answers: Answers) -> tuple[FloatArray, IntArray]:
        """Make entries of answers, and their turns."""
        count = int(answers.held[0])
        key, rank, agent, resource, change = (column[:count] for column in answers[:5])
        # Agent i's copy has the i-th order number of its broadcast; without a log broadcasts are not kept.
        number: IntArray | int = -1
        if self._first:
            broadcasts = np.searchsorted(np.asarray(self._first), rank - agent)
            number = np.asarray(self._number)[broadcasts]
        holds = np.isnan(change)
        kinds = np.where(holds, Entry.HOLD, Entry.RESPOND)
        # A demand that falls to what it was falls by 0.0, not -0.0.
        value = np.where(holds, 0.0, 0.0 - change)
        entries = _entries(key.view(np.float64), kinds, resource, agent, number, value)
        turn = _TICKS + agent * self.n_resources + resource if self.ticking else 2 * rank + 1
        return entries, np.asarray(turn, dtype=np.int64)


def _entries(time: FloatArray, *columns: npt.ArrayLike) -> FloatArray:
    entries = np.empty((len(time), 1 + len(columns)))
    for place, column in enumerate((time, *columns)):
        entries[:, place] = column
    return entries
