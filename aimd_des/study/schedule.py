"""Which runs are due: replication by replication over all points, and more where means are not known yet."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from aimd_des.study.points import PlannedRun, Point, run_of
from aimd_des.study.statistics.stopping import replications_needed
from aimd_des.study.study import Precision, Study


@dataclass
class _PointProgress:
    """How far a point is."""

    point: Point
    runs: list[PlannedRun] = field(default_factory=list)
    waiting: int = 0
    #: By resource, then by replication; a run that failed has none.
    values: dict[str, dict[int, float]] = field(default_factory=dict)


class Schedule:
    """The runs of a study in their order; what it adds depends on their results alone."""

    def __init__(self, study: Study, points: Sequence[Point], earlier: Mapping[str, int]) -> None:
        self._study = study
        self._earlier = earlier
        self._points = {point.name: _PointProgress(point) for point in points}
        self._due: deque[PlannedRun] = deque()
        for replication in range(study.replications):
            for progress in self._points.values():
                self._add(progress, replication)

    def _add(self, progress: _PointProgress, replication: int) -> None:
        run = run_of(self._study, progress.point, replication)
        progress.runs.append(run)
        progress.waiting += 1
        self._due.append(run)

    @property
    def runs(self) -> list[PlannedRun]:
        """All runs so far, point by point."""
        return [run for progress in self._points.values() for run in progress.runs]

    def __len__(self) -> int:
        return sum(len(progress.runs) for progress in self._points.values())

    def next(self, waits: Callable[[PlannedRun], bool]) -> PlannedRun | None:
        """Give the next run that need not wait for another one."""
        place = next((place for place, run in enumerate(self._due) if not waits(run)), None)
        if place is None:
            return None
        run = self._due[place]
        del self._due[place]
        return run

    def record(self, run: PlannedRun, values: Sequence[tuple[str, float]]) -> None:
        """Take note of a run, and decide on more when all of its point are there."""
        progress = self._points[run.point.name]
        progress.waiting -= 1
        for resource, value in values:
            progress.values.setdefault(resource, {})[run.replication] = value
        precision = self._study.precision
        if precision is not None and progress.waiting == 0:
            there = len(progress.runs)
            wanted = _wanted(progress, precision)
            if wanted == there:
                wanted = max(there, self._earlier.get(run.point.name, 0))
            for replication in range(there, wanted):
                self._add(progress, replication)


def _wanted(progress: _PointProgress, precision: Precision) -> int:
    """Say how many replications a point should have, by those it has."""
    there = wanted = len(progress.runs)
    for resource, found in progress.values.items():
        values = [found[place] for place in sorted(found) if math.isfinite(found[place])]
        if precision.resource in ("all", resource) and values:
            needed = replications_needed(
                values, precision.half_width, precision.confidence, at_least=2, at_most=precision.at_most
            )
            # Runs that have failed, or have no such measure, stand for none; where all have, more would, too.
            wanted = max(wanted, needed + there - len(values))
    return min(wanted, max(there, precision.at_most))
