"""Observers: they look at the times asked for, and integrate total demand exactly.

Total demand is constant between ticks (discrete) or a line between responses (continuous), so
peak, time above capacity and mean excess are integrals in closed form, piece by piece.
"""

from array import array
from heapq import heapify, heapreplace

import numpy as np

from aimd_des.checks import FloatArray
from aimd_des.compiled import kernel
from aimd_des.environment import Kind
from aimd_des.metrics import Overshoot, fold_overshoot
from aimd_des.recording import Observations, Recording
from aimd_des.system import System
from aimd_des.transport import ProcessGenerator

__all__ = ["ConstantPieces", "LinearPieces", "Observer"]

# Changes of the total kept back before they are integrated in one go.
_BUFFERED = 1 << 16


class ConstantPieces:
    """Overshoot of discrete agents: at every tick an interval of constant demand is closed.

    Parameters
    ----------
    system : System
        The run in progress.
    """

    def __init__(self, system: System) -> None:
        m = system.problem.n_resources
        self.system = system
        self.peak, self.above, self.excess = np.zeros((3, m))
        self.measured_to = 0.0
        system.on_intervention.append(self._changed)
        system.env.process(self._follow_ticks())

    def _follow_ticks(self) -> ProcessGenerator:
        """Look just before every agent's every tick, in the order of time."""
        clocks, env = self.system.clocks, self.system.env
        assert clocks is not None  # noqa: S101 - discrete agents have clocks
        agents = range(1 if clocks.common else self.system.problem.n_agents)
        ticks = [(clocks.time(agent, 0), agent, 0) for agent in agents]
        heapify(ticks)
        while True:
            time, agent, tick = ticks[0]
            if time > env.now or self.measured_to < time:
                yield env.at(time, Kind.OBSERVE)
                self._close(self.system.totals())
            heapreplace(ticks, (clocks.time(agent, tick + 1), agent, tick + 1))

    def _changed(self, time: float, resource: int, change: float) -> None:
        """Close an interval that is cut short from outside; ticks have closed theirs before anybody acts."""
        if time > self.measured_to:
            before = self.system.totals()
            before[resource] -= change
            self._close(before)

    def _close(self, total: FloatArray) -> None:
        now, capacity = self.system.env.now, self.system.law.capacity
        duration = now - self.measured_to
        if duration > 0.0:
            fold_overshoot(total, capacity, duration, self.peak, self.above, self.excess)
            self.measured_to = now

    def finish(self) -> Overshoot:
        """Close the last interval.

        Returns
        -------
        Overshoot
            Of the whole run.
        """
        self._close(self.system.totals())
        capacity, until = self.system.problem.capacity, self.system.until
        return Overshoot(self.peak / capacity, self.above / until, self.excess / until / capacity)


@kernel
def _fold_line(
    times: FloatArray, changes: FloatArray, slope: float, capacity: float, running: FloatArray
) -> None:
    """Integrate a line that is broken by changes; `running` is [time, total, peak, above, excess]."""
    time, total, peak, above, excess = running[0], running[1], running[2], running[3], running[4]
    for change in range(times.shape[0]):
        duration = times[change] - time
        end = total + slope * duration
        peak = max(peak, total, end)
        if end > capacity:
            over = end - capacity
            under = max(capacity - total, 0.0)
            crossed = duration - under / slope
            above += crossed
            excess += 0.5 * (over + max(total - capacity, 0.0)) * crossed
        time, total = times[change], end + changes[change]
    running[0], running[1], running[2], running[3], running[4] = time, total, peak, above, excess


class LinearPieces:
    """Overshoot of continuous agents: total demand is a line between two changes.

    Parameters
    ----------
    system : System
        The run in progress.
    """

    def __init__(self, system: System) -> None:
        m = system.problem.n_resources
        self.system = system
        self.slope = np.cumsum(system.law.increase, axis=1)[:, -1]
        self.running = np.zeros((m, 5))
        self.times = [array("d") for _ in range(m)]
        self.changes = [array("d") for _ in range(m)]
        system.on_response.append(self._changed)
        system.on_intervention.append(self._changed)

    def _changed(self, time: float, resource: int, change: float) -> None:
        self.times[resource].append(time)
        self.changes[resource].append(change)
        if len(self.times[resource]) == _BUFFERED:
            self._fold(resource)

    def _fold(self, resource: int) -> None:
        _fold_line(
            np.array(self.times[resource]),
            np.array(self.changes[resource]),
            float(self.slope[resource]),
            float(self.system.law.capacity[resource]),
            self.running[resource],
        )
        self.times[resource], self.changes[resource] = array("d"), array("d")

    def finish(self) -> Overshoot:
        """Close the last piece.

        Returns
        -------
        Overshoot
            Of the whole run.
        """
        until = self.system.until
        for resource in range(len(self.slope)):
            self._changed(until, resource, 0.0)
            self._fold(resource)
        capacity = self.system.problem.capacity
        _, _, peak, above, excess = self.running.T
        return Overshoot(peak / capacity, above / until, excess / until / capacity)


class Observer:
    """Looks at the system at the times asked for.

    Parameters
    ----------
    system : System
        The run in progress.
    recording : Recording
        What to keep.
    """

    def __init__(self, system: System, recording: Recording) -> None:
        n, m = system.problem.n_agents, system.problem.n_resources
        self.system = system
        self.demand_times = recording.times("demand", system.until, whole=False)
        self.allocation_times = recording.times("allocations", system.until, whole=False)
        self.total_demand = np.zeros((len(self.demand_times), m))
        self.total_average = np.zeros((len(self.demand_times), m))
        self.demand = np.zeros((len(self.allocation_times), m, n))
        self.average = np.zeros((len(self.allocation_times), m, n))
        self.meter: ConstantPieces | LinearPieces | None = None
        if recording.overshoot:
            self.meter = LinearPieces(system) if system.clocks is None else ConstantPieces(system)
        system.env.process(self._watch_totals())
        system.env.process(self._watch_allocations())

    def _watch_totals(self) -> ProcessGenerator:
        """Keep the totals; the last look is left to `finish`."""
        for row, time in enumerate(self.demand_times[:-1].tolist()):
            yield self.system.env.at(time, Kind.OBSERVE)
            self._keep_totals(row)

    def _watch_allocations(self) -> ProcessGenerator:
        """Keep demand and average of every agent; the last look is left to `finish`."""
        for page, time in enumerate(self.allocation_times[:-1].tolist()):
            yield self.system.env.at(time, Kind.OBSERVE)
            self.demand[page], self.average[page] = self.system.allocations()

    def _keep_totals(self, row: int) -> None:
        _, average = self.system.allocations()
        self.total_demand[row] = self.system.totals()
        # One by one, in index order: `ndarray.sum` adds in an order that is not promised.
        self.total_average[row] = np.cumsum(average, axis=1)[:, -1]

    def finish(self) -> Observations:
        """Take the last look, at the end of the run.

        Returns
        -------
        Observations
            All that was kept.
        """
        self._keep_totals(len(self.demand_times) - 1)
        self.demand[-1], self.average[-1] = self.system.allocations()
        missing = np.full(self.system.problem.n_resources, np.nan)
        overshoot = self.meter.finish() if self.meter else Overshoot(missing, missing, missing)
        return Observations(
            self.demand_times,
            self.total_demand,
            self.total_average,
            self.allocation_times,
            self.demand,
            self.average,
            overshoot,
        )
