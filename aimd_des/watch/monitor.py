"""Looks at a run in progress, which change nothing in it, and keep pace with real time if that is wanted."""

import math
import time as real
from collections.abc import Callable
from itertools import count
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.results import metrics
from aimd_des.results.result import Result
from aimd_des.results.run_data import Piece
from aimd_des.results.tracking import piece_problem
from aimd_des.utils.validation import FloatArray

# To measure the misallocation an optimum is solved for: seconds, for more agents.
_MOST_AGENTS = 20_000
# Of the time for which a run is watched, at most one part in so many goes into that.
_REST = 20.0


class Snapshot(NamedTuple):
    """What is seen at one moment; arrays have shape (m,)."""

    time: float  # in units of simulated time
    # Total demand, and the capacity in force, in units of the resources.
    demand: FloatArray
    capacity: FloatArray
    signals: npt.NDArray[np.int64]  # how many were sent until now
    utilisation: FloatArray  # sum of the averages of those who are here, over the capacity
    misallocation: FloatArray  # of those who are here; NaN where it is not measured


class Monitor:
    """Looks at a run at equal intervals, as a process that observes and does nothing else.

    Attributes
    ----------
    reached : float
        The time of the last look, in units of simulated time.
    """

    def __init__(
        self,
        show: Callable[[Snapshot], None],
        interval: float,
        speed: float | None = None,
        *,
        sparing: bool = False,
        clock: Callable[[], float] = real.monotonic,
        sleep: Callable[[float], None] = real.sleep,
    ) -> None:
        self._show, self._interval, self._speed, self._sparing = show, interval, speed, sparing
        self._clock, self._sleep = clock, sleep
        self.reached = 0.0
        self._misallocation: FloatArray | None = None
        self._rests_until = -math.inf

    def process(self, system: System) -> ProcessGenerator:
        """Look on, from the beginning to the end of the run."""
        began = self._clock()
        for number in count():
            now = number * self._interval
            if now >= system.until:
                return
            yield system.env.at(now, EventKind.OBSERVE)
            if self._speed is not None:
                self._sleep(max(0.0, began + now / self._speed - self._clock()))
            self.reached = now
            self._show(self._look(system, now))

    def _look(self, system: System, now: float) -> Snapshot:
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
    )
