"""One run as a page sees it: taken forward piece by piece, each a message with all that happened in it."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.engine.delivery import Signal
from aimd_des.engine.run_in_progress import Run
from aimd_des.live.packing import packed
from aimd_des.problem.optimum import solve_optimum
from aimd_des.results import metrics
from aimd_des.results.event_log import Entry
from aimd_des.results.run_data import Piece
from aimd_des.results.tracking import piece_problem
from aimd_des.scenario import Scenario
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray, IntArray

# Time between two frames, and of those of agents that tick on clocks of their own.
_FRAME, _OWN_FRAME = 1.0, 0.25
# Misallocation is measured so many times while the time grows tenfold.
_MEASURES_PER_DECADE = 12
# For more agents, the optimum takes longer than a page waits.
_MOST_MEASURED = 5000
# Entries of the log of which a page tells in words.
_TOLD = (
    Entry.LEAVE, Entry.JOIN, Entry.CAPACITY, Entry.COSTS, Entry.CUT, Entry.HEAL, Entry.FAIL, Entry.RECOVER,
    Entry.NORMALIZATION, Entry.THRESHOLD, Entry.INCREASE, Entry.DECREASE, Entry.HOLD_OFF, Entry.CHANNEL,
)  # fmt: skip
# In a chunk, a cut of hundreds of agents is one line.
_MOST_NOTES = 40


class Look(NamedTuple):
    """All agents at one moment."""

    time: float
    demand: FloatArray  # (m, n)
    average: FloatArray  # (m, n)
    counts: FloatArray  # (m, 4): signals, copies lost, answers that cut, of which saturated
    piece: Piece  # the problem in force


class Sent(NamedTuple):
    """A signal that has left the control unit."""

    time: float
    signal: Signal
    arrival: FloatArray  # (n,)


class Player:
    """A run of a scenario with its event log, which gives what a page draws."""

    def __init__(self, scenario: Scenario, names: Mapping[str, Any] | None = None) -> None:
        self.names = dict(names or {})
        self.run = _start(scenario)
        self.system = self.run.system
        self.problem = self.system.problem
        self._sent: list[Sent] = []
        self.system.transmitter.on_leave.append(self._left)
        self._growths: list[tuple[float, FloatArray]] = []
        self.system.conditions.on_piece.append(self._grows_otherwise)
        self._entries = 0
        self._ticking = scenario.dynamics == "discrete"
        self._frame = _frame_of(self.run)
        self._due = _measure_times(scenario.until)
        self._next_measure = next(self._due, math.inf)
        self._looks: list[Look] = []
        self._edges = sorted(
            {getattr(change, "begins", 0.0) for change in scenario.changes(self.problem)} - {0.0}
        )

    @property
    def time(self) -> float:
        """How far it has come."""
        return self.run.time

    @property
    def has_looks(self) -> bool:
        """Whether there is something to be measured."""
        return bool(self._looks)

    def _left(self, signal: Signal, arrival: FloatArray) -> None:
        self._sent.append(Sent(float(self.system.env.now), signal, arrival.copy()))

    def _grows_otherwise(self) -> None:
        # Told just before: the growth of the line that ends here.
        self._growths.append((float(self.system.env.now), self.system.conditions.growth.copy()))

    def skip(self, to: float) -> None:
        """Go forward without telling of it, but for what is measured."""
        for _ in self._stops(to, math.inf):
            pass
        self._sent.clear()
        self._growths.clear()
        self._entries = len(self.system.log or ())

    def chunk(self, to: float) -> bytes:
        """Go forward, and tell of all that happened: see `_arrays`."""
        began = self.time
        first = self._look()
        start = {
            "capacity": self.system.parameters.capacity.tolist(),
            "limit": self.system.parameters.limit.tolist(),
        }
        looks = [first, *self._stops(to, self._frame)]
        log = self.system.log
        assert log is not None  # noqa: S101 - recorded, see `_start`
        columns = log.columns(self._entries)
        self._entries += len(columns[0])
        head = {
            **self.names,
            "kind": "chunk",
            "from": began,
            "to": self.time,
            "over": self.time >= self.run.until,
            **start,
            "notes": _notes(*columns),
        }
        message = packed(head, self._arrays(began, looks, *columns))
        self._sent.clear()
        self._growths.clear()
        return message

    def _stops(self, to: float, frame: float) -> Iterator[Look]:
        """Go forward from look to look: every frame, what is measured, after every change, the end."""
        goal = min(to, self.run.until)
        number = math.floor(self.time / frame) + 1 if frame < math.inf else 0
        while self.time < goal:
            due = number * frame if frame < math.inf else math.inf
            edge = next((edge for edge in self._edges if edge >= self.time), math.inf)
            after = math.nextafter(edge, math.inf)
            # Agents that tick have acted just after the tick.
            due = math.nextafter(due, math.inf) if self._ticking else due
            time = min(goal, due, after, self._next_measure)
            self.run.advance(to=time)
            number += time == due
            if time == after:
                self._edges = [edge for edge in self._edges if edge >= time]
            look = self._look()
            if time == self._next_measure:
                self._looks.append(look)
                self._next_measure = next(self._due, math.inf)
            yield look

    def _look(self) -> Look:
        demand, average = self.system.allocations()
        transmitter, state = self.system.transmitter, self.system.state
        accounts = (
            transmitter.numbers,
            *(each.sum(axis=1) for each in (transmitter.lost, state.responses, state.saturated)),
        )
        counts = np.stack(accounts, axis=1).astype(np.float64)
        return Look(self.time, demand.copy(), average.copy(), counts, self.system.conditions.pieces[-1])

    def _arrays(
        self,
        began: float,
        looks: list[Look],
        time: FloatArray,
        entry: IntArray,
        value: FloatArray,
    ) -> dict[str, npt.NDArray[Any]]:
        """Lay out a chunk; times count from its beginning.

        Frames: `frame` (q,), `demand` and `average` (q, m, n), `counts` (q, m, 4); `increase` (m, n) of the
        agents at the end.  Total demand as a line of all resources one after the other: `total` (k, 2) of
        times and values, those of resource j from `place[j]` on.  Signals: `signal` (s,) times, `sent` (s, 3)
        of resource, number and copy, `arrival` (s, n), negative where a copy is lost.  Answers: `answer`
        (a, 2) of time and how much was given back, negative for one that holds, and `answered` (a, 3) of
        resource, agent and number.
        """
        n = self.problem.n_agents
        answers = (entry[:, 0] == Entry.RESPOND) | (entry[:, 0] == Entry.HOLD)
        cut = np.where(entry[answers, 0] == Entry.RESPOND, value[answers], -1.0)
        lines = [self._line(looks, j, time, entry, value) for j in range(self.problem.n_resources)]
        total = np.concatenate(lines)
        total[:, 0] -= began
        arrival = np.array([sent.arrival for sent in self._sent]).reshape(-1, n) - began
        return {
            "frame": np.array([look.time for look in looks]) - began,
            "demand": np.array([look.demand for look in looks]),
            "average": np.array([look.average for look in looks]),
            "counts": np.array([look.counts for look in looks]),
            "increase": self.system.parameters.increase,
            "total": total,
            "place": np.cumsum([0, *map(len, lines)]),
            "signal": np.array([sent.time for sent in self._sent]) - began,
            "sent": np.array([sent.signal for sent in self._sent], dtype=np.int64).reshape(-1, 3),
            "arrival": np.where(np.isfinite(arrival), arrival, -1e9),
            "answer": np.stack([time[answers] - began, cut], axis=1),
            "answered": entry[answers][:, 1:4],
        }

    def _line(
        self,
        looks: list[Look],
        resource: int,
        time: FloatArray,
        entry: IntArray,
        value: FloatArray,
    ) -> FloatArray:
        """Draw total demand as it is: straight between answers, in steps where agents tick."""
        at = np.array([look.time for look in looks])
        totals = np.array([look.demand[resource].sum() for look in looks])
        if self._ticking:
            return np.stack([np.repeat(at, 2)[1:], np.repeat(totals, 2)[:-1]], axis=1)
        jumps = (entry[:, 1] == resource) & ((entry[:, 0] == Entry.RESPOND) | (entry[:, 0] == Entry.CHANGE))
        when = time[jumps]
        change = np.where(entry[jumps, 0] == Entry.CHANGE, value[jumps], -value[jumps])
        # Where growth changes, the line has a corner, too.
        when = np.concatenate([when, [moment for moment, _ in self._growths]])
        change = np.concatenate([change, np.zeros(len(self._growths))])
        order = np.argsort(when, kind="stable")
        when, change = when[order], change[order]
        # Looks are exact: between two of them the line is put together from what happened.
        parts = [np.stack([at, totals], axis=1)]
        breaks = [*self._growths, (math.inf, self.system.conditions.growth)]
        for left, right, base in zip(at[:-1], at[1:], totals[:-1], strict=True):
            inside = slice(*np.searchsorted(when, [left, right]))
            grown = _grown(when[inside], left, breaks, resource)
            after = base + grown + np.cumsum(change[inside])
            before = after - change[inside]
            both = np.stack([before, after], axis=1).ravel()
            parts.append(np.stack([np.repeat(when[inside], 2), both], axis=1))
        vertices = np.concatenate(parts)
        return vertices[np.argsort(vertices[:, 0], kind="stable")]

    def measured(self) -> Iterator[bytes]:
        """Yield what has been measured since the last time, and the optimum for what is used in the end."""
        while self._looks:
            # One at a time: a stop in between leaves the others for the next time.
            look = self._looks.pop(0)
            if self.problem.n_agents > _MOST_MEASURED:
                continue
            used = np.where(look.piece.present, look.average, 0.0).sum(axis=1)
            if not (used > 0.0).all():
                continue
            part = piece_problem(self.problem, look.piece)
            best = solve_optimum(part, capacity=used).allocation
            here = look.average.T[look.piece.present]
            error = metrics.relative_error(here, best)
            whole = np.full((self.problem.n_agents, self.problem.n_resources), -1.0)
            whole[look.piece.present] = best
            last = not self._looks
            yield packed(
                {
                    **self.names,
                    "kind": "measure",
                    "time": look.time,
                    "misallocation": error.tolist(),
                    "used": (used / look.piece.capacity).tolist(),
                },
                {"best": whole.T} if last else {},
            )


def _start(scenario: Scenario) -> Run:
    recording = {"demand": "end", "allocations": "end", "tail": 0, "overshoot": False, "events": True}
    data = {**scenario.spoken(), "recording": recording}
    try:
        seen = type(scenario).model_validate({**data, "agents": "fleet"})
        return seen.simulation().start(scenario.until)
    except InputError:
        # Costs without compiled code, which processes can do; what else is wrong is so with them, too.
        seen = type(scenario).model_validate({**data, "agents": "process"})
        return seen.simulation().start(scenario.until)


def _frame_of(run: Run) -> float:
    clocks = run.system.clocks
    if clocks is None:
        return _FRAME
    # Every tick of a common clock is a frame: between two of them nothing moves.
    return float(clocks.rows[1][0]) if clocks.common else _OWN_FRAME


def _measure_times(until: float) -> Iterator[float]:
    number = 0
    while (time := 10.0 ** (number / _MEASURES_PER_DECADE)) < until:
        yield time
        number += 1


def _grown(
    when: FloatArray, since: float, breaks: list[tuple[float, FloatArray]], resource: int
) -> FloatArray:
    """Integrate the growth of total demand up to some times."""
    grown, left = np.zeros(len(when)), since
    for end, growth in breaks:
        if end > left:
            grown += float(growth[resource]) * np.clip(when - left, 0.0, end - left)
            left = end
    return grown


def _notes(time: FloatArray, entry: IntArray, value: FloatArray) -> list[list[float | str]]:
    """Tell of what has changed from outside: time, kind, resource, agent and value."""
    told = np.flatnonzero(np.isin(entry[:, 0], [int(kind) for kind in _TOLD]))[:_MOST_NOTES]
    return [
        [float(time[k]), Entry(int(entry[k, 0])).name.lower(), *entry[k, 1:3].tolist(), float(value[k])]
        for k in told
    ]
