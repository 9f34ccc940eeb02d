"""A run taken on in pieces and looked at in between, which changes nothing in it.

It keeps pace with real time if that is wanted, and does what keys say: pause, steps, speed, and which agent
is shown.
"""

import math
import time as real
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from aimd_des.engine.delivery import Signal
from aimd_des.engine.run_in_progress import Run
from aimd_des.engine.system import System
from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.results import metrics
from aimd_des.results.result import Result
from aimd_des.results.run_data import Piece
from aimd_des.results.tracking import piece_problem
from aimd_des.utils.validation import FloatArray, IntArray
from aimd_des.watch.keys import BACK_TAB, TAB, Keys, NoKeys

# To measure the misallocation an optimum is solved for: seconds, for more agents.
_MOST_AGENTS = 20_000
# Of the time for which a run is watched, at most one part in so many goes into that.
_REST = 20.0
# How much a key changes the speed, and how long a run that goes as fast as it can shall take from then on.
_FACTOR, _SLOWED = 2.0, 60.0
# Seconds between two looks at the keys while the run stands.
_IDLE = 0.1


class WatchedAgent(NamedTuple):
    """What is seen of the agent that is chosen; arrays have shape (m,)."""

    number: int
    demand: FloatArray
    average: FloatArray


class Snapshot(NamedTuple):
    """What is seen at one moment; arrays have shape (m,)."""

    time: float  # in units of simulated time
    # Total demand, and the capacity in force, in units of the resources.
    demand: FloatArray
    capacity: FloatArray
    signals: IntArray  # how many were sent until now
    utilisation: FloatArray  # sum of the averages of present agents, over the capacity
    misallocation: FloatArray  # of present agents; NaN where it is not measured
    in_flight: IntArray | None = None  # copies that have left and not arrived
    agent: WatchedAgent | None = None
    paused: bool = False


class Monitor:
    """Takes a run to its end, and shows it at equal intervals.

    Attributes
    ----------
    reached : float
        The time of the last sample, in units of simulated time.
    """

    def __init__(
        self,
        show: Callable[[Snapshot], None],
        interval: Callable[[float | None], float] | float,
        speed: float | None = None,
        *,
        sparing: bool = False,
        keys: Keys | None = None,
        clock: Callable[[], float] = real.monotonic,
    ) -> None:
        self._show, self._speed, self._sparing = show, speed, sparing
        self._interval = interval if callable(interval) else lambda _: interval
        self._keys, self._clock = NoKeys() if keys is None else keys, clock
        self.reached = 0.0
        self._paused, self._agent, self._digits = False, 0, ""
        self._anchor = (0.0, 0.0)  # real and simulated time from which the speed is counted
        self._copies: list[tuple[int, FloatArray]] = []
        self._misallocation: FloatArray | None = None
        self._rests_until = -math.inf

    def play(self, run: Run) -> Result:
        """Take the run to its end, and observe."""
        run.system.transmitter.on_leave.append(self._left)
        self._anchor = self._clock(), run.time
        looks = 0  # since the interval was last chosen
        first, interval = run.time, self._interval(self._speed)
        while (goal := first + looks * interval) < run.until:
            run.advance(to=max(goal, run.time))
            self._wait(run)
            chosen = self._interval(self._speed)
            self._look(run)
            looks += 1
            if chosen != interval or run.time > goal:  # another speed, or steps by keys
                first, interval, looks = run.time, chosen, 1
        return run.result()

    def _wait(self, run: Run) -> None:
        """Let real time pass as far as the speed asks for, and as long as the run is paused."""
        while run.time < run.until:  # steps may have led to the end
            key = self._keys.read(_IDLE if self._paused else self._early(run))
            if key:
                self._press(key, run)
            elif not self._paused:
                return
            self._look(run)  # also while nothing happens: the terminal may have another size

    def _early(self, run: Run) -> float:
        """Say how many seconds the run is ahead of its speed."""
        if self._speed is None:
            return 0.0
        began, start = self._anchor
        return max(0.0, began + (run.time - start) / self._speed - self._clock())

    def _press(self, key: str, run: Run) -> None:
        """Do what a key says."""
        if key == " ":
            self._paused = not self._paused
        elif key in ("s", "n"):
            self._paused = True
            run.step("event" if key == "s" else "signal")
        elif key in ("+", "-"):
            slowed = run.until / _SLOWED if self._speed is None else self._speed / _FACTOR
            faster = None if self._speed is None else self._speed * _FACTOR
            self._speed = faster if key == "+" else slowed
        elif key in (TAB, BACK_TAB):
            self._agent = (self._agent + (1 if key == TAB else -1)) % run.system.problem.n_agents
        self._choose(key if key.isdecimal() and key.isascii() else "", run.system.problem.n_agents)
        # What passes while the run stands, or at another speed, is not caught up with.
        self._anchor = self._clock(), run.time

    def _choose(self, digits: str, n_agents: int) -> None:
        """Take digits that follow each other for the number of an agent."""
        for typed in (self._digits + digits, digits):
            if digits and int(typed) < n_agents:
                self._agent, self._digits = int(typed), typed
                return
        self._digits = ""

    def _left(self, signal: Signal, arrival: FloatArray) -> None:
        """Take note of copies that are on their way."""
        self._copies.append((signal.resource, arrival[np.isfinite(arrival)]))

    def _in_flight(self, now: float, n_resources: int) -> IntArray:
        """Count the copies that have not arrived, and forget all others."""
        left = [(resource, arrival[arrival > now]) for resource, arrival in self._copies]
        self._copies = [(resource, arrival) for resource, arrival in left if len(arrival)]
        counts = np.zeros(n_resources, dtype=np.int64)
        for resource, arrival in self._copies:
            counts[resource] += len(arrival)
        return counts

    def _look(self, run: Run) -> None:
        self.reached = run.time
        self._show(self._seen(run.system, run.time))

    def _seen(self, system: System, now: float) -> Snapshot:
        demand, average = system.allocations()
        piece = system.conditions.pieces[-1]
        here = average.T[piece.present]
        return Snapshot(
            now,
            demand.sum(axis=1),
            piece.capacity,
            system.transmitter.numbers.copy(),
            metrics.utilisation(here, piece.capacity),
            self._measured(system.problem, piece, here),
            self._in_flight(now, len(demand)),
            WatchedAgent(self._agent, demand[:, self._agent].copy(), average[:, self._agent].copy()),
            self._paused,
        )

    def _measured(self, problem: Problem, piece: Piece, average: FloatArray) -> FloatArray:
        """Measure the misallocation, or give the one before where it is too early for another."""
        began = self._clock()
        if self._misallocation is None or began >= self._rests_until:
            self._misallocation = _misallocation(problem, piece, average)
            if self._sparing:
                ended = self._clock()
                self._rests_until = ended + _REST * (ended - began)
        return self._misallocation


def _misallocation(problem: Problem, piece: Piece, average: FloatArray) -> FloatArray:
    used = average.sum(axis=0)
    if len(average) > _MOST_AGENTS or not (used > 0.0).all():
        return np.full(problem.n_resources, np.nan)
    best = solve_optimum(piece_problem(problem, piece), capacity=used)
    return metrics.relative_error(average, best.allocation)


def last_snapshot(result: Result) -> Snapshot:
    """Look at the end of a run."""
    piece = result.history[-1]
    average = result.average_at_end[piece.present]
    return Snapshot(
        result.until,
        result.demand_at_end.sum(axis=0),
        piece.capacity,
        result.signals_sent.counts(result.problem.n_resources),
        metrics.utilisation(average, piece.capacity),
        _misallocation(result.problem, piece, average),
        result.account.in_flight.sum(axis=1),
    )
