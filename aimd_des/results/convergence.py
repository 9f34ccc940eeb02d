"""How far averages were from the optimum over time, at some of the times at which they were recorded."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from aimd_des.problem.optimum import Optimum
from aimd_des.problem.problem import Problem
from aimd_des.results import metrics
from aimd_des.results.frames import categorical
from aimd_des.results.looks import looks
from aimd_des.results.misallocation import misallocation
from aimd_des.results.run_data import Observations, Piece
from aimd_des.results.tracking import piece_problem

if TYPE_CHECKING:
    import pandas as pd

_LOOKS = 16
# Of many agents fewer looks are taken: each is an optimum to be solved.
_BUDGET = 100_000
_FEWEST_LOOKS = 4


def _default_looks(n_agents: int) -> int:
    """Say how many times are measured unless a number is given."""
    return int(np.clip(_BUDGET // n_agents, _FEWEST_LOOKS, _LOOKS))


def convergence_frame(
    problem: Problem,
    seen: Observations,
    piece_at: Callable[[float], Piece],
    optimum_of: Callable[[Piece], Optimum | None],
    count: int | None,
) -> "pd.DataFrame":
    """Measure at so many recorded times, evenly spread over the logarithm of time."""
    import pandas as pd

    count = _default_looks(problem.n_agents) if count is None else count
    shown = looks(seen.allocation_times, count, log=True)
    times, m = seen.allocation_times[shown], problem.n_resources
    measured, error, cost = np.full((3, len(times), m), np.nan)
    for row, (look, time) in enumerate(zip(shown.tolist(), times.tolist(), strict=True)):
        piece = piece_at(time)
        if piece.present.any():
            average = seen.average[look].T[piece.present]
            in_force = piece_problem(problem, piece)
            measured[row] = misallocation(in_force, average)
            best = optimum_of(piece)
            assert best is not None  # noqa: S101 - an agent is present
            error[row] = metrics.relative_error(average, best.allocation)
            cost[row] = metrics.cost_ratio(in_force.costs, average, best.allocation)
    return pd.DataFrame(
        {
            "time": np.repeat(times, m),
            "resource": categorical(np.tile(np.arange(m), len(times)), problem.resource_names),
            "misallocation": measured.ravel(),
            "relative_error": error.ravel(),
            "cost_ratio": cost.ravel(),
        }
    )
