"""The optimum follows: the centralised solution for each piece of a run between two interventions."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from aimd_des.problem.costs import selected_costs
from aimd_des.problem.optimum import Optimum, solve_optimum
from aimd_des.problem.problem import Problem, Resource
from aimd_des.results import metrics
from aimd_des.results.frames import categorical
from aimd_des.results.misallocation import misallocation
from aimd_des.results.run_data import Observations, Piece
from aimd_des.utils.validation import FloatArray

if TYPE_CHECKING:
    import pandas as pd

#: By what a run has recovered from a change.
Distance = Literal["level", "relative_error", "misallocation"]


def is_unchanged(problem: Problem, piece: Piece) -> bool:
    """Tell whether the problem of a piece is that of the run."""
    as_given = piece.costs is problem.costs and bool((piece.capacity == problem.capacity).all())
    return as_given and bool(piece.present.all())


def piece_problem(problem: Problem, piece: Piece) -> Problem:
    """Build the problem of a piece: the capacities and costs in force, for the agents that are here."""
    if is_unchanged(problem, piece):
        return problem
    here = piece.present
    resources = [
        _resource(resource, float(piece.capacity[j]), problem.increase[here, j], problem.decrease[here, j])
        for j, resource in enumerate(problem.resources)
    ]
    names = [name for name, present in zip(problem.agent_names, here, strict=True) if present]
    return Problem(resources, selected_costs(piece.costs, here), agent_names=names)


def _resource(resource: Resource, capacity: float, increase: FloatArray, decrease: FloatArray) -> Resource:
    return replace(resource, capacity=capacity, increase=increase, decrease=decrease)


class PieceOptima:
    """The optima of pieces, each solved when it is first asked for, and those that are alike once."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._solved: dict[tuple[bytes, bytes, int], Optimum | None] = {}

    @staticmethod
    def key(piece: Piece) -> tuple[bytes, bytes, int]:
        """Give what is equal for pieces with the same problem."""
        return piece.capacity.tobytes(), piece.present.tobytes(), id(piece.costs)

    def __call__(self, piece: Piece) -> Optimum | None:
        """Solve a piece."""
        key = self.key(piece)
        if key not in self._solved:
            anybody = bool(piece.present.any())
            self._solved[key] = solve_optimum(piece_problem(self.problem, piece)) if anybody else None
        return self._solved[key]


def pieces_frame(
    problem: Problem,
    pieces: Sequence[Piece],
    optima: PieceOptima,
    until: float,
    observations: Observations,
) -> "pd.DataFrame":
    """Tell what was in force when, with its optimum and what total demand did."""
    import pandas as pd

    m, stretches = problem.n_resources, observations.stretches
    ends = [*(piece.start for piece in pieces[1:]), until]
    missing = np.full(m, np.nan)
    rows = []
    for place, (piece, end) in enumerate(zip(pieces, ends, strict=True)):
        best = optima(piece)
        over = stretches[place].overshoot() if stretches else metrics.Overshoot(missing, missing, missing)
        used = stretches[place].used / (end - piece.start) / piece.capacity if stretches else missing
        rows += [
            {
                "start": piece.start,
                "end": end,
                "resource": j,
                "capacity": float(piece.capacity[j]),
                "agents": int(piece.present.sum()),
                "multiplier": np.nan if best is None else float(best.multipliers[j]),
                "optimal_cost": np.nan if best is None else best.cost,
                "utilisation": float(used[j]),
                "overshoot_peak": float(over.peak[j]),
                "overshoot_time": float(over.time[j]),
                "overshoot_mean": float(over.mean[j]),
            }
            for j in range(m)
        ]
    frame = pd.DataFrame(rows)
    frame["resource"] = categorical(frame["resource"].to_numpy(), problem.resource_names)
    return frame


def tracking_frame(
    problem: Problem,
    pieces: Sequence[Piece],
    optima: PieceOptima,
    observations: Observations,
) -> "pd.DataFrame":
    """Hold the averages at every recorded time against the optimum that is in force then."""
    import pandas as pd

    times = observations.allocation_times
    starts = np.array([piece.start for piece in pieces])
    in_force = np.searchsorted(starts, times, side="right") - 1
    m = problem.n_resources
    level, error, capacity = np.full((3, len(times), m), np.nan)
    for row, place in enumerate(in_force.tolist()):
        piece = pieces[place]
        best = optima(piece)
        capacity[row] = piece.capacity
        if best is not None:
            average = observations.average[row].T[piece.present]
            level[row] = metrics.utilisation(average, piece.capacity)
            error[row] = metrics.relative_error(average, best.allocation)
    return pd.DataFrame(
        {
            "time": np.repeat(times, m),
            "resource": categorical(np.tile(np.arange(m), len(times)), problem.resource_names),
            "capacity": capacity.ravel(),
            "level": level.ravel(),
            "relative_error": error.ravel(),
        }
    )


def recovery_frame(
    problem: Problem,
    pieces: Sequence[Piece],
    optima: PieceOptima,
    until: float,
    observations: Observations,
    measure: Distance,
    within: float,
    of: Literal["level", "change"],
) -> "pd.DataFrame":
    """Tell how long it took after each change until averages were where they should be, and stayed there."""
    import pandas as pd

    times = observations.allocation_times
    away = _distances(problem, pieces, optima, observations, measure)
    rows = []
    for place, piece in enumerate(pieces[1:], start=1):
        end = until if piece is pieces[-1] else pieces[place + 1].start
        looks = (times >= piece.start) & ((times < end) | (piece is pieces[-1]))
        for j, distance in enumerate(away[looks].T):
            limit = within * (1.0 if of == "level" or not len(distance) else float(distance[0]))
            found = _time_within(times[looks] - piece.start, distance, limit)
            rows.append({"start": piece.start, "end": end, "resource": j, "recovery_time": found})
    frame = pd.DataFrame(rows, columns=["start", "end", "resource", "recovery_time"]).astype(
        {"start": np.float64, "end": np.float64, "recovery_time": np.float64}
    )
    frame["resource"] = categorical(frame["resource"].to_numpy(dtype=np.int64), problem.resource_names)
    return frame


def _distances(
    problem: Problem,
    pieces: Sequence[Piece],
    optima: PieceOptima,
    observations: Observations,
    measure: Distance,
) -> FloatArray:
    """Measure at every recorded time how far averages are from where they should be, (r, m)."""
    times, m = observations.allocation_times, problem.n_resources
    if measure == "misallocation":
        starts = np.array([piece.start for piece in pieces])
        result = np.full((len(times), m), np.nan)
        # What was before the first change is not asked for.
        for row in np.flatnonzero(times >= starts[min(1, len(starts) - 1)]).tolist():
            piece = pieces[int(np.searchsorted(starts, times[row], side="right")) - 1]
            if piece.present.any():
                average = observations.average[row].T[piece.present]
                result[row] = misallocation(piece_problem(problem, piece), average)
        return result
    frame = tracking_frame(problem, pieces, optima, observations)
    off = frame["level"] - 1.0 if measure == "level" else frame["relative_error"]
    return np.asarray(np.abs(off.to_numpy()).reshape(len(times), m))


def _time_within(times: FloatArray, distance: FloatArray, limit: float) -> float:
    """Compute from when on a distance stays within a limit: a line between two samples."""
    if not len(times) or np.isnan(distance).any():
        return np.nan
    outside = np.flatnonzero(distance > limit)
    if not len(outside):
        return 0.0
    last = int(outside[-1])
    if last == len(times) - 1:
        return np.inf
    share = (distance[last] - limit) / (distance[last] - distance[last + 1])
    return float(times[last] + share * (times[last + 1] - times[last]))
