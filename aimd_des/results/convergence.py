"""How far averages were from the optimum over time, at some of the times at which they were recorded."""

from typing import TYPE_CHECKING

import numpy as np

from aimd_des.results import metrics
from aimd_des.results.frames import categorical
from aimd_des.results.looks import looks
from aimd_des.results.misallocation import misallocation
from aimd_des.results.tracking import piece_problem

if TYPE_CHECKING:
    import pandas as pd

    from aimd_des.results.result import Result

_LOOKS = 16
# Of many agents fewer looks are taken: each is an optimum to be solved.
_BUDGET = 100_000
_FEWEST_LOOKS = 4


def default_looks(n_agents: int) -> int:
    """Say how many times are measured unless a number is given."""
    return int(np.clip(_BUDGET // n_agents, _FEWEST_LOOKS, _LOOKS))


def convergence_frame(result: "Result", count: int) -> "pd.DataFrame":
    """Measure at so many recorded times, evenly spread over the logarithm of time."""
    import pandas as pd

    problem, seen = result.problem, result.observations
    shown = looks(seen.allocation_times, count, log=True)
    times, m = seen.allocation_times[shown], problem.n_resources
    measured, error, cost = np.full((3, len(times), m), np.nan)
    for row, (look, time) in enumerate(zip(shown.tolist(), times.tolist(), strict=True)):
        piece = result.piece_at(time)
        if piece.present.any():
            average = seen.average[look].T[piece.present]
            in_force = piece_problem(problem, piece)
            measured[row] = misallocation(in_force, average)
            best = result.optimum_of(piece)
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
