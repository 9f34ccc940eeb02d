"""The SimPy process that lets a fleet's control unit look in compiled code until something else is due."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import simpy

from aimd_des.channel import BroadcastChannel, CompiledLink
from aimd_des.channel.transmit_kernel import ChannelTable, refuse
from aimd_des.dynamics.clocks import Clock
from aimd_des.dynamics.totals import piece
from aimd_des.engine.control_unit import ControlUnit, CrossingTable, SampledTable
from aimd_des.engine.control_unit.base import NEVER
from aimd_des.engine.control_unit.crossing import Unanswered, standstill, within
from aimd_des.engine.control_unit.sampled import asked
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind, Mailbox, Place
from aimd_des.engine.observers import ConstantPieces, Observer
from aimd_des.engine.system import System
from aimd_des.fleet.arrays import LAST, NO_ANSWERS
from aimd_des.fleet.broadcast_kernel import FleetChannel
from aimd_des.fleet.compiled_agents import CompiledAgents, told_at_once
from aimd_des.fleet.control_kernels import sample, sense
from aimd_des.fleet.control_state import (
    IMPROPER,
    LOOK,
    NO_ROOM,
    OF_A_UNIT,
    REACHED,
    REFUSED,
    ROW,
    STANDSTILL,
    TICK,
    UNSCHEDULED,
    FleetControl,
    Limits,
)
from aimd_des.fleet.control_table import compiled_probability
from aimd_des.fleet.observer_kernels import ObservedTotals
from aimd_des.utils import returned_values
from aimd_des.utils.direct_calls import Direct
from aimd_des.utils.errors import SimulationError
from aimd_des.utils.rng import Purpose

# How often the observer of the run is told how far it has come.
_REPORTS = 200

#: How many agents are looked at in a stretch without an observer, and in how many looks at least.
LOOKED_AT, LEAST_STEPS = 1 << 21, 16

# Signals that are handed over in one go.
_SIGNALS = 1 << 12


class ControlProcess:
    """A control unit that has a table: the samples of its process, many of them in an event of SimPy."""

    def __init__(
        self,
        fleet: CompiledAgents,
        control_unit: ControlUnit,
        table: SampledTable | CrossingTable,
        observer: Observer,
    ) -> None:
        self.fleet, self.control_unit, self.table = fleet, control_unit, table
        self.system = system = fleet.system
        common = system.clocks is None or system.clocks.common
        own = table.probability if isinstance(table, SampledTable) else None
        # Kept as long as the run: its address means nothing without it.
        self._probability = None if own is None else compiled_probability(own)
        self.control = self._control(common)
        self.channel = self._channel()
        # The ticks of a common clock are followed in compiled code.  The processes that would do so elsewhere
        # exist already; they read what is set here when they begin, which is when the run does.
        if isinstance(fleet.overshoot, ConstantPieces) and common and not self.control.crossing:
            fleet.overshoot.following = False
            fleet.integrals = fleet.integrals._replace(steps=True)
        observer.watching = False
        self.observer = observer
        self.observed = self._observed()
        self._steered = Direct(sense if self.control.crossing else sample)
        # Compiled code cannot be interrupted, and Ctrl-C is not to wait long.  For any value the results are
        # the same.
        self._steps = max(LOOKED_AT // system.problem.n_agents, LEAST_STEPS)
        self._mailbox = Mailbox(system.env)
        self._alarm: simpy.Event | None = None
        system.parts["control"] = self
        system.conditions.on_tightening.append(self._tightened)
        system.conditions.on_recovery.append(self._recovered)
        system.conditions.on_channel.append(self._rewire)
        if self.control.crossing:
            system.conditions.on_hold_off.append(self._retimed)

    def process(self, again: bool) -> ProcessGenerator:
        """Look for as long as the run lasts."""
        if not again:
            # A unit that takes the place of another one in a run that is forked knows nothing of before.
            control, now = self.control, float(self.system.env.now)
            control.look[0] = Clock(control.period, control.phase).next_tick(now)
            control.look_time[:] = now
            self._set_alarm()
        while True:
            # Only this event lets time pass for SimPy; compiled looks lie between it and the next event.
            yield self._mailbox
            # What compiled code has stopped for is done within the same event, and the looks go on; but not
            # where the run stops after one event: agents would be ahead of it.
            while (status := self._steer()) == NO_ROOM or (status != REACHED and not self.system.env.one):
                pass
            self._set_alarm()

    def state(self) -> dict[str, Any]:
        """Return what the unit knows, and its alarm."""
        kept = {name: getattr(self.control, name) for name in OF_A_UNIT}
        return {
            "kept": kept,
            "bounds": (self.control.shortest, self.control.longest),
            "alarm": self.system.env.place_of(self._alarm),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned; the alarm is set once time stands where it did."""
        for name, kept in state["kept"].items():
            getattr(self.control, name)[:] = kept
        shortest, longest = state["bounds"]
        self.control = self.control._replace(shortest=shortest, longest=longest)

    def resume_observer(self) -> None:
        """Take the rows over that the observer has left."""
        self.observed = self._observed()

    def resume_events(self, state: Mapping[str, Any]) -> None:
        """Set the alarm as it was."""
        if state["alarm"] is not None:
            self._alarm = self.system.env.put_back(Place(*state["alarm"]))
            self._alarm.callbacks.append(self._ring)

    def _observed(self) -> ObservedTotals:
        # Without the last time, the end of the run: `Observer.finish` looks there, after the last event.
        return ObservedTotals(
            self.observer.times[:-1].copy(),
            self.observer.total_demand,
            self.observer.total_average,
            self.observer.row,
            np.zeros(self.system.problem.n_resources, dtype=np.int64),
            piece(self.system.problem.n_resources),
        )

    def _control(self, common: bool) -> FleetControl:
        system, table = self.system, self.table
        m = system.problem.n_resources
        # One record for both kinds, since most kernels serve both; what the other one needs stays unused.
        sampled = table if isinstance(table, SampledTable) else SampledTable(1.0)
        crossing = table if isinstance(table, CrossingTable) else CrossingTable(0.0, 0.0)
        unanswered = Unanswered(system)
        return FleetControl(
            crossing=table is crossing,
            period=sampled.period,
            phase=sampled.phase,
            shortest=crossing.hold_off,
            longest=crossing.longest_hold_off,
            delay=table.sensing_delay,
            low=sampled.low,
            high=sampled.high,
            probability=0 if self._probability is None else self._probability.address,
            key=system.keys[Purpose.SENSING],
            failed=system.conditions.failed,
            look=np.zeros(1, dtype=np.int64),
            look_time=np.zeros(m),
            awaits_crossing=np.zeros(m, dtype=np.bool_),
            growth=system.conditions.growth,
            instant=np.full(m, NEVER),
            # The arrays that `Unanswered` keeps up to date when growth or demand changes from outside.
            unanswered=unanswered.level,
            since=unanswered.since,
            hold_off=np.full(m, crossing.hold_off),
            holding=np.zeros(m, dtype=np.bool_),
            repeated=np.zeros(m, dtype=np.int64),
            due=np.zeros(m, dtype=np.bool_),
            total=np.zeros(m),
            now=np.zeros(1),
            moment=np.zeros(1 if common else system.problem.n_agents),
            turns=np.full(3, UNSCHEDULED),
            answers=told_at_once(system),
        )

    def _channel(self) -> FleetChannel:
        system, account = self.system, self.system.transmitter
        link, n = system.link, system.problem.n_agents
        # Compiled code takes a channel in any case; one that it does not use is as good as another.
        table = link.table if isinstance(link, CompiledLink) else _unused_channel(system)
        # A log wants every copy, and agents that are processes want to be woken: `Transmitter` does both.
        return FleetChannel(
            compiled=isinstance(link, CompiledLink) and system.log is None and bool(self.fleet.members.all()),
            table=table,
            cut=system.conditions.cut,
            numbers=account.numbers,
            delivered=account.delivered,
            lost=account.lost,
            duplicated=account.duplicated,
            arrival=np.zeros(n),
            second=np.zeros(n),
            order=np.zeros(1, dtype=np.int64),
            time=np.empty(_SIGNALS),
            resource=np.empty(_SIGNALS, dtype=np.int64),
            number=np.empty(_SIGNALS, dtype=np.int64),
            held=np.zeros(1, dtype=np.int64),
            code=np.zeros(1, dtype=np.int64),
        )

    def _next(self) -> tuple[float, EventKind, int]:
        """Return when there is something to be done next, and its turn at that instant."""
        control, integrals, observed = self.control, self.fleet.integrals, self.observed
        # A process takes its turn when it schedules its next look.  Compiled looks cannot, but nothing else
        # has taken one since; so the turns that are taken now have the same order among those of all others.
        # Of a row and a tick at one instant the order does not matter: both only look.
        for turn, number in enumerate(control.turns.tolist()):
            if number == UNSCHEDULED:
                control.turns[turn] = self.system.env.reserve(1)
        if control.crossing:
            # The index of the resource is its turn, as for the processes of `Crossing`.
            times = control.look_time.tolist()
            due = [(min(times), EventKind.SENSE, times.index(min(times)))]
        else:
            look = control.phase + int(control.look[0]) * control.period
            due = [(look, EventKind.SENSE, int(control.turns[LOOK]))]
        if observed.row[0] < len(observed.times):
            due.append((float(observed.times[observed.row[0]]), EventKind.OBSERVE, int(control.turns[ROW])))
        if integrals.steps:
            assert self.system.clocks is not None  # noqa: S101 - only agents that tick are measured in steps
            tick = self.system.clocks.time(0, int(integrals.tick[0]))
            due.append((tick, EventKind.OBSERVE, int(control.turns[TICK])))
        return min(due)

    def _set_alarm(self) -> None:
        # An event of SimPy cannot be taken back: an earlier alarm still happens, without effect.
        if self._alarm is not None and self._alarm.callbacks:
            self._alarm.callbacks.clear()
        # No agent may be present to grow, and nothing be left to observe: then other code has to set it.
        due, self._alarm = self._next(), None
        if due[0] < math.inf:
            self._alarm = self.system.env.own(*due)
            self._alarm.callbacks.append(self._ring)

    def _ring(self, _: simpy.Event) -> None:
        self._mailbox.hand(None)

    def _tightened(self, time: float, resource: int) -> None:
        """Look again at once where something has changed from outside, which no bound has foreseen."""
        # During a hold-off nothing is looked at; its end is a look in any case.
        if self.control.awaits_crossing[resource]:
            self.control.look_time[resource] = time
            self._set_alarm()

    def _recovered(self, time: float) -> None:
        """Let the unit that takes over look at once; it knows of no hold-off."""
        # A sampled unit looks at its times whether it is up or down.
        if self.control.crossing:
            self.control.holding[:] = False
            self.control.hold_off[:] = self.control.shortest
            self.control.awaits_crossing[:] = True
            self.control.look_time[:] = time
            self._set_alarm()

    def _retimed(self, shortest: float, longest: float) -> None:
        """Take new bounds of the hold-off; one that goes on ends when it would have ended."""
        # Compiled code reads them from the record that it is given at each stretch.
        self.control = self.control._replace(shortest=shortest, longest=longest)
        hold_off = self.control.hold_off
        hold_off[:] = [within(one, shortest, longest) for one in hold_off.tolist()]

    def _rewire(self) -> None:
        """Send over the channel of the run as it is now."""
        # Between two stretches: all signals of the last one have been noted.
        self.channel = self._channel()

    def _steer(self) -> int:
        """Go on sampling to the next event; do what compiled code has stopped for."""
        env, control, channel, fleet = self.system.env, self.control, self.channel, self.fleet
        # Between two stretches a listener may begin, and demand may change from outside: that comes
        # before the answers that compiled code will fold into the same integrals.
        fleet.listen()
        fleet.flush()
        # Listeners outside are told in time: their changes come before the next signal.
        told = fleet.agents.reported != NO_ANSWERS and not fleet.integrals.lines
        seen = bool(self.system.transmitter.on_leave)
        if told or seen:
            channel = channel._replace(compiled=False)
        due, until, stride, steps = self._next()[0], env.horizon, math.inf, self._steps
        if env.one or env.watched:
            # However short the run, the next look is within the stride.
            length = 0.0 if env.one else self.system.until / _REPORTS
            stride, steps = max(due + length, math.nextafter(due, math.inf)), LAST
        # Kind 0 comes before all others: what is due at the end, or where the stride ends, is left alone.
        # The stride ends a stretch without being an event, so it does not say when a signal can be cut.
        upcoming = min(env.upcoming, (until, 0, 0))
        horizon, kind, order = min(upcoming, (stride, 0, 0))
        acted_at, acted = env.acted
        # A time of the user's own may be a whole number, which has another type.
        limits = Limits(float(horizon), kind, order, float(upcoming[0]), float(acted_at), acted, steps)
        # As many as a stretch can use, of which most remain unused: only their order matters.  All that is
        # scheduled before it has lower numbers, and all after it higher ones.
        channel.order[0] = env.reserve(2 * len(channel.arrival) * _SIGNALS)
        status: int = self._steered((fleet.agents, control, channel, fleet.integrals, self.observed), limits)
        # Noted before anything else is sent, so that signals stand in the order in which they were sent.
        count = int(channel.held[0])
        channel.held[0] = 0
        self.system.transmitter.sent.extend(
            channel.time[:count], channel.resource[:count], channel.number[:count]
        )
        # Copies that were sent at the look of this event land after it, though their kind comes before its.
        env.forget_reached()
        env.report(limits.horizon)
        if status == NO_ROOM:
            fleet.make_room(2 * control.due.size)  # as many as `_crowded` asks for
            # Settling tells listeners, which makes room among answers; it must not go beyond the next look.
            if told:
                env.advance(*self._next())
                fleet.settle()
        elif status != REACHED:
            self._stand_in(status, count)
        return status

    def _stand_in(self, status: int, sent: int) -> None:
        """Do what compiled code cannot, at the time of its last look."""
        resources, now = np.flatnonzero(self.control.due).tolist(), float(self.control.now[0])
        # SimPy's clock stands at the alarm; what is sent or said now needs that of the look.  Nothing is due
        # in between, so it can be moved.
        self.system.env.advance(now, EventKind.SENSE, resources[0])
        if status == REFUSED:
            resource, departure = int(self.channel.resource[sent - 1]), now + self.control.delay
            raise refuse(self.channel.table, int(self.channel.code[0]), resource, departure)
        if status == STANDSTILL:
            raise SimulationError(standstill(self.system, resources[0], self.control.shortest))
        if status == IMPROPER:
            self._ask_again(resources[0])
        for resource in resources:
            self.system.broadcast(resource, self.control.delay)

    def _ask_again(self, resource: int) -> None:
        """Let the check of a process refuse what a function of the user's own has given."""
        assert isinstance(self.table, SampledTable)  # noqa: S101 - others have no such function
        control, field = self.control, returned_values.said_by(self.control_unit, "table")
        total, limit = float(control.total[resource]), float(self.system.parameters.limit[resource])
        asked(self.table, field, total, limit, float(control.now[0]), int(control.look[0]) - 1, resource)


def _unused_channel(system: System) -> ChannelTable:
    link = BroadcastChannel().open(system.problem.n_agents, system.keys)
    assert isinstance(link, CompiledLink)  # noqa: S101 - of built-in models
    return link.table
