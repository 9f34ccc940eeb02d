"""What came out of an emulation, as a run's result: computed from what agents and unit wrote down.

Between two answers a demand is a line, so totals, averages and overshoot are exact: nothing was sampled.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.emulate.averages import Average
from aimd_des.emulate.conductor import Collected
from aimd_des.emulate.records import RowKind
from aimd_des.emulate.served import Emulation
from aimd_des.results.event_log import Entry, EventLog
from aimd_des.results.metrics import Overshoot, Stretch, overshoot_of
from aimd_des.results.result import Result
from aimd_des.results.run_data import Account, Observations, Signals
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray

Rows = npt.NDArray[Any]

_NOTHING = np.zeros(0, dtype=np.int64)


def sent_signals(rows: Rows, until: float) -> Rows:
    """Give the signals of a run, in the order in which they were sent."""
    sent = rows[(rows["kind"] == RowKind.SENT) & (rows["time"] < until)]
    ordered: Rows = sent[np.argsort(sent["sequence"])]
    return ordered


def answers(rows: Rows, until: float) -> Rows:
    """Give the answers of a run, in the order of time."""
    found = rows[(rows["kind"] == RowKind.ANSWER) & (rows["time"] < until)]
    ordered: Rows = found[np.argsort(found["time"], kind="stable")]
    return ordered


@dataclass(frozen=True, eq=False)
class Lines:
    """The demand of one agent for one resource over the run; a line for each answer, after the first."""

    since: FloatArray
    demand: FloatArray
    state: FloatArray
    increase: float
    average: Average

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return demand and average at ascending times."""
        line = np.searchsorted(self.since, times, side="right") - 1
        since, demand = self.since[line], self.demand[line]
        later = np.where(times > 0.0, times, 1.0)
        state = self.average.fold(self.state[line], since, demand, self.increase, later)
        average = np.where(times > 0.0, self.average.mean(state, later), 0.0)
        return demand + self.increase * (times - since), average


def lines_of(setting: Emulation, answered: Rows, agent: int, resource: int) -> Lines:
    """Put an agent's answers about a resource together."""
    own = answered[(answered["agent"] == agent) & (answered["resource"] == resource)]
    since, demand, state = (np.concatenate(([0.0], own[name])) for name in ("time", "after", "state"))
    return Lines(since, demand, state, float(setting.problem.increase[agent, resource]), setting.average)


def outcome(setting: Emulation, measured: Collected) -> Result:
    """Make the result of a run over sockets, up to where it was measured; its digest never comes again."""
    until = measured.reached
    sent, answered = sent_signals(measured.rows, until), answers(measured.rows, until)
    seen = _observations(setting, answered, until)
    signals = Signals(sent["time"].copy(), *(sent[name].astype(np.int64) for name in ("resource", "number")))
    account, log = _account(setting, measured.rows, sent, answered), None
    if setting.scenario.recording.events:
        log = _log(measured.rows, sent, answered, until)
    return Result(
        setting.problem,
        "continuous",
        setting.scenario.seed,
        until,
        signals,
        seen,
        account,
        log,
        opportunities=setting.control_unit.opportunities(0.5 * until, until),
    )


def _observations(setting: Emulation, answered: Rows, until: float) -> Observations:
    recording, n, m = (
        setting.scenario.recording.build(),
        setting.problem.n_agents,
        setting.problem.n_resources,
    )
    often, seldom = (_times(recording.times, name, until) for name in ("demand", "allocations"))
    totals, means = np.zeros((2, len(often), m))
    demand, average = np.zeros((2, len(seldom), m, n))
    for j in range(m):
        for i in range(n):
            lines = lines_of(setting, answered, i, j)
            held, mean = lines.at(often)
            totals[:, j] += held
            means[:, j] += mean
            demand[:, j, i], average[:, j, i] = lines.at(seldom)
    missing = np.full(m, np.nan)
    overshoot, half = Overshoot(missing, missing, missing), missing
    stretches: tuple[Stretch, ...] = ()
    if recording.overshoot:
        stretches = (_stretch(setting, answered, 0.0, until),)
        overshoot = overshoot_of(stretches)
        second = _stretch(setting, answered, 0.5 * until, until)
        half = second.used / second.capacity / (0.5 * until)
    return Observations(often, totals, means, seldom, demand, average, overshoot, half, stretches)


def _times(times: Any, name: str, until: float) -> FloatArray:
    """List the times at which something is kept; of a run that was stopped, those that it has reached."""
    found: FloatArray = times(name, until, whole=False)
    return found


def _stretch(setting: Emulation, answered: Rows, start: float, end: float) -> Stretch:
    """Integrate total demand from one time to another, piece by piece."""
    problem, m = setting.problem, setting.problem.n_resources
    peak, above, excess, used = np.zeros((4, m))
    for j in range(m):
        own, slope, capacity = (
            answered[answered["resource"] == j],
            float(problem.increase[:, j].sum()),
            problem.capacity[j],
        )
        given_back = np.concatenate(([0.0], np.cumsum(own["before"] - own["after"])))
        edges = np.concatenate(([start], own["time"][(own["time"] > start) & (own["time"] < end)], [end]))
        # From one answer to the next the total rises along a line.
        before = given_back[np.searchsorted(own["time"], edges[:-1], side="right")]
        low, length = slope * edges[:-1] - before, np.diff(edges)
        high = low + slope * length
        over = np.clip(high - capacity, 0.0, None)
        under = np.clip(low - capacity, 0.0, None)
        crossed = np.where(over > 0.0, (over - under) / slope, 0.0)
        peak[j], above[j] = high[length > 0.0].max(), crossed.sum()
        excess[j], used[j] = (0.5 * (over + under) * crossed).sum(), (0.5 * (low + high) * length).sum()
    return Stretch(start, end, problem.capacity.copy(), peak, above, excess, used)


def _counts(setting: Emulation, rows: Rows) -> IntArray:
    n = setting.problem.n_agents
    place = rows["resource"].astype(np.int64) * n + rows["agent"]
    return np.bincount(place, minlength=setting.problem.n_resources * n).reshape(-1, n).astype(np.int64)


def unheard(setting: Emulation, rows: Rows, sent: Rows) -> BoolArray:
    """Tell which signals, which have left, each agent's process has not received, shape (signals, n)."""
    lost = np.zeros((len(sent), setting.problem.n_agents), dtype=np.bool_)
    heard = rows[rows["kind"] == RowKind.HEARD]
    for process in range(setting.processes):
        known = heard["sequence"][heard["process"] == process]
        lost[:, setting.agents_of(process)] = ~np.isin(sent["sequence"], known)[:, None]
    return lost


def _account(setting: Emulation, rows: Rows, sent: Rows, answered: Rows) -> Account:
    m, n = setting.problem.n_resources, setting.problem.n_agents
    known = np.isin(rows["sequence"], sent["sequence"])
    lost = _counts(setting, rows[known & (rows["kind"] == RowKind.LOST)])
    gone = sent[sent["heard"] > 0.0]
    missing = unheard(setting, rows, gone)
    np.add.at(lost, gone["resource"], missing)
    delivered = _counts(setting, answered[answered["copy"] == 0])
    numbers = np.bincount(sent["resource"], minlength=m)[:, None]
    return Account(
        delivered=delivered,
        lost=lost,
        in_flight=np.broadcast_to(numbers, (m, n)) - delivered - lost,
        duplicated=_counts(setting, answered[answered["copy"] == 1]),
        responses=_counts(setting, answered[(answered["flags"] & 1) > 0]),
        saturated=_counts(setting, answered[(answered["flags"] & 2) > 0]),
    )


def _log(rows: Rows, sent: Rows, answered: Rows, until: float) -> EventLog:
    """Write the log that a simulation would have of the same events."""
    lost = rows[(rows["kind"] == RowKind.LOST) & (rows["heard"] < until)]
    responded = (answered["flags"] & 1) > 0
    answer = np.where(responded, Entry.RESPOND, Entry.HOLD)
    given_back = np.where(responded, answered["before"] - answered["after"], 0.0)
    parts = [
        _entries(sent, sent["time"], Entry.SIGNAL, sent["before"]),
        _entries(lost, lost["heard"], Entry.LOST, np.zeros(len(lost))),
        _entries(answered, answered["time"], Entry.DELIVER, answered["copy"]),
        _entries(answered, answered["time"], answer, given_back),
    ]
    entries = np.concatenate(parts)
    # By time; of entries at one time, a copy arrives before it is answered.
    order = np.argsort(entries[:, 0], kind="stable")
    log = EventLog()
    log.extend(np.ascontiguousarray(entries[order]))
    return log


def _entries(rows: Rows, time: FloatArray, kind: Any, value: Any) -> FloatArray:
    entries = np.empty((len(rows), 6))
    for column, what in enumerate((time, kind, rows["resource"], rows["agent"], rows["number"], value)):
        entries[:, column] = what
    return entries
