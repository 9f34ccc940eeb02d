"""The order of events at one instant, on SimPy's environment.

Events are handled by (time, kind, order).  Kinds at one instant:

    INTERVENE < DELIVER < SENSE < OBSERVE < ACT

Interventions first, then signals that arrive, then the control unit looks, then observers look,
then agents tick.  Within a kind, agents act in the order of their index, copies land in the order
of their broadcasts and then of the agents, interventions that are listed take place in the order of the
list, and everything else keeps the order in which it was scheduled.  Events are scheduled at absolute
times: now + (t - now) is not always t.

This is the only module that touches what SimPy keeps private.
"""

import math
from collections.abc import Callable, Generator
from enum import IntEnum
from heapq import heappop, heappush
from itertools import count
from operator import attrgetter
from typing import Any

import simpy

from aimd_des.utils.errors import InputError

Callback = Callable[[Any], None]

# Order numbers below this are indices of agents or resources, and places of interventions that are listed: at
# one instant these come before what keeps the order in which it was scheduled.
FIRST_ORDER = 1 << 40

# Events between two reports to whoever watches the run: enough for a progress bar, too few to be felt.
_WATCH_EVERY = 1 << 12

# Before every event: what `reached` is where nothing has happened that counts.
_NOTHING = (-math.inf, 0, 0)


class EventKind(IntEnum):
    """What an event is, in the order of handling at one instant; SimPy itself uses 0 and 1."""

    INTERVENE = 2
    DELIVER = 3
    SENSE = 4
    OBSERVE = 5
    ACT = 6


class _Due(simpy.Event):
    """An event of a known time; events that are given the same order keep their turn."""

    def __init__(self, env: simpy.Environment, order: int, turn: int) -> None:
        super().__init__(env)
        # Triggered already, as SimPy's own timeouts are: `env.at` puts it into the queue.
        self._ok = True
        self._value = None
        self.order = order
        self.turn = turn

    def __lt__(self, other: "_Due") -> bool:
        # The queue compares events only where time, kind and order are equal, which SimPy's own never are.
        return self.turn < other.turn


class OrderedEnvironment(simpy.Environment):
    """A SimPy environment in which simultaneous events have an order that means something.

    Attributes
    ----------
    tracking : bool
        Whether `reached` is kept up to date; set before the run by whoever needs it.
    """

    def __init__(self) -> None:
        super().__init__()
        self._now: float = 0.0
        # SimPy numbers its own events from here, too: there is one sequence of order numbers.
        self._eid = count(FIRST_ORDER)
        # Several events may be given the same order: those keep the turn in which they were scheduled.
        self._turns = count()
        self._places: dict[simpy.Process | None, int] = {}
        self._acted_at, self._acted = -math.inf, 0
        self.tracking = False
        self._reached: tuple[Any, ...] = _NOTHING
        self._watch: Callable[[float, int], None] | None = None
        self._handled = 0
        #: How far the run goes for now, and whether it stops after one event: compiled code does likewise.
        self.horizon, self.one = math.inf, False

    # As SimPy's, and no call of Python: agents ask at every signal.
    now = property(attrgetter("_now"))

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
        """When somebody last acted, and the last turn that was over then."""
        return self._acted_at, self._acted

    def has_acted(self, agent: int | None = None) -> bool:
        """Tell whether an agent's turn at this instant is over.

        Parameters
        ----------
        agent : int, optional
            i; all agents unless given.

        Returns
        -------
        bool
            True once somebody with the same or a later turn has acted at this instant.
        """
        # Turns of agents are their indices: once one has acted, the turns of all before it are over.  Those
        # of all agents are, for certain, only once an ACT that was given no order has happened.
        return self._acted_at == self._now and (FIRST_ORDER if agent is None else agent) <= self._acted

    def _note_act(self, event: simpy.Event) -> None:
        assert isinstance(event, _Due)  # noqa: S101 - `at` makes no others
        # The first callback of the event, so that whoever acts on it reads its own turn as over.
        self._acted_at, self._acted = self._now, event.order

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

    def intervene(self, process: Generator[simpy.Event, Any, Any]) -> None:
        """Start a process that intervenes: at one instant after those that were started so before it.

        Parameters
        ----------
        process : generator
            Its events of the kind INTERVENE have that place, whenever they are scheduled.
        """
        self._places[self.process(process)] = len(self._places)

    def at(self, time: float, kind: EventKind, order: int | None = None) -> simpy.Event:
        """Schedule an event at an absolute time, for a process to yield.

        Parameters
        ----------
        time : float
            When; not before now.
        kind : EventKind
            What it is; decides among events at the same time.
        order : int, optional
            Decides among events of the same time and kind; unless given, the place of an intervention
            that is listed, else the turn in which it was scheduled.

        Returns
        -------
        simpy.Event
            Already triggered: yield it, or add callbacks.

        Raises
        ------
        InputError
            If the time is in the past or no number.
        """
        if not self._now <= time < math.inf:
            raise InputError.of("time", time, f"finite and not before the present, {self._now!r}")
        # A list of interventions is an order that its author can see; when each has scheduled what, is not.
        if kind is EventKind.INTERVENE and order is None:
            order = self._places.get(self.active_process)
        event = _Due(self, next(self._eid) if order is None else order, next(self._turns))
        if kind is EventKind.ACT:
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
        self._now = time
        # Not always later: copies without latency land after the look that has sent them, and their kind is
        # before its.  What counts as reached never falls within one instant.
        if self.tracking:
            self._reached = max(self._reached, (time, kind, order))
        return True

    @property
    def watched(self) -> bool:
        """Whether anybody wants to know how far the run has come."""
        return self._watch is not None

    def report(self, time: float) -> None:
        """Let whoever watches the run know how far it has come within the present event.

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
            self._now, _, _, event = present
            # None instead of a list is how SimPy knows an event that has been handled.
            callbacks, event.callbacks = event.callbacks, None  # type: ignore[assignment]
            for callback in callbacks:
                callback(event)
            # A process has failed and nobody waits for it.
            if not event._ok and not hasattr(event, "_defused"):
                raise event._value
            if one:
                return
            handled += 1
            if watch is not None and handled % _WATCH_EVERY == 0:
                self._handled = handled
                watch(self._now, handled)
        self._now = until
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
        # A fresh list before anybody is resumed: SimPy takes the event for one that has not happened, and the
        # process that yields it again from within waits for the next value.
        waiting, self.callbacks = self.callbacks, []
        self._ok = True
        self._value = value
        for callback in waiting:
            callback(self)
