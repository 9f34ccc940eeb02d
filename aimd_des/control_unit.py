"""The control unit: it looks at total demand and broadcasts one bit where that is too high (Algorithm 1)."""

from dataclasses import dataclass
from itertools import count
from typing import Protocol

import numpy as np
import simpy

from aimd_des import checks
from aimd_des.clock import Clock
from aimd_des.environment import Kind, Mailbox
from aimd_des.errors import SimulationError
from aimd_des.system import System
from aimd_des.transport import ProcessGenerator

__all__ = ["ControlUnit", "Crossing", "Sampled"]

# Broadcasts at one instant, one after another without anybody responding, after which time is
# taken to stand still.  If responses were possible at all, with a chance of 1/100 say, to get here
# would have a probability of 1e-43.
MOST_AT_ONE_INSTANT = 10_000


class ControlUnit(Protocol):
    """Anything that decides when capacity signals are broadcast."""

    def process(self, system: System) -> ProcessGenerator:
        """Live: the SimPy process of the control unit."""
        ...


@dataclass(frozen=True)
class Sampled:
    """A control unit that looks at ``phase + q * period``.

    Parameters
    ----------
    period : float
        Time between two looks, greater than 0.
    phase : float
        Time of the first look, at least 0.
    sensing_delay : float
        How long after a look its signals leave the control unit, at least 0.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    period: float = 1.0
    phase: float = 0.0
    sensing_delay: float = 0.0

    def __post_init__(self) -> None:
        clock = Clock(self.period, self.phase)
        object.__setattr__(self, "period", clock.period)
        object.__setattr__(self, "phase", clock.phase)
        delay = checks.number("sensing_delay", self.sensing_delay, low=0.0)
        object.__setattr__(self, "sensing_delay", delay)

    def process(self, system: System) -> ProcessGenerator:
        """Look, and broadcast for each resource whose total demand is above its threshold.

        Parameters
        ----------
        system : System
            The run in progress.

        Yields
        ------
        simpy.Event
            The next look.
        """
        clock = Clock(self.period, self.phase)
        for look in count():
            yield system.env.at(clock.time(look), Kind.SENSE)
            for resource in np.flatnonzero(system.totals() > system.law.limit).tolist():
                system.broadcast(resource, self.sensing_delay)


@dataclass(frozen=True)
class Crossing:
    """A control unit that senses the instant at which total demand reaches its threshold.

    It broadcasts at that instant and then holds off.  At the end of the hold-off it broadcasts
    again at once if demand is still at or above the threshold, else at the next upward crossing.
    The instant is solved for: demand is piecewise linear.

    Parameters
    ----------
    refractory : float
        The hold-off, at least 0 and in units of time; 0 is the ideal model of the literature,
        which takes signals that arrive at once.
    sensing_delay : float
        How long after a crossing its signal leaves the control unit, at least 0; the hold-off
        counts from the crossing.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    refractory: float
    sensing_delay: float = 0.0

    def __post_init__(self) -> None:
        for name in ("refractory", "sensing_delay"):
            object.__setattr__(self, name, checks.number(name, getattr(self, name), low=0.0))

    def process(self, system: System) -> ProcessGenerator:
        """Sense each resource on its own.

        Parameters
        ----------
        system : System
            The run in progress.

        Yields
        ------
        simpy.Event
            Nothing: there is a process for each resource.
        """
        for resource in range(system.problem.n_resources):
            system.env.process(self._sense(system, resource))
        yield from ()

    def _sense(self, system: System, resource: int) -> ProcessGenerator:
        """Go from one possible crossing to the next: responses only lower the total, growth bounds it."""
        env, limit = system.env, float(system.law.limit[resource])
        slope = float(np.cumsum(system.law.increase[resource])[-1])
        alarm = _Alarm(system, resource)
        at_this_instant, instant = 0, -1.0
        yield alarm.at(env.now, sooner_if_raised=False)
        while True:
            now = env.now
            soonest = now + (limit - system.total(resource)) / slope
            if soonest > now:
                yield alarm.at(soonest, sooner_if_raised=True)
                continue
            # At the threshold, or so near below it that no representable time lies in between.
            at_this_instant = at_this_instant + 1 if now == instant else 1
            instant = now
            if at_this_instant > MOST_AT_ONE_INSTANT:
                raise SimulationError(self.standstill(system, resource))
            system.broadcast(resource, self.sensing_delay)
            yield alarm.at(now + self.refractory, sooner_if_raised=False)

    def standstill(self, system: System, resource: int) -> str:
        """Say why time cannot advance.

        Parameters
        ----------
        system : System
            The run in progress.
        resource : int
            j.

        Returns
        -------
        str
            With what to do about it.
        """
        name = system.problem.resource_names[resource]
        return (
            f"time {system.env.now!r}, resource {name}: after {MOST_AT_ONE_INSTANT} signals at this instant "
            "total demand is still at its threshold, and time cannot advance since refractory = "
            f"{self.refractory!r}; set refractory greater than 0, or let signals arrive at once and reach "
            "somebody who can respond"
        )


class _Alarm:
    """Wakes the sensing of one resource at a time, or before it when a demand is raised from outside."""

    def __init__(self, system: System, resource: int) -> None:
        self.env = system.env
        self.resource = resource
        self.mailbox = Mailbox(system.env)
        self.latest = 0
        self.watchful = False
        system.on_intervention.append(self._changed)

    def at(self, time: float, *, sooner_if_raised: bool) -> Mailbox:
        """Set the alarm; an earlier setting no longer counts."""
        self.watchful = sooner_if_raised
        self.latest += 1
        setting = self.latest

        def ring(_: simpy.Event) -> None:
            if setting == self.latest:
                self.mailbox.hand(None)

        self.env.at(time, Kind.SENSE, self.resource).callbacks.append(ring)
        return self.mailbox

    def _changed(self, time: float, resource: int, change: float) -> None:
        if self.watchful and resource == self.resource and change > 0.0:
            self.at(time, sooner_if_raised=True)
