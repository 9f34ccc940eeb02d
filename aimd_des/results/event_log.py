"""The event log: every broadcast, copy and answer of a run, in the order in which they happened."""

from array import array
from collections.abc import Callable, Iterable, Mapping
from enum import IntEnum
from struct import Struct
from typing import TYPE_CHECKING, Any

import numpy as np

from aimd_des.results.frames import categorical
from aimd_des.utils.validation import FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd

#: Takes time, kind (`Entry`), resource, agent, number of the broadcast and value.
Add = Callable[[float, float, int, int, int, float], None]


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
    HOLD_OFF = 18
    """The hold-off of the control unit changes; what it is from now on, the shortest where it adapts."""
    CHANNEL = 19
    """Signals go over another channel from now on; 0."""


# Numbers of an entry, and their bytes: an array takes in bytes three times as fast as numbers.
_FIELDS = 6
_BYTES = Struct(f"{_FIELDS}d").pack


class EventLog:
    """Entries in the order of events: time, then kind, then broadcast and agent."""

    def __init__(self, numbers: Iterable[float] = ()) -> None:
        # One typed array, entry after entry: 48 bytes each, and no object that the garbage collector visits.
        # Whole numbers are exact up to 2^53.
        self._numbers = array("d", numbers)
        # Entries before these, shape (q, 6), of a run that has been forked: shared with what came of it.
        self._earlier: tuple[FloatArray, ...] = ()
        take_in = self._numbers.frombytes
        self.add: Add = lambda *entry: take_in(_BYTES(*entry))
        self._before: Callable[[], None] = lambda: None

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy has the entries alone: the owner of the log belongs to a run, which cannot be copied.
        return EventLog, (array("d", self._rows(0).tobytes()),)

    def __len__(self) -> int:
        return sum(map(len, self._earlier)) + len(self._numbers) // _FIELDS

    def _rows(self, since: int) -> FloatArray:
        """Return the entries, shape (q, 6), from one of them on."""
        pieces = []
        for piece in self._earlier:
            pieces.append(piece[since:])
            since = max(since - len(piece), 0)
        # A copy: the array cannot grow while its memory is being read.
        pieces.append(np.array(self._numbers[_FIELDS * since :]).reshape(-1, _FIELDS))
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)

    def state(self) -> dict[str, Any]:
        """Return the entries so far; they are put aside, and nothing is written there any more."""
        if self._numbers:
            self._earlier = (*self._earlier, np.array(self._numbers).reshape(-1, _FIELDS))
            del self._numbers[:]
        return {"entries": self._earlier}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self._earlier = tuple(state["entries"])

    def lead(self, before: Callable[[], None]) -> None:
        """Have something done before an entry is added, and before entries are read."""
        add_now = self.add

        def add(*entry: Any) -> None:
            before()
            add_now(*entry)

        self.add, self._before = add, before

    def extend(self, entries: FloatArray) -> None:
        """Add many entries, shape (q, 6), ahead of what `lead` would bring forth."""
        self._numbers.frombytes(entries.tobytes())

    def columns(self, since: int = 0) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return the entries as arrays, from one of them on."""
        self._before()
        rows = self._rows(since)
        return rows[:, 0], rows[:, 1:5].astype(np.int64), rows[:, 5]

    def frame(
        self, resource_names: tuple[str, ...], agent_names: tuple[str, ...], since: int = 0
    ) -> "pd.DataFrame":
        """Return the entries as a frame, from one of them on."""
        import pandas as pd

        time, entry, value = self.columns(since)
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
