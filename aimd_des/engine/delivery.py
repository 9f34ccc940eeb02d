"""What is sent and to which agents: the bit, the members, and copies on their way."""

from bisect import insort
from collections.abc import Callable, Generator, Mapping
from itertools import repeat
from typing import Any, NamedTuple, Protocol

import numpy as np
import simpy

from aimd_des.engine.environment import EventKind, OrderedEnvironment
from aimd_des.results.event_log import Entry, EventLog
from aimd_des.utils import rng
from aimd_des.utils.direct_calls import direct
from aimd_des.utils.rng import Key
from aimd_des.utils.validation import BoolArray, FloatArray

ProcessGenerator = Generator[simpy.Event, Any, Any]


class Signal(NamedTuple):
    """What arrives at an agent: one bit.  That it arrives is the 1; silence is the 0.

    Attributes
    ----------
    resource : int
        j: which of the m one-bit signals is set.
    number, copy : int
        The address of the agent's draw, and of entries in the log: no agent decides by them.
    """

    resource: int
    number: int
    copy: int = 0


class Agent(Protocol):
    """Anything that takes part in the sharing.

    One that keeps signals for later has a method ``forget()`` besides, which is called when it goes away.
    """

    def receive(self, signal: Signal) -> None:
        """Take note of a capacity signal that arrives now."""
        ...

    def process(self) -> ProcessGenerator:
        """Live: the SimPy process of the agent."""
        ...


class Collective(Protocol):
    """Agents that are advanced together, when they are read, and not one by one.

    Attributes
    ----------
    members : ndarray of bool, shape (n,)
        Which agents belong to it.
    """

    @property
    def members(self) -> BoolArray: ...  # noqa: D102 - described with the class

    def send(self, signal: Signal, arrival: FloatArray, first_order: int) -> None:
        """Put the members' copies of a broadcast on their way; those of others are none of its business."""
        ...

    def settle(self) -> None:
        """Bring the members to where events have come: all that is due before happens now."""
        ...

    def forget(self, agent: int, *, lost: bool) -> None:
        """Drop a member's copies that have arrived by now; they are lost on it, or were delivered."""
        ...


# Rows of response draws kept at hand; one that is gone is drawn again, to the same bits.
_ROWS_KEPT = 256


class ResponseDraws(dict[Signal, list[float]]):
    """What decides how each agent responds to a signal; drawn when it is first asked for."""

    def __init__(self, key: Key, n_agents: int) -> None:
        super().__init__()
        self.key = key
        self.n_agents = n_agents
        self._fill: Callable[..., None] | None = None

    def __missing__(self, signal: Signal) -> list[float]:
        # Copies of one broadcast ask for the same row, mostly soon after each other; the oldest goes.
        if len(self) == _ROWS_KEPT:
            del self[next(iter(self))]
        # Agent i takes the i-th of the row, with any other agents and any representation.
        row = np.empty(self.n_agents)
        given = (self.key, *signal, row)
        if self._fill is None:
            self._fill = direct(rng.uniforms_row, *given)
        self._fill(*given)
        draws: list[float] = row.tolist()  # indexed one at a time, where a list is several times as fast
        self[signal] = draws
        return draws


# When a copy lands, the order number of the first copy of its broadcast, its receiver, and the signal: the
# receiver added to the number is its own.
_Due = tuple[float, int, int, Signal]

# An enumeration is asked by way of its class, which takes as long as all else that a copy needs here.
_DELIVERY = EventKind.DELIVER
_LOST, _DELIVERED = float(Entry.LOST), float(Entry.DELIVER)

# So many times as many copies in flight as in a broadcast are not sorted with it: about where the two ways
# take the same time.
_FEW = 64


def _latest_first(due: _Due) -> tuple[float, int, int]:
    """Return the key by which copies on their way ascend; no two have the same order number."""
    return -due[0], -due[1], -due[2]


class Carrier:
    """All copies on their way, in one list with the next to land at its end.

    The environment knows only the earliest copy.  When that has landed, the next one lands within the
    same event unless something else is due first, or the run is to pause before.

    Attributes
    ----------
    missed : callable
        Called with (signal, agent) when a copy has landed at an agent that is away.
    """

    def __init__(
        self,
        env: OrderedEnvironment,
        agents: Mapping[int, Agent],
        away: BoolArray,
        log: EventLog | None,
    ) -> None:
        self.env = env
        self.agents = agents
        # The same memory as that of the conditions, read one at a time: faster than an array of NumPy.
        self.away = memoryview(away)  # type: ignore[arg-type]  # typeshed knows no buffers of bools
        self.log = log
        self.missed: Callable[[Signal, int], None] = lambda signal, agent: None
        self._due: list[_Due] = []
        # Order numbers of the copies that are scheduled.  One is scheduled only if it is earlier than
        # all others, so they form a stack with the earliest on top.
        self._scheduled: list[int] = []

    def send(self, signal: Signal, times: list[float], receivers: list[int], first_order: int) -> None:
        """Put copies of one broadcast on their way, sorted by time and then by receiver; at least one."""
        due = self._due
        earliest = due[-1] if due else None
        copies = zip(times, repeat(first_order), receivers, repeat(signal), strict=False)
        if _FEW * len(times) < len(due):
            # Among many copies in flight a search for each place is faster than a pass over all of them.
            for copy in copies:
                insort(due, copy, key=_latest_first)
        else:
            # Two sorted runs, which the sort of Python merges.
            due.extend(copies)
            due.sort(reverse=True)
        # Behind an earlier copy it needs no event: `_land` comes to it.
        if due[-1] is not earliest:
            self._schedule(times[0], first_order + receivers[0])

    def _schedule(self, time: float, order: int) -> None:
        self._scheduled.append(order)
        self.env.at(time, _DELIVERY, order).callbacks.append(self._land)

    def _land(self, event: simpy.Event) -> None:
        """Hand copies to their receivers one by one, for as long as nothing else comes in between."""
        env, due, scheduled, agents, away, log = (
            self.env,
            self._due,
            self._scheduled,
            self.agents,
            self.away,
            self.log,
        )
        heap, tracking, horizon = env.heap, env.tracking, env.horizon
        # The event that happens is that of the top of the stack: all others are later.
        scheduled.pop()
        while True:
            # Before the copy is handed over: a receiver may send, and so change the list.
            time, _, agent, signal = due.pop()
            # Asked when it lands: an agent that was present only when it was sent does not receive it.
            gone = away[agent]
            if log is not None:
                log.add(time, _LOST if gone else _DELIVERED, signal[0], agent, signal[1], signal[2])
            if gone:
                self.missed(signal, agent)
            else:
                agents[agent].receive(signal)
            if not due:
                return
            time = due[-1][0]
            # Most copies land before anything else is due, and are spared the rest.
            if not tracking and heap and time < heap[0][0] and time < horizon:
                env.instant = time
                continue
            _, first_order, agent, _ = due[-1]
            order = first_order + agent
            # It has an event already, from before a copy that was sent later came in ahead of it.
            if scheduled and scheduled[-1] == order:
                return
            # Something else comes first, or the run goes no further for now: back to SimPy, at the price of
            # one event.
            if time >= horizon or not env.advance(time, _DELIVERY, order):
                self._schedule(time, order)
                return
