"""The order of events at one instant, on SimPy's environment.

Events are handled by (time, kind, order).  Kinds at one instant:

    INTERVENE < DELIVER < SENSE < OBSERVE < ACT

Interventions first, then signals that arrive, then the control unit samples, then observers record,
then agents tick.  Within a kind, agents act in the order of their index, copies land in the order
of their broadcasts and then of the agents, interventions that are listed take place in the order of the
list, and everything else keeps the order in which it was scheduled.  Events are scheduled at absolute
times: now + (t - now) is not always t.

This is the only module that touches what SimPy keeps private.
"""

import math
from collections.abc import Callable, Collection, Generator, Mapping
from enum import IntEnum
from heapq import heappop, heappush
from itertools import count
from operator import attrgetter
from typing import Any, NamedTuple

import simpy

from aimd_des.utils.errors import InputError

# Order numbers below this are indices of agents or resources, and places of interventions that are listed: at
# one instant these come before what keeps the order in which it was scheduled.
FIRST_ORDER = 1 << 40

# Events between two reports to the observer of the run: enough for a progress bar, too few to be felt.
_WATCH_EVERY = 1 << 12

_INSTEAD = "declare interventions, and let the run come to them"

# Before every event: what `reached` is where nothing has happened that counts.
_NOTHING = (-math.inf, 0, 0)


class EventKind(IntEnum):
    """What an event is, in the order of handling at one instant; SimPy itself uses 0 and 1."""

    INTERVENE = 2
    DELIVER = 3
    SENSE = 4
    OBSERVE = 5
    ACT = 6


# An enumeration is asked by way of its class, which takes as long as all the rest of a comparison.
_INTERVENE, _ACT = EventKind.INTERVENE, EventKind.ACT


class _Due(simpy.Event):
    """An event of a known time; events that are given the same order keep their turn."""

    def __init__(self, env: simpy.Environment, order: int, turn: int) -> None:
        # Not by SimPy's constructor, as its own timeouts are not: every signal makes some of them.
        self.env = env
        self.callbacks = []
        # Triggered already, as those timeouts are: `env.at` puts it into the queue.
        self._ok = True
        self._value = None
        self.order = order
        self.turn = turn
        self.owned = False  # whether its owner keeps it as data, and puts it back where a run is resumed

    def __lt__(self, other: "_Due") -> bool:
        # The queue compares events only where time, kind and order are equal, which SimPy's own never are.
        return self.turn < other.turn


class Place(NamedTuple):
    """Where an event stands in the queue: what it is compared by."""

    time: float
    kind: int
    order: int
    turn: int


#: Makes the generator of a process; asked whether it goes on from where it has waited, or begins.
Maker = Callable[[bool], Generator[simpy.Event, Any, Any]]


class _Begun(NamedTuple):
    """A process that can be entered again, since its owner knows where it is."""

    process: simpy.Process
    make: Maker
    place: int | None  # of an intervention


class OrderedEnvironment(simpy.Environment):
    """A SimPy environment in which simultaneous events have an order that means something.

    Attributes
    ----------
    tracking : bool
        Whether `reached` is kept up to date; set before the run by the part that needs it.
    instant : float
        Now.  A part that lets several things happen within one event moves it on, as `advance` does.
    heap : list of tuple
        What is due, as (time, kind, order, event), of which the first is next; to be read.
    """

    def __init__(self) -> None:
        super().__init__()
        self.instant = 0.0
        self.heap = self._queue
        # SimPy numbers its own events from here, too: there is one sequence of order numbers.
        self._eid = count(FIRST_ORDER)
        # Several events may be given the same order: those keep the turn in which they were scheduled.
        self._turns = count()
        self._places: dict[simpy.Process | None, int] = {}
        self._begun: dict[str, _Begun] = {}
        # The place that the next event takes which is scheduled: of a process that is entered again.
        self._kept: Place | None = None
        self._acted_at, self._acted = -math.inf, 0
        self.tracking = False
        self._reached: tuple[Any, ...] = _NOTHING
        self._watch: Callable[[float, int], None] | None = None
        self._handled = 0
        #: How far the run goes for now, and whether it stops after one event: compiled code does likewise.
        self.horizon, self.one = math.inf, False

    # As SimPy's, which keeps it under a private name, and no call of Python: agents ask at every signal.
    now = property(attrgetter("instant"))
    _now = property(attrgetter("instant"), lambda self, time: setattr(self, "instant", time))

    @property
    def reached(self) -> tuple[float, int, int]:
        """The latest (time, kind, order) among the events handled since `forget_reached` was called.

        What is due before it has happened, or would have if it were an event of its own.  It is no
        earlier than the present event, and later where one of this instant was scheduled after its turn.
        """
        time, kind, order = self._reached[:3]
        return time, kind, order

    def forget_reached(self) -> None:
        """Begin anew: what becomes due from now on, even now, is ahead of all that has been handled."""
        self._reached = _NOTHING

    @property
    def upcoming(self) -> tuple[float, int, int]:
        """The (time, kind, order) of the event that is due next; at infinity if there is none."""
        # Compiled code goes on until here and no further: only an event can change what it has not foreseen.
        if not self._queue:
            return math.inf, 0, 0
        time, kind, order, _ = self._queue[0]
        return time, int(kind), order  # compiled code would be compiled once more for an EventKind

    @property
    def acted(self) -> tuple[float, int]:
        """When an agent last acted, and the last turn that was over then."""
        return self._acted_at, self._acted

    def has_acted(self, agent: int | None = None) -> bool:
        """Tell whether an agent's turn at this instant is over.

        Parameters
        ----------
        agent : int, optional
            i; default: all agents.

        Returns
        -------
        bool
            True once an agent with the same or a later turn has acted at this instant.
        """
        # Turns of agents are their indices: once one has acted, the turns of all before it are over.  Those
        # of all agents are, for certain, only once an ACT that was given no order has happened.
        return self._acted_at == self.instant and (FIRST_ORDER if agent is None else agent) <= self._acted

    def _note_act(self, event: simpy.Event) -> None:
        assert isinstance(event, _Due)  # noqa: S101 - `at` makes no others
        # The first callback of the event, so that the code that acts on it reads its own turn as over.
        self._acted_at, self._acted = self.instant, event.order

    def reserve(self, how_many: int) -> int:
        """Set aside consecutive order numbers, to be used by events scheduled later.

        Parameters
        ----------
        how_many : int
            How many numbers.

        Returns
        -------
        int
            The first of them.
        """
        # Used or not, they are gone: that a copy is lost must not move the turn of what is scheduled later.
        first = next(self._eid)
        self._eid = count(first + how_many)
        return first

    def begin(self, name: str, make: Maker, place: int | None = None) -> None:
        """Start a process that can be entered again in another run.

        Parameters
        ----------
        name : str
            Its name there and here.
        make : callable
            Called with False gives the generator of a process that begins, with True one that goes on: from
            where its owner says, and up to where it waits at once.
        place : int, optional
            Of an intervention that is listed: at one instant, its events of the kind INTERVENE come after
            those of lower places, whenever they are scheduled.
        """
        process = self.process(make(False))
        if place is not None:
            self._places[process] = place
        self._begun[name] = _Begun(process, make, place)

    def place_of(self, event: simpy.Event | None) -> Place | None:
        """Tell where an event stands in the queue.

        Parameters
        ----------
        event : Event, optional
            What has been scheduled; None stands nowhere.

        Returns
        -------
        Place or None
            None where it has happened.
        """
        for time, kind, order, queued in self._queue:
            if queued is event:
                return Place(time, int(kind), order, getattr(queued, "turn", 0))
        return None

    def own(self, time: float, kind: EventKind, order: int | None = None) -> simpy.Event:
        """Schedule an event, as `at` does, whose place its owner keeps, and puts back in another run.

        Parameters
        ----------
        time : float
            When; not before now.
        kind : EventKind
            What it is.
        order : int, optional
            Decides among events of the same time and kind.

        Returns
        -------
        simpy.Event
            Already triggered.
        """
        event = self.at(time, kind, order)
        assert isinstance(event, _Due)  # noqa: S101 - `at` makes no others
        event.owned = True
        return event

    def put_back(self, place: Place) -> simpy.Event:
        """Schedule an event where one stands in the run that is gone on with.

        Parameters
        ----------
        place : Place
            As `place_of` has returned it there.

        Returns
        -------
        simpy.Event
            Already triggered, and owned by the caller.
        """
        event = _Due(self, place.order, place.turn)
        event.owned = True
        heappush(self._queue, (place.time, place.kind, place.order, event))  # type: ignore[misc]
        return event

    @property
    def beginning(self) -> int:
        """How many processes have still to begin: as long as there is one, nothing else has happened."""
        return sum(kind == simpy.events.URGENT for _, kind, _, _ in self._queue)

    def state(self) -> dict[str, Any]:
        """Return where time stands, what is due and which processes wait for it."""
        processes = {
            name: self.place_of(begun.process.target)
            for name, begun in self._begun.items()
            if begun.process.is_alive
        }
        awaited = {id(begun.process.target) for begun in self._begun.values()}
        for time, _, _, event in self._queue:
            if event.callbacks and id(event) not in awaited and not getattr(event, "owned", False):
                reason = "free of events that were scheduled from outside, which cannot be copied"
                raise InputError.of("run", f"one with an event at {time!r} in store", reason, _INSTEAD)
        # An event that no process waits for happens all the same: a step is one event.
        idle = [self.place_of(event) for *_, event in self._queue if not event.callbacks]
        order, turn = next(self._eid), next(self._turns)
        self._eid, self._turns = count(order), count(turn)
        return {
            "now": self.instant,
            "beginning": self.beginning,
            "order": order,
            "turn": turn,
            "acted": (self._acted_at, self._acted),
            "reached": self.reached,
            "processes": processes,
            "idle": idle,
        }

    def resume(self, state: Mapping[str, Any], anew: Collection[str] = ()) -> None:
        """Go on from what `state` has returned, once every other part has done so.

        Parameters
        ----------
        state : mapping
            What it has returned.
        anew : collection of str
            Names of processes that begin now; those that neither go on nor begin are over.
        """
        known, self._begun, self._places = self._begun, {}, {}
        self._queue.clear()
        self.instant, (self._acted_at, self._acted) = state["now"], state["acted"]
        self._reached = tuple(state["reached"])
        for place in state["idle"]:
            self.put_back(Place(*place))
        for name, place in state["processes"].items():
            self._kept = None if place is None else Place(*place)
            self._enter(name, known[name], again=True)
        # Entering has used numbers up, which have been given to others in the meantime.
        self._eid, self._turns = count(state["order"]), count(state["turn"])
        for name in anew:
            self._enter(name, known[name], again=False)

    def _enter(self, name: str, begun: _Begun, *, again: bool) -> None:
        """Let a process run to where it waits, within no event."""
        process = self.process(begun.make(again))
        self._begun[name] = begun._replace(process=process)
        if begun.place is not None:
            self._places[process] = begun.place
        # SimPy has scheduled an event in which it begins, ahead of all that is due.
        *_, first = heappop(self._queue)
        callbacks, first.callbacks = first.callbacks, None  # type: ignore[assignment]
        for callback in callbacks:
            callback(first)

    def at(self, time: float, kind: EventKind, order: int | None = None) -> simpy.Event:
        """Schedule an event at an absolute time, for a process to yield.

        Parameters
        ----------
        time : float
            When; not before now.
        kind : EventKind
            What it is; decides among events at the same time.
        order : int, optional
            Decides among events of the same time and kind; default: the place of an intervention that is
            listed, else the turn in which it was scheduled.

        Returns
        -------
        simpy.Event
            Already triggered: yield it, or add callbacks.

        Raises
        ------
        InputError
            If the time is in the past or no number.
        """
        if not self.instant <= time < math.inf:
            raise InputError.of("time", time, f"finite and not before the present, {self.instant!r}")
        if self._kept is not None:
            place, self._kept = self._kept, None
            return self.put_back(place)
        # A list of interventions is an order that its author can see; when each has scheduled what, is not.
        if kind is _INTERVENE and order is None:
            order = self._places.get(self.active_process)
        event = _Due(self, next(self._eid) if order is None else order, next(self._turns))
        if kind is _ACT:
            event.callbacks.append(self._note_act)
        heappush(self._queue, (time, kind, event.order, event))  # type: ignore[misc]  # SimPy has two kinds
        return event

    def advance(self, time: float, kind: EventKind, order: int) -> bool:
        """Move on to what is due at a later time within the present event, if nothing else comes first.

        Parameters
        ----------
        time : float
            When it is due: not before now, and before the end of the run.
        kind : EventKind
            What it is.
        order : int
            Decides among events of the same time and kind.

        Returns
        -------
        bool
            Whether the clock stands at `time` now; if not, it has to be scheduled.
        """
        # A tuple of three is before one of four that begins with it: an event of this very key comes later.
        queue = self._queue
        if queue and queue[0][0] <= time and queue[0] < (time, kind, order):
            return False
        self.instant = time
        # Not always later: copies without latency land after the look that has sent them, and their kind is
        # before its.  What counts as reached never falls within one instant.
        if self.tracking:
            self._reached = max(self._reached, (time, kind, order))
        return True

    @property
    def watched(self) -> bool:
        """Whether the progress of the run is watched."""
        return self._watch is not None

    def report(self, time: float) -> None:
        """Tell the watcher of the run how far it has come within the present event.

        Parameters
        ----------
        time : float
            How far.
        """
        if self._watch is not None:
            self._watch(time, self._handled)

    def run_to(
        self, until: float, watch: Callable[[float, int], None] | None = None, *, one: bool = False
    ) -> None:
        """Handle every event before `until`, and none that is due at `until` itself.

        Parameters
        ----------
        until : float
            The end; the clock stands there afterwards.
        watch : callable, optional
            Called with (time, events handled) every few thousand events and at the end; where compiled
            code handles many in one, from there, and these are not counted.
        one : bool
            Whether to handle the next event alone, if there is one; the clock stands at that then.
        """
        self.horizon, self.one = until, one
        handled, self._handled, self._watch = 0, 0, watch
        queue, tracking = self._queue, self.tracking
        while queue and queue[0][0] < until:
            # `simpy.Environment.step` without what only its own `run` needs; it is called for every event.
            present = heappop(queue)
            if tracking:
                self._reached = max(self._reached, present)
            self.instant, _, _, event = present
            # None instead of a list is how SimPy knows an event that has been handled.
            callbacks, event.callbacks = event.callbacks, None  # type: ignore[assignment]
            for callback in callbacks:
                callback(event)
            # A process has failed and no other waits for it.
            if not event._ok and not hasattr(event, "_defused"):
                raise event._value
            if one:
                # Compiled agents may have begun anew within it: what is asked of them now is all up to here.
                if tracking:
                    self._reached = max(self._reached, (self.instant, *present[1:3]))
                return
            handled += 1
            if watch is not None and handled % _WATCH_EVERY == 0:
                self._handled = handled
                watch(self.instant, handled)
        self.instant = until
        # Before every kind at the end: what is due at `until` itself does not happen, also in compiled code.
        self._reached = max(self._reached, (until, -1, 0))
        if watch is not None:
            watch(until, handled)


class Mailbox(simpy.Event):
    """An event that hands values to the process which waits for it, at once and any number of times.

    `simpy.Event.succeed` would queue the process behind others of the same instant.
    """

    def hand(self, value: object) -> None:
        """Resume the waiting process with a value, within the present event."""
        # A fresh list before a process resumes: SimPy takes the event for one that has not happened, and the
        # process that yields it again from within waits for the next value.
        waiting, self.callbacks = self.callbacks, []
        self._ok = True
        self._value = value
        for callback in waiting:
            callback(self)
