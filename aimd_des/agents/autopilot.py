"""The SimPy process that lets a fleet's control unit look in compiled code for as long as nothing else is due."""

import numpy as np
import simpy

from aimd_des.agents.fleet import Fleet
from aimd_des.agents.pilot import BROADCAST, CROWDED, REACHED, STANDSTILL, Limits, Pilot, steer
from aimd_des.agents.settling import LAST
from aimd_des.control_unit import ControlUnit, Crossing, Sampled
from aimd_des.environment import Kind, Mailbox
from aimd_des.errors import SimulationError
from aimd_des.transport import ProcessGenerator

__all__ = ["Autopilot"]

# Answers of which somebody is told in one go.
_TOLD_AT_ONCE = 1 << 16


class Autopilot:
    """A built-in control unit of a fleet: the same looks as those of its process, many to an event of SimPy.

    Parameters
    ----------
    fleet : Fleet
        The agents.
    control_unit : Sampled or Crossing
        What decides.
    """

    def __init__(self, fleet: Fleet, control_unit: Sampled | Crossing) -> None:
        self.fleet, self.control_unit = fleet, control_unit
        self.system = system = fleet.system
        m = system.problem.n_resources
        common = system.clocks is None or system.clocks.common
        sampled = control_unit if isinstance(control_unit, Sampled) else Sampled()
        self.pilot = Pilot(
            crossing=isinstance(control_unit, Crossing),
            period=sampled.period,
            phase=sampled.phase,
            refractory=control_unit.refractory if isinstance(control_unit, Crossing) else 0.0,
            delay=control_unit.sensing_delay,
            look=np.zeros(1, dtype=np.int64),
            alarm=np.zeros(m),
            watchful=np.zeros(m, dtype=np.bool_),
            slope=np.cumsum(system.law.increase, axis=1)[:, -1].copy(),
            instant=np.full(m, -1.0),
            repeated=np.zeros(m, dtype=np.int64),
            due=np.zeros(m, dtype=np.bool_),
            now=np.zeros(1),
            moment=np.zeros(1 if common else system.problem.n_agents),
            woken=np.zeros(1, dtype=np.bool_),
            answers=_TOLD_AT_ONCE,
        )
        self._mailbox = Mailbox(system.env)
        self._setting = 0
        system.on_intervention.append(self._changed)

    @staticmethod
    def can_fly(control_unit: ControlUnit) -> bool:
        """Tell whether there is compiled code for a control unit.

        Parameters
        ----------
        control_unit : ControlUnit
            What decides.

        Returns
        -------
        bool
            False for the user's own.
        """
        return type(control_unit) in (Sampled, Crossing)

    def process(self) -> ProcessGenerator:
        """Look for as long as the run lasts.

        Yields
        ------
        simpy.Event
            The next look that comes after something else.
        """
        while True:
            self._set_alarm()
            yield self._mailbox
            self.pilot.woken[0] = True
            while self._steer() != REACHED:
                pass

    def _next_look(self) -> tuple[float, int]:
        """Return when the next look is, and its turn at that instant: that of its resource, or any."""
        pilot = self.pilot
        if pilot.crossing:
            resource = int(np.argmin(pilot.alarm))
            return float(pilot.alarm[resource]), resource
        return pilot.phase + int(pilot.look[0]) * pilot.period, 0

    def _set_alarm(self) -> None:
        self._setting += 1
        setting = self._setting

        def ring(_: simpy.Event) -> None:
            if setting == self._setting:
                self._mailbox.hand(None)

        time, turn = self._next_look()
        event = self.system.env.at(time, Kind.SENSE, turn if self.pilot.crossing else None)
        event.callbacks.append(ring)

    def _changed(self, time: float, resource: int, change: float) -> None:
        """Look again at once where a demand has been raised from outside, which no bound has foreseen."""
        if self.pilot.watchful[resource] and change > 0.0:
            self.pilot.alarm[resource] = time
            self._set_alarm()

    def _steer(self) -> int:
        """Go on with looks to the next event; do what compiled code has stopped for."""
        env, pilot, fleet = self.system.env, self.pilot, self.fleet
        fleet.listen()
        horizon, kind, order = min(env.upcoming, (self.system.until, 0, 0))
        turns = LAST if kind > Kind.SENSE else order if kind == Kind.SENSE else 0
        status: int = steer(fleet.crowd, pilot, Limits(horizon, turns, *env.acted))
        if status == CROWDED:
            env.advance(*self._at(self._next_look()))
            fleet.settle()
        if status in (BROADCAST, STANDSTILL):
            resources = np.flatnonzero(pilot.due).tolist()
            env.advance(*self._at((float(pilot.now[0]), resources[0])))
            if status == STANDSTILL:
                assert isinstance(self.control_unit, Crossing)  # noqa: S101 - sampled ones go on by themselves
                raise SimulationError(self.control_unit.standstill(self.system, resources[0]))
            for resource in resources:
                self.system.broadcast(resource, pilot.delay)
        return status

    def _at(self, look: tuple[float, int]) -> tuple[float, Kind, int]:
        return look[0], Kind.SENSE, look[1]
