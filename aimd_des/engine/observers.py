"""Observers: they look at the times asked for, and integrate total demand exactly.

Total demand is constant between ticks (discrete) or a line between responses (continuous), so
peak, time above capacity and mean excess are integrals in closed form, piece by piece.  What the total is
for no time, between two events of one instant, is in none of them: the peak is the least upper bound over
intervals of time.
"""

from array import array
from collections.abc import Mapping
from heapq import heapify, heapreplace
from typing import Any

import numpy as np

from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.demand_sums import DemandSums
from aimd_des.engine.environment import EventKind
from aimd_des.engine.left_out import LeftOut
from aimd_des.engine.system import System
from aimd_des.results.kept_rows import Kept
from aimd_des.results.metrics import Overshoot, Stretch, fold_overshoot, joined, load_of, overshoot_of
from aimd_des.results.recording import Recording
from aimd_des.results.run_data import Observations
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray, IntArray

# Changes of the total kept back before they are integrated in one go: a call of a kernel costs more than one.
_BUFFERED = 1 << 16


class ConstantPieces:
    """Overshoot of discrete agents: at every tick an interval of constant demand is closed.

    Attributes
    ----------
    peak, above, excess, used : ndarray, shape (m,)
        Running maximum of the total, time above capacity, and integrals of what exceeds it and of all,
        since the problem last changed.
    measured : ndarray, shape (1,)
        Up to when.
    tick : ndarray, shape (1,)
        Of a clock that all have, the index of the next tick.
    following : bool
        Whether it follows the ticks itself; set to False before the run by the part that does so instead.
    stretches : list of Stretch
        What was measured before the problem last changed.
    """

    def __init__(self, system: System) -> None:
        m = system.problem.n_resources
        self.system = system
        self.peak, self.above, self.excess, self.used = np.zeros((4, m))
        self.measured, self.tick = np.zeros(1), np.zeros(1, dtype=np.int64)
        self.stretches: list[Stretch] = []
        self._begun, self._forgotten = 0.0, 0
        system.on_intervention.append(self._changed)
        system.conditions.on_piece.append(self.close_stretch)
        self.following = True
        clocks = system.clocks
        self._sums = None if clocks is None or clocks.common else DemandSums(system)
        self._ticks: list[tuple[float, int, int]] = []
        system.parts["overshoot"] = self
        system.env.begin("ticks", self._follow_ticks)

    def _follow_ticks(self, again: bool) -> ProcessGenerator:
        """Look just before every agent's every tick, in the order of time."""
        clocks, env = self.system.clocks, self.system.env
        assert clocks is not None  # noqa: S101 - discrete agents have clocks
        if not self._ticks:
            # Where all tick together, the ticks of one agent are those of all.
            agents = range(1 if clocks.common else self.system.problem.n_agents)
            self._ticks = [(clocks.time(agent, 0), agent, 0) for agent in agents]
            heapify(self._ticks)
        while self.following:
            time, agent, tick = self._ticks[0]
            # Of several agents that tick at one instant, the first closes the interval for all.
            if again or time > env.now or self.measured[0] < time:
                again = False
                yield env.at(time, EventKind.OBSERVE)
                self._close()
            if self._sums is not None:
                self._sums.ticks(agent, tick)
            heapreplace(self._ticks, (clocks.time(agent, tick + 1), agent, tick + 1))
            self.tick[0] = tick + 1

    def state(self) -> dict[str, Any]:
        """Return what has been measured."""
        return {
            "measures": (self.peak, self.above, self.excess, self.used, self.measured),
            "begun": self._begun,
            "stretches": tuple(self.stretches),
            "tick": int(self.tick[0]),
            "ticks": () if self._sums is None else tuple(self._ticks),
            "sums": None if self._sums is None else self._sums.state(),
            "forgotten": self._forgotten,
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        own = (self.peak, self.above, self.excess, self.used, self.measured)
        for row, kept in zip(own, state["measures"], strict=True):
            row[:] = kept
        self._begun, self.stretches = state["begun"], list(state["stretches"])
        self._forgotten = state["forgotten"]
        clocks, tick = self.system.clocks, state["tick"]
        assert clocks is not None  # noqa: S101 - discrete agents have clocks
        self.tick[0] = tick
        self._ticks = [(clocks.time(0, tick), 0, tick)]
        if self._sums is not None:
            self._ticks = [tuple(each) for each in state["ticks"]]
            self._sums.resume(state["sums"])

    def _changed(self, time: float, resource: int, change: float) -> None:
        """Close an interval that is cut short from outside; ticks have closed theirs before agents act."""
        # Told after the change, which has to be taken out again for the interval before it.
        self._close(resource, change)

    def _totals(self) -> FloatArray:
        return self.system.totals() if self._sums is None else self._sums.read()

    def _close(self, resource: int = 0, change: float = 0.0) -> None:
        now, capacity = self.system.env.now, self.system.parameters.capacity
        duration = now - self.measured[0]
        # At the instant of a tick nothing is read again: agents have yet to act.
        if duration > 0.0:
            total = self._totals()
            total[resource] -= change
            fold_overshoot(total, capacity, duration, self.peak, self.above, self.excess, self.used)
            self.measured[0] = now

    def load(self) -> FloatArray:
        """Integrate total demand over the capacity up to now, without closing anything."""
        # To close the interval here would add up the same integral in other pieces, and other last bits.
        since = float(self.system.env.now - self.measured[0])
        used = self.used + self._totals() * since if since > 0.0 else self.used
        return np.asarray(used / self.system.parameters.capacity + _load_before(self.stretches))

    def peak_load(self) -> FloatArray:
        """Return the largest total over the capacity in force up to now, since peaks were last forgotten."""
        peak = self.peak
        if self.system.env.now > self.measured[0]:
            peak = np.maximum(peak, self._totals())
        return _peak_load(peak / self.system.parameters.capacity, self.stretches[self._forgotten :])

    def forget_peaks(self) -> None:
        """Look for peaks from now on only: what the result says of them is no longer so."""
        self._close()
        self.peak[:], self._forgotten = 0.0, len(self.stretches)

    def close_stretch(self) -> None:
        """End what was measured with the present capacities: they change, or the run is over."""
        now = float(self.system.env.now)
        self._close()
        # Of two changes at one instant, what holds in between holds for no time.
        if now > self._begun:
            measures = (self.peak, self.above, self.excess, self.used)
            capacity = self.system.parameters.capacity.copy()
            self.stretches.append(Stretch(self._begun, now, capacity, *(row.copy() for row in measures)))
            for row in measures:
                row[:] = 0.0
            self._begun = now


def _peak_load(load: FloatArray, stretches: list[Stretch]) -> FloatArray:
    """Return the largest of a load and those of what was measured before."""
    return np.asarray(np.maximum.reduce([load, *(stretch.peak / stretch.capacity for stretch in stretches)]))


def _load_before(stretches: list[Stretch]) -> FloatArray | float:
    return load_of(stretches) if stretches else 0.0


@formula
def line_of(running: FloatArray, resource: int) -> Any:
    """Read what has been integrated of one resource: the columns of `LinearPieces.running`."""
    j = resource
    return running[j, 0], running[j, 1], running[j, 2], running[j, 3], running[j, 4], running[j, 5]


@formula
def keep_line(line: Any, running: FloatArray, resource: int) -> None:
    """Keep what `line_of` reads."""
    for column in range(6):
        running[resource, column] = line[column]


@formula
def fold_change(line: Any, time: float, change: float, slope: float, capacity: float) -> Any:
    """Close a piece of a line with a change of the total."""
    # Numbers, not a row of an array: so they stay in registers from one change to the next.
    began, total, peak, above, excess, used = line
    duration = time - began
    end = total + slope * duration
    if duration > 0.0:  # what is so for no time, between two events of one instant, is no demand
        peak = max(peak, total, end)
    used += 0.5 * (total + end) * duration
    # Between changes the total never falls, so it is above capacity at the end of a piece or not at all.
    if end > capacity:
        over = end - capacity
        under = max(capacity - total, 0.0)
        # Where no agent is present to grow, nothing is crossed on the way.
        crossed = duration - under / slope if under > 0.0 else duration
        above += crossed
        excess += 0.5 * (over + max(total - capacity, 0.0)) * crossed
    return time, end + change, peak, above, excess, used


@kernel
def _fold_line(
    times: FloatArray, changes: FloatArray, slope: float, capacity: float, running: FloatArray, resource: int
) -> None:
    line = line_of(running, resource)
    for change in range(times.shape[0]):
        line = fold_change(line, times[change], changes[change], slope, capacity)
    keep_line(line, running, resource)


class LinearPieces:
    """Overshoot of continuous agents: total demand is a line between two changes.

    Attributes
    ----------
    slope : ndarray, shape (m,)
        Growth of the total, in units of the resource per unit of time.
    running : ndarray, shape (m, 6)
        Time and total at the last change, peak, time above capacity, and the integrals of what exceeds the
        capacity and of all, since the problem last changed.
    stretches : list of Stretch
        What was measured before the problem last changed.
    """

    def __init__(self, system: System) -> None:
        m = system.problem.n_resources
        self.system = system
        self.slope = system.conditions.growth  # the array of the conditions: interventions write it
        self.running = np.zeros((m, 6))
        self.stretches: list[Stretch] = []
        self._begun, self._forgotten = 0.0, 0
        self.times = [array("d") for _ in range(m)]
        self.changes = [array("d") for _ in range(m)]
        system.on_response.append(self.changed)
        system.on_intervention.append(self.changed)
        system.conditions.on_piece.append(self.close_stretch)
        system.parts["overshoot"] = self

    def state(self) -> dict[str, Any]:
        """Return what has been measured."""
        # Folding earlier gives the same numbers: it goes from change to change.
        self.flush()
        return {
            "running": self.running,
            "begun": self._begun,
            "stretches": tuple(self.stretches),
            "forgotten": self._forgotten,
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self.running[:] = state["running"]
        self._begun, self.stretches = state["begun"], list(state["stretches"])
        self._forgotten = state["forgotten"]

    def changed(self, time: float, resource: int, change: float) -> None:
        """Take note of a change of the total."""
        # Answers of compiled agents that come before this change are folded in before it.
        if self.system.collective is not None:
            self.system.settle()
        times = self.times[resource]
        times.append(time)
        self.changes[resource].append(change)
        if len(times) == _BUFFERED:
            self._fold(resource)

    def changed_often(self, time: FloatArray, resource: IntArray, change: FloatArray) -> None:
        """Take note of many changes of the total, in the order of time."""
        for j, (times, changes) in enumerate(zip(self.times, self.changes, strict=True)):
            times.frombytes(time[resource == j].tobytes())
            changes.frombytes(change[resource == j].tobytes())
            if len(times) >= _BUFFERED:
                self._fold(j)

    def flush(self) -> None:
        """Fold what has been kept back."""
        for resource, times in enumerate(self.times):
            if times:
                self._fold(resource)

    def _fold(self, resource: int) -> None:
        _fold_line(
            np.array(self.times[resource]),
            np.array(self.changes[resource]),
            float(self.slope[resource]),
            float(self.system.parameters.capacity[resource]),
            self.running,
            resource,
        )
        self.times[resource], self.changes[resource] = array("d"), array("d")

    def load(self) -> FloatArray:
        """Integrate total demand over the capacity up to now, without closing anything."""
        self.system.settle()
        self.flush()
        since = self.system.env.now - self.running[:, 0]
        used = self.running[:, 5] + (self.running[:, 1] + 0.5 * self.slope * since) * since
        return np.asarray(used / self.system.parameters.capacity + _load_before(self.stretches))

    def peak_load(self) -> FloatArray:
        """Return the largest total over the capacity in force up to now, since peaks were last forgotten."""
        self.system.settle()
        self.flush()
        now = self.running[:, 1] + self.slope * (self.system.env.now - self.running[:, 0])
        peak = np.maximum(self.running[:, 2], now)
        return _peak_load(peak / self.system.parameters.capacity, self.stretches[self._forgotten :])

    def forget_peaks(self) -> None:
        """Look for peaks from now on only: what the result says of them is no longer so."""
        self.system.settle()
        self.flush()
        self.running[:, 2], self._forgotten = 0.0, len(self.stretches)

    def close_stretch(self) -> None:
        """End what was measured with the present capacities: they change, or the run is over."""
        now = float(self.system.env.now)
        # A change by nothing ends the line while slope and capacity are still those that held on it.
        for resource in range(len(self.slope)):
            self.changed(now, resource, 0.0)
        self.flush()
        if now > self._begun:
            # The first two columns, time and total, are where the next line begins, and stay.
            measures = self.running.T[2:]
            capacity = self.system.parameters.capacity.copy()
            self.stretches.append(Stretch(self._begun, now, capacity, *(row.copy() for row in measures)))
            self.running[:, 2:] = 0.0
            self._begun = now


class Observer:
    """Records the system at the times asked for.

    Attributes
    ----------
    demand_times : ndarray, shape (q,)
        When totals are kept.
    times : ndarray, shape (r,)
        The last of them: those that are kept here, and not in the run that this one goes on with.
    total_demand, total_average : ndarray, shape (r, m)
        The totals.
    row : ndarray, shape (1,)
        How many of them are kept.
    watching : bool
        Whether it keeps them itself; set to False before the run by the part that does so instead.
    """

    def __init__(self, system: System, recording: Recording, like: "Observer | None" = None) -> None:
        n, m = system.problem.n_agents, system.problem.n_resources
        self.system = system
        if like is None:
            self.demand_times = recording.times("demand", system.until, whole=False)
            self.allocation_times = recording.times("allocations", system.until, whole=False)
        else:  # of a run of the same end that is recorded in the same way
            self.demand_times, self.allocation_times = like.demand_times, like.allocation_times
        # The rows that are left, and those that a run was gone on with: these are shared with it.
        self.times, self._kept_totals, self._kept_pages = self.demand_times, Kept(), Kept()
        self.total_demand, self.total_average = np.zeros((2, len(self.times), m))
        self.demand, self.average = np.zeros((2, len(self.allocation_times), m, n))
        self.row = np.zeros(1, dtype=np.int64)
        self._page = 0
        self.watching = True
        self.overshoot: ConstantPieces | LinearPieces | None = None
        self.left_out = LeftOut(system)
        system.parts["observer"] = self
        if recording.overshoot:
            self.overshoot = LinearPieces(system) if system.clocks is None else ConstantPieces(system)
            system.env.begin("half", self._weigh_half)
        self.half_load = np.zeros(m)
        system.env.begin("totals", self._watch_totals)
        system.env.begin("allocations", self._watch_allocations)

    def begin_measures(self) -> None:
        """Leave what has been until now out of the measures."""
        self.left_out.begin()
        if self.overshoot:
            self.overshoot.close_stretch()

    def _weigh_half(self, again: bool) -> ProcessGenerator:
        """Keep what the first half of the run has come to."""
        yield self.system.env.at(0.5 * self.system.until, EventKind.OBSERVE)
        assert self.overshoot is not None  # noqa: S101 - begun where there is one
        self.half_load = self.overshoot.load()

    def _watch_totals(self, again: bool) -> ProcessGenerator:
        """Keep the totals; the last look is left to `finish`."""
        # Read when the process begins, which is when the run does.
        times = self.times[:-1].tolist() if self.watching else []
        for row in range(int(self.row[0]), len(times)):
            yield self.system.env.at(times[row], EventKind.OBSERVE)
            self._keep_totals(row)
            self.row[0] = row + 1

    def _watch_allocations(self, again: bool) -> ProcessGenerator:
        """Keep demand and average of every agent; the last look is left to `finish`."""
        first = len(self.allocation_times) - len(self.demand)
        for time in self.allocation_times[first + self._page : -1].tolist():
            yield self.system.env.at(time, EventKind.OBSERVE)
            self.system.observe_allocations(self.demand[self._page], self.average[self._page])
            self._page += 1

    def state(self) -> dict[str, Any]:
        """Return what has been kept; rows that are full are never written again, so they can be shared."""
        row, page = int(self.row[0]), self._page
        return {
            "totals": self._kept_totals.with_more(self.total_demand[:row], self.total_average[:row]),
            "pages": self._kept_pages.with_more(self.demand[:page], self.average[:page]),
            "half": self.half_load,
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self._kept_totals, self._kept_pages = Kept(*state["totals"]), Kept(*state["pages"])
        rows, pages = self._kept_totals.count, self._kept_pages.count
        self.times = self.demand_times[rows:]
        self.total_demand, self.total_average = self.total_demand[rows:], self.total_average[rows:]
        self.demand, self.average = self.demand[pages:], self.average[pages:]
        self.half_load = state["half"]

    def _keep_totals(self, row: int) -> None:
        self.system.observe_totals(self.total_demand[row], self.total_average[row])

    def finish(self) -> Observations:
        """Take the last look, at the end of the run."""
        # Not an event: what is due at the end does not happen, but x(end) is what the run has led to.
        self.system.observe_allocations(self.demand[-1], self.average[-1])
        for totals, rows in ((self.total_demand, self.demand), (self.total_average, self.average)):
            # In the order of agents, as all totals: the last of the running sums.
            totals[-1] = np.cumsum(rows[-1], axis=1)[:, -1]
        # Not 0 where nothing was measured: 0 would be a finding.
        missing = np.full(self.system.problem.n_resources, np.nan)
        overshoot, second_half = Overshoot(missing, missing, missing), missing
        stretches: tuple[Stretch, ...] = ()
        if self.overshoot:
            self.overshoot.close_stretch()
            stretches = tuple(self.overshoot.stretches)
            half = 0.5 * self.system.until
            if self.left_out.before is not None:
                start = self.left_out.before.time
                first = next(place for place, stretch in enumerate(stretches) if stretch.start >= start)
                rest = stretches[first:]
                overshoot, second_half = overshoot_of(rest), load_of(rest) / (rest[-1].end - start)
                # One stretch for each problem in force, of which none need have begun there.
                if first and all(piece.start != start for piece in self.system.conditions.pieces):
                    both = joined(*stretches[first - 1 : first + 1])
                    stretches = (*stretches[: first - 1], both, *stretches[first + 1 :])
            else:
                overshoot = overshoot_of(stretches)
                if half > 0.0:  # half of the smallest number that there is is 0
                    second_half = (load_of(stretches) - self.half_load) / half
        return Observations(
            self.demand_times,
            *self._kept_totals.followed_by(self.total_demand, self.total_average),
            self.allocation_times,
            *self._kept_pages.followed_by(self.demand, self.average),
            overshoot,
            second_half,
            stretches,
        )


def observer_of(system: System) -> Observer:
    """Give the observer of a run."""
    observer = system.parts["observer"]
    assert isinstance(observer, Observer)  # noqa: S101 - every run has one
    return observer
