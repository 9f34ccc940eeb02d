"""A control unit that senses the instant at which total demand reaches its threshold."""

import math
from dataclasses import dataclass

import numpy as np
import simpy

from aimd_des.engine.control_unit.base import NEVER, CrossingTable
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind, Mailbox
from aimd_des.engine.system import System
from aimd_des.results.overload import Opportunities
from aimd_des.utils import validation
from aimd_des.utils.errors import SimulationError
from aimd_des.utils.jit import formula
from aimd_des.utils.old_keywords import keywords
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief

# Broadcasts at one instant, one after another without a response, after which time is
# taken not to advance.  If responses were possible at all, with a chance of 1/100 say, to get here
# would have a probability of 1e-43.
MOST_AT_ONE_INSTANT = 10_000


# Below this share of the total, a difference is rounding and no answer.
_ROUNDING = 1e-9


@formula
def soonest_crossing(now: float, limit: float, total: float, growth: float) -> float:
    """Return when total demand can reach its threshold at the earliest."""
    # A crossing unit signals at the threshold; a sampled one, as Algorithm 1 has it, only above it.
    if total >= limit:
        return now
    # May round to `now` though the total is still below: that counts as reached, or time would not advance.
    return now + (limit - total) / growth if growth > 0.0 else math.inf


@formula
def adapted(hold_off: float, shortest: float, longest: float, expected: float, total: float) -> float:
    """Return the next hold-off where one has ended with demand still at its threshold."""
    # Half as long where the answers did not suffice; twice as long where no agent has answered
    # yet, since the signal may still be on its way.  `expected` is the total without answers: they are small
    # beside it, but not as small as the rounding of two sums over all agents.
    if expected - total > _ROUNDING * expected:
        return max(0.5 * hold_off, shortest)
    return min(2.0 * hold_off, longest)


def within(hold_off: float, shortest: float, longest: float) -> float:
    """Bring a hold-off into bounds that have changed."""
    return min(max(hold_off, shortest), longest)


class Unanswered:
    """What total demand would be if no agent had responded since the last signal; all other changes count.

    Attributes
    ----------
    level, since : ndarray, shape (m,)
        What it was, in units of the resources, and when; it grows as total demand does.
    """

    def __init__(self, system: System) -> None:
        self.level, self.since = np.zeros((2, system.problem.n_resources))
        self._env, self._growth = system.env, system.conditions.growth
        system.conditions.on_piece.append(self._before_growth_changes)
        system.on_intervention.append(self._changed)

    def _before_growth_changes(self) -> None:
        # Told just before, while the growth is still that of the line that ends here.
        self.level += self._growth * (self._env.now - self.since)
        self.since[:] = self._env.now

    def _changed(self, time: float, resource: int, change: float) -> None:
        self.level[resource] += change


@built_in("control_unit", "crossing", hold_off=1.0)
@keywords("refractory", "longest")
@brief
@dataclass(frozen=True)
class Crossing:
    """A control unit that senses the instant at which total demand reaches its threshold.

    It broadcasts at that instant and then holds off.  At the end of the hold-off it broadcasts
    again at once if demand is still at or above the threshold, else at the next upward crossing.
    The instant is solved for: demand is piecewise linear.

    Parameters
    ----------
    hold_off : float
        How long it holds off, at least 0 and in units of time; 0 is the ideal model of the literature,
        which takes signals that arrive at once.
    sensing_delay : float
        How long after a crossing its signal leaves the control unit, at least 0; the hold-off
        counts from the crossing.
    longest_hold_off : float, optional
        Lets the hold-off adapt between `hold_off`, which must then be greater than 0, and this.  Where
        demand is still at the threshold at its end, it is doubled if no agent has responded yet, and halved
        if agents have responded and that did not suffice.  Keep it below the mean time between the signals
        that are needed, 1 over `theory.signal_rate`: beyond, too few can be sent at any latency.

    Notes
    -----
    The adaptive hold-off saves signals while others are on their way, without being told of latencies, and
    shrinks where losses make more signals necessary.  It is to a signal what the back-off of the
    retransmission timer is to a packet of TCP (RFC 6298).
    """

    hold_off: float
    sensing_delay: float = 0.0
    longest_hold_off: float | None = None

    def __post_init__(self) -> None:
        for name in ("hold_off", "sensing_delay"):
            object.__setattr__(self, name, validation.number(name, getattr(self, name), low=0.0))
        if self.longest_hold_off is not None:
            validation.number("hold_off", self.hold_off, low=0.0, low_open=True, remedy="0 cannot be doubled")
            longest = validation.number("longest_hold_off", self.longest_hold_off, low=self.hold_off)
            object.__setattr__(self, "longest_hold_off", longest)

    @property
    def bounds(self) -> tuple[float, float]:
        """The shortest and the longest hold-off, in units of time."""
        return self.hold_off, self.hold_off if self.longest_hold_off is None else self.longest_hold_off

    def table(self) -> CrossingTable:
        """Say how long the unit holds off.

        Returns
        -------
        CrossingTable
            The bounds of the hold-off, and the sensing delay.
        """
        return CrossingTable(*self.bounds, self.sensing_delay)

    def opportunities(self, start: float, end: float) -> Opportunities:
        """Count when it may signal.

        Parameters
        ----------
        start, end : float
            From when to when.

        Returns
        -------
        Opportunities
            As often as the shortest hold-off allows; without one nothing is told.
        """
        shortest, longest = self.bounds
        return Opportunities((end - start) / shortest if shortest > 0.0 else math.inf, longest)

    def process(self, system: System) -> ProcessGenerator:
        """Sense each resource on its own."""
        # Resources sense apart, each when its own total can cross; two at one instant go by their index.
        unanswered = Unanswered(system)
        for resource in range(system.problem.n_resources):
            system.env.process(self._sense(system, resource, unanswered))
        yield from ()  # a generator is what is asked for, and there is nothing left to wait for

    def _sense(self, system: System, resource: int, unanswered: Unanswered) -> ProcessGenerator:
        """Go from one possible crossing to the next: responses only lower the total, growth bounds it."""
        env, failed = system.env, system.conditions.failed
        # The same memory, of which numbers are read one at a time.
        limit = memoryview(system.parameters.limit)  # type: ignore[arg-type]
        growth = memoryview(system.conditions.growth)  # type: ignore[arg-type]
        alarm = _Alarm(system, resource, *self.bounds)
        at_this_instant, instant = 0, NEVER
        level, since = unanswered.level, unanswered.since
        # By an event of its kind, so that interventions at time 0 come before the first look.
        yield alarm.at(env.now, sooner_if_raised=False)
        while True:
            now, total = env.now, system.total(resource)
            soonest = soonest_crossing(now, limit[resource], total, growth[resource])
            if soonest > now or failed[0]:
                alarm.holding = False
                # A unit that is down waits for no time at all: `_recovered` wakes the one that takes over.
                yield alarm.at(math.inf if soonest <= now else soonest, sooner_if_raised=True)
                continue
            # At the threshold, or so near below it that no representable time lies in between.
            at_this_instant = at_this_instant + 1 if now == instant else 1
            if at_this_instant > MOST_AT_ONE_INSTANT:
                raise SimulationError(standstill(system, resource, alarm.shortest))
            if alarm.holding:
                expected = float(level[resource] + growth[resource] * (now - since[resource]))
                bounds = alarm.shortest, alarm.longest
                alarm.hold_off = adapted(alarm.hold_off, *bounds, expected, total)
            # Before the broadcast, which may be answered within it: what follows counts from this total.
            instant, alarm.holding = now, True
            level[resource], since[resource] = total, now
            system.transmitter.send(resource, now, self.sensing_delay, total)
            # The hold-off ends when it ends, however tight things become: its end is a look in any case.
            yield alarm.at(now + alarm.hold_off, sooner_if_raised=False)


def standstill(system: System, resource: int, hold_off: float) -> str:
    """Say why time cannot advance, and what to do about it."""
    name = system.problem.resource_names[resource]
    return (
        f"time {system.env.now!r}, resource {name}: after {MOST_AT_ONE_INSTANT} signals at this instant "
        "total demand is still at its threshold, and time cannot advance since hold_off = "
        f"{hold_off!r}; set hold_off greater than 0, or let signals arrive at once and reach "
        "an agent that can respond"
    )


class _Alarm:
    """Wakes the sensing of one resource at a time, or before it when things have become tighter.

    `hold_off` is the present one, and `holding` says whether it is what is waited for.
    """

    def __init__(self, system: System, resource: int, shortest: float, longest: float) -> None:
        self.env = system.env
        self.resource = resource
        self.shortest = self.hold_off = shortest
        self.longest = longest
        self.mailbox = Mailbox(system.env)
        self.setting: simpy.Event | None = None
        self.watchful = self.holding = False
        system.conditions.on_tightening.append(self._tightened)
        system.conditions.on_recovery.append(self._recovered)
        system.conditions.on_hold_off.append(self._retimed)

    def at(self, time: float, *, sooner_if_raised: bool) -> Mailbox:
        """Set the alarm, for no time at all if it is infinite; an earlier setting no longer counts."""
        self.watchful, self.setting = sooner_if_raised, None
        if time < math.inf:
            self.setting = self.env.at(time, EventKind.SENSE, self.resource)
            self.setting.callbacks.append(self._ring)
        return self.mailbox

    def _ring(self, event: simpy.Event) -> None:
        # SimPy cannot take an event back, so those of earlier settings still ring.
        if event is self.setting:
            self.mailbox.hand(None)

    def _tightened(self, time: float, resource: int) -> None:
        if self.watchful and resource == self.resource:
            self.at(time, sooner_if_raised=True)

    def _retimed(self, shortest: float, longest: float) -> None:
        """Take new bounds of the hold-off; one that goes on ends when it would have ended."""
        self.shortest, self.longest = shortest, longest
        self.hold_off = within(self.hold_off, shortest, longest)

    def _recovered(self, time: float) -> None:
        """Let the unit that takes over look at once; it knows of no hold-off."""
        # At a SENSE event of its own: other interventions of this instant come first.
        self.holding, self.hold_off = False, self.shortest
        self.at(time, sooner_if_raised=True)
