"""The event log: every broadcast, copy and answer of a run, in the order in which they happened."""

from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from aimd_des.results.frames import categorical
from aimd_des.utils.validation import FloatArray

#: Time, kind (`Entry`), resource, agent, number of the broadcast, value.
LogEntry = tuple[float, int, int, int, int, float]


class Entry(IntEnum):
    """What an entry tells; what its `value` is stands behind."""

    SIGNAL = 0
    """A capacity signal is broadcast (agent -1); total demand."""
    LOST = 1
    """A copy that will not arrive, or that arrives at an agent which is away; 0, or 1 for a duplicate."""
    DELIVER = 2
    """A copy arrives; 0, or 1 for a duplicate."""
    RESPOND = 3
    """An agent decreases its demand; by how much."""
    HOLD = 4
    """An agent answers without a decrease; 0."""
    CHANGE = 5
    """A demand is set from outside; the change (number -1)."""
    LEAVE = 6
    """An agent is away from now on, and has given back what it held; 0."""
    JOIN = 7
    """An agent is here from now on; 0, or 1 if it has forgotten its past."""
    CAPACITY = 8
    """A capacity changes; what it is from now on."""
    COSTS = 9
    """Private costs change (of all agents); 0."""
    CUT = 10
    """No signal that is sent from now on gets through to an agent; 0."""
    HEAL = 11
    """Signals get through again; 0."""
    FAIL = 12
    """The control unit is down from now on; 0."""
    RECOVER = 13
    """A control unit takes over; 0."""
    NORMALIZATION = 14
    """Gamma of a resource changes; what it is from now on."""
    THRESHOLD = 15
    """The share of a capacity above which a signal is due changes; what it is from now on."""
    INCREASE = 16
    """alpha of an agent changes; what it is from now on."""
    DECREASE = 17
    """beta of an agent changes; what it is from now on."""


class EventLog:
    """Entries in the order of events: time, then kind, then broadcast and agent."""

    def __init__(self, entries: Iterable[LogEntry] = ()) -> None:
        self._entries = list(entries)
        self.add: Callable[[LogEntry], None] = self._entries.append
        self.extend: Callable[[Iterable[LogEntry]], None] = self._entries.extend

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy has the entries alone: whoever leads the log belongs to a run, which cannot be copied.
        return EventLog, (self._entries,)

    def lead(self, before: Callable[[], None]) -> None:
        """Have something done before an entry is added."""

        def add(entry: LogEntry) -> None:
            before()
            self._entries.append(entry)

        self.add = add

    def columns(self) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
        """Return the entries as arrays."""
        rows = np.array(self._entries, dtype=np.float64).reshape(-1, 6)
        return rows[:, 0], rows[:, 1:5].astype(np.int64), rows[:, 5]

    def frame(self, resource_names: tuple[str, ...], agent_names: tuple[str, ...]) -> pd.DataFrame:
        """Return the entries as a frame."""
        time, entry, value = self.columns()
        kinds = [kind.name.lower() for kind in Entry]
        return pd.DataFrame(
            {
                "time": time,
                "kind": categorical(entry[:, 0], kinds),
                "resource": categorical(entry[:, 1], resource_names),
                "agent": categorical(entry[:, 2], agent_names),
                "number": entry[:, 3],
                "value": value,
            }
        )
