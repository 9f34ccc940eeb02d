"""How signals are sent: the account of every broadcast and of what becomes of its copies."""

import math
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, overload

import numpy as np
import numpy.typing as npt
import simpy

from aimd_des.channel import Broadcast, Copies, DrawnLink, Link
from aimd_des.engine.conditions import Conditions
from aimd_des.engine.delivery import Carrier, Collective, Signal
from aimd_des.engine.environment import EventKind, OrderedEnvironment, Place
from aimd_des.results.event_log import Entry, EventLog
from aimd_des.results.run_data import Signals
from aimd_des.utils import returned_values
from aimd_des.utils.locked_arrays import carry_over
from aimd_des.utils.validation import FloatArray

IntArray = npt.NDArray[np.int64]


class SentSignals(Sequence[Broadcast]):
    """The broadcasts of a run so far, in the order in which they were sent."""

    def __init__(self) -> None:
        # Grows by appending, at 24 bytes for a signal: a run may send millions.
        self._time, self._resource, self._number = array("d"), array("q"), array("q")
        # Those before them, of a run that has been forked: shared with what came of it.
        self._earlier: tuple[Signals, ...] = ()

    def append(self, broadcast: Broadcast) -> None:
        """Add one."""
        self._time.append(broadcast.time)
        self._resource.append(broadcast.resource)
        self._number.append(broadcast.number)

    def extend(self, time: FloatArray, resource: IntArray, number: IntArray) -> None:
        """Add several."""
        self._time.frombytes(time.tobytes())
        self._resource.frombytes(resource.tobytes())
        self._number.frombytes(number.tobytes())

    def __len__(self) -> int:
        return sum(len(piece.time) for piece in self._earlier) + len(self._time)

    @overload
    def __getitem__(self, index: int) -> Broadcast: ...

    @overload
    def __getitem__(self, index: slice) -> list[Broadcast]: ...

    def __getitem__(self, index: int | slice) -> Broadcast | list[Broadcast]:
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        place = range(len(self))[index]  # of one that counts from the end; refuses what is beyond
        for piece in self._earlier:
            if place < len(piece.time):
                time, resource, number = piece.time[place], piece.resource[place], piece.number[place]
                return Broadcast(int(resource), int(number), float(time))
            place -= len(piece.time)
        return Broadcast(self._resource[place], self._number[place], self._time[place])

    def _own(self) -> Signals:
        return Signals(np.array(self._time), np.array(self._resource), np.array(self._number))

    def signals(self) -> Signals:
        """Return all of them as arrays."""
        pieces = (*self._earlier, self._own())
        if len(pieces) == 1:
            return pieces[0]
        columns = ([getattr(piece, name) for piece in pieces] for name in ("time", "resource", "number"))
        return Signals(*map(np.concatenate, columns))

    def put_aside(self) -> tuple[Signals, ...]:
        """Return those so far in pieces to which nothing is added any more."""
        if self._time:
            self._earlier = (*self._earlier, self._own())
            self._time, self._resource, self._number = array("d"), array("q"), array("q")
        return self._earlier

    def go_on_from(self, pieces: Iterable[Signals]) -> None:
        """Begin with what `put_aside` has returned."""
        self._earlier = tuple(pieces)


class _Late(NamedTuple):
    """A signal that leaves after its sensing delay."""

    event: simpy.Event
    signal: Broadcast
    copies: Copies
    orders: list[int]
    link: Link  # which has drawn the copies


class Transmitter:
    """Sends the signals of one run to all agents.

    Attributes
    ----------
    sent : SentSignals
        All signals so far.
    numbers : ndarray of int, shape (m,)
        How many there were for each resource.
    delivered, lost, duplicated : ndarray of int, shape (m, n)
        Copies by what becomes of them; duplicates that arrive are counted apart.
    collective : Collective or None
        Takes the copies of agents that are advanced together.
    on_leave : list of callable
        Called with (signal, arrival) when copies leave the control unit: when each agent's copy arrives, of
        shape (n,), inf where it is lost.  Duplicates leave as copies of their own.
    """

    def __init__(
        self,
        env: OrderedEnvironment,
        link: Link,
        n_resources: int,
        conditions: Conditions,
        until: float,
        carrier: Carrier,
        log: EventLog | None,
    ) -> None:
        self.env, self.link, self.until, self.carrier, self.log = env, link, until, carrier, log
        self.conditions, self.n_agents = conditions, len(conditions.cut)
        carrier.missed = self.missed  # the account has to be put right where a copy lands in vain
        self.sent = SentSignals()
        self.numbers = np.zeros(n_resources, dtype=np.int64)
        # Each by itself: what is not written to takes no memory, but a large array takes it in large pieces.
        self.delivered, self.lost, self.duplicated = (
            np.zeros((n_resources, self.n_agents), dtype=np.int64) for _ in range(3)
        )
        self.collective: Collective | None = None
        self.on_leave: list[Callable[[Signal, FloatArray], None]] = []
        self._late: dict[simpy.Event, _Late] = {}

    @property
    def in_flight(self) -> IntArray:
        """Copies that are neither lost nor will have arrived by the end, shape (m, n)."""
        flying = np.asarray(self.numbers[:, None] - self.delivered)
        flying -= self.lost
        return flying

    def send(self, resource: int, time: float, delay: float, total: float) -> None:
        """Broadcast a capacity signal, at a look that has found this total."""
        # Numbered for each resource, also where copies are lost: the number is the address of draws.
        signal = Broadcast(resource, int(self.numbers[resource]), time)
        self.numbers[resource] += 1
        self.sent.append(signal)
        departure = time + delay
        # Drawn at the look even if the signal leaves later: so a channel is asked in the order of broadcasts.
        link = self.link
        copies = self._drawn(link, signal, departure)
        # Turns are taken at the look: what lands at one instant lands in the order of the looks.  One for the
        # signal if it leaves later, then those of its copies, then those of their duplicates.
        turn = self.env.reserve(1 + 2 * self.n_agents)
        orders = [turn + 1, turn + 1 + self.n_agents]
        # A delay may be too short to make a difference; then the signal leaves in this very look.
        late = departure > time
        if not late:
            copies = _without(self.conditions.cut, copies)
        if self.log is not None:
            self.log.add(time, Entry.SIGNAL, resource, -1, signal.number, total)
        # What the channel loses is lost at the look, before the departure, which may come after the end.
        self._lose(signal, copies.arrival == math.inf)
        if not late:
            self._leave(signal, copies, orders, link)
        elif departure < self.until:
            # A delivery with a turn before those of its copies: after interventions that cut, ahead of looks.
            self._delay(self.env.own(departure, EventKind.DELIVER, turn), signal, copies, orders, link)

    def _delay(
        self, event: simpy.Event, signal: Broadcast, copies: Copies, orders: list[int], link: Link
    ) -> None:
        """Let a signal leave at an event, over the channel that has drawn its copies."""
        self._late[event] = _Late(event, signal, copies, orders, link)
        event.callbacks.append(self._leave_late)

    def state(self) -> dict[str, Any]:
        """Return what has been sent, the account of it, and what has still to leave."""
        # The link in force first: all that a late signal needs of the link which has drawn it is the order.
        links = {id(link): link for link in (self.link, *(each.link for each in self._late.values()))}
        places = {number: place for place, number in enumerate(links)}
        late = [
            (self.env.place_of(event), *rest, places[id(link)]) for event, *rest, link in self._late.values()
        ]
        return {
            "sent": self.sent.put_aside(),
            "account": (self.numbers, self.delivered, self.lost, self.duplicated),
            "late": late,
            "latest": [link.latest if isinstance(link, DrawnLink) else None for link in links.values()],
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned; events are put back once time stands where it did."""
        self.sent.go_on_from(state["sent"])
        own = (self.numbers, self.delivered, self.lost, self.duplicated)
        for array_, kept in zip(own, state["account"], strict=True):
            carry_over(kept, array_)

    def resume_events(self, state: Mapping[str, Any], *, same_link: bool) -> None:
        """Put back the events at which signals leave; say whether the link in force is that of `state`."""
        links: list[Link] = [_earlier(latest) for latest in state["latest"]]
        if same_link:
            links[:1] = [self.link]
        for place, signal, copies, orders, link in state["late"]:
            # Copied, since they are put in order where they are.
            own = Copies(*(None if times is None else times.copy() for times in copies))  # type: ignore[arg-type]
            event = self.env.put_back(Place(*place))
            self._delay(event, Broadcast(*signal), own, list(orders), links[link])

    def _drawn(self, link: Link, signal: Broadcast, departure: float) -> Copies:
        """Ask the channel, and refuse what it cannot mean."""
        # Ours need no check, and leave the order of copies to the time when cuts are known.
        if isinstance(link, DrawnLink):
            return link.draw(signal, departure)
        field = returned_values.said_by(link, "transmit")
        with returned_values.calling(field):
            copies = link.transmit(signal, departure)
        copies = returned_values.instance(field, copies, Copies, "Copies")
        arrival = self._times(f"{field}.arrival", copies.arrival, departure)
        second = copies.second
        return Copies(arrival, None if second is None else self._times(f"{field}.second", second, departure))

    def _times(self, field: str, times: object, departure: float) -> FloatArray:
        # Copied: the link may go on using the array.
        return returned_values.numbers(field, times, (self.n_agents,), "agent", departure).copy()

    def _lose(self, signal: Broadcast, lost: npt.NDArray[np.bool_]) -> None:
        """Enter the loss of copies that go no further."""
        self.lost[signal.resource] += lost
        if self.log is not None:
            # The signal has been entered, or agents have settled: nothing else is to come before.
            agents = np.flatnonzero(lost)
            entries = np.empty((len(agents), 6))
            entries[:] = (self.env.now, Entry.LOST, signal.resource, 0, signal.number, 0.0)
            entries[:, 3] = agents
            self.log.extend(entries)

    def _leave_late(self, event: simpy.Event) -> None:
        """Let a signal leave after its sensing delay, as far as nothing is in the way now."""
        _, signal, drawn, orders, link = self._late.pop(event)
        # There may have been no look at this instant; what is due must be answered before more is sent.
        if self.collective is not None:
            self.collective.settle()
        cut = self.conditions.cut | self.conditions.failed
        copies = _without(cut, drawn)
        # The others were entered at the look.
        self._lose(signal, (copies.arrival == math.inf) & (drawn.arrival < math.inf))
        self._leave(signal, copies, orders, link)

    def _leave(self, signal: Broadcast, copies: Copies, orders: list[int], link: Link) -> None:
        """Put copies on their way, each behind those that left before it where links keep the order."""
        # Over the channel that drew them, which may be another one by now.
        if isinstance(link, DrawnLink):
            link.keep_order(copies)
        accounts = self.delivered, self.duplicated
        for copy, (arrival, account, order) in enumerate(zip(copies, accounts, orders, strict=True)):
            if arrival is not None:
                # Counted ahead, so that nothing is counted when a copy lands; inf is never before the end.
                arrives = arrival < self.until
                account[signal.resource] += arrives
                sent = Signal(signal.resource, signal.number, copy)
                for tell in self.on_leave:
                    tell(sent, arrival)
                self._carry(sent, arrival, arrives, order)

    def missed(self, signal: Signal, agent: int) -> None:
        """Take note that a copy has landed at an agent that is away: it is lost after all."""
        # A duplicate is not lost: the account knows one copy of each signal for each agent.
        if signal.copy:
            self.duplicated[signal.resource, agent] -= 1
        else:
            self.delivered[signal.resource, agent] -= 1
            self.lost[signal.resource, agent] += 1

    def _carry(
        self, signal: Signal, arrival: FloatArray, arrives: npt.NDArray[np.bool_], first_order: int
    ) -> None:
        if self.collective is not None:
            self.collective.send(signal, arrival, first_order)
            # What is left is for agents that are processes.
            arrival = np.where(self.collective.members, math.inf, arrival)
            arrives = arrives & ~self.collective.members
        # Stable: copies that land at one instant land in the order of agents.  What never arrives is last.
        receivers = arrival.argsort(kind="stable")[: np.count_nonzero(arrives)]
        if len(receivers):
            # By receiver, lost copies included: at one instant copies land in the order of broadcasts, then
            # of agents, and compiled code comes to the same numbers.
            self.carrier.send(signal, arrival[receivers].tolist(), receivers.tolist(), first_order)


def _earlier(latest: FloatArray | None) -> DrawnLink:
    """Make a link that draws no more, and keeps the order of what it has drawn."""
    link = DrawnLink()
    link.latest = None if latest is None else latest.copy()
    return link


def _without(cut: npt.NDArray[np.bool_], copies: Copies) -> Copies:
    """Take out the copies that do not get through."""
    if not np.count_nonzero(cut):  # `any` takes four times as long
        return copies
    first, second = (None if times is None else np.where(cut, math.inf, times) for times in copies)
    assert first is not None  # noqa: S101 - there is always a first copy
    return Copies(first, second)
