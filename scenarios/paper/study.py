"""The study: what is run, and what is made of it."""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from aimd_des import (
    BroadcastChannel,
    Optimum,
    Problem,
    Recording,
    Result,
    Simulation,
    checks,
    run_synchronous,
    solve_optimum,
    theory,
)
from aimd_des.plots import paper_figures
from aimd_des.scenario import Place
from aimd_des.study import replicate
from models.smart_cameras import smart_cameras
from scenarios.common import command as common
from scenarios.common.command import Finding, command
from scenarios.paper.table import ERROR_BOUND, PaperStudy, caption, grid, table
from scenarios.paper.text import markdown, sentences

#: The file by which a folder is recognised as one that this scenario wrote.
MARK = "paper.json"

#: Steps and draws of the paper's size, and of one that takes seconds less.
FULL = (30_000, 60)
QUICK = (3_000, 4)

_Increase = Literal["as_run", "as_printed"]
_CASES: tuple[tuple[_Increase, int], ...] = (
    ("as_run", 1),
    ("as_run", 0),
    ("as_printed", 1),
)
_FIGURES = ("figure1", "figure2", "figure3", "figure4")
_LOOKS = 300
_EVENT_DRIVEN_STEPS = 300


def run(steps: int = FULL[0], draws: int = FULL[1], seed: int = 0, runs: Path | None = None) -> PaperStudy:
    """Run so many steps, at least 1, of so many draws of the costs, at least 2; others are refused."""
    steps = checks.integer("steps", steps, low=1)
    draws = checks.integer("draws", draws, low=2)
    seed = checks.integer("seed", seed, low=0)
    (kept,) = replicate([partial(_draw, steps, seed)], draws, seed, workers=1, out=runs)
    # These are not kept: to run them again takes a tenth of a second each.
    results = tuple(_run(*_CASES[0], steps, draw, shown=draw == seed) for draw in range(seed, seed + draws))
    compared = min(steps, _EVENT_DRIVEN_STEPS)
    return PaperStudy(
        steps=steps,
        draws=draws,
        seed=seed,
        measures=pd.concat(map(pd.DataFrame, kept), ignore_index=True),
        results=results,
        optimum=solve_optimum(results[0].problem),
        event_driven_steps=compared,
        same_digests=_event_driven_agrees(results[0].problem, compared, seed),
    )


def _run(increase: _Increase, lag: int, steps: int, seed: int, *, shown: bool = False) -> Result:
    """Run one draw of the costs in one way, recorded for the figures if it is to be shown."""
    looks = np.unique(np.round(np.geomspace(1.0, steps, _LOOKS)))
    recording = Recording(looks, looks, tail=100) if shown else Recording("end", "end")
    return run_synchronous(
        smart_cameras(seed, increase=increase), steps=steps, seed=seed, lag=lag, recording=recording
    )


def _draw(steps: int, first: int, seed: int) -> dict[Any, list[Any]]:
    """Run one draw of the costs in all ways; give the columns of the measures."""
    optimum = solve_optimum(smart_cameras(seed))  # it does not depend on the increase
    measures = [
        _measure(_run(increase, lag, steps, seed), optimum, lag).assign(
            increase=increase, lag=lag, draw=seed - first
        )
        for increase, lag in _CASES
    ]
    return pd.concat(measures).to_dict("list")


def _measure(result: Result, optimum: Optimum, lag: int) -> pd.DataFrame:
    """Measure one run, one row per resource."""
    problem, summary = result.problem, result.summary(optimum)
    used = solve_optimum(problem, capacity=result.average_at_end.sum(axis=0))
    added = (1 + lag) * problem.increase.sum(axis=0)
    columns = ["signals", "relative_error", "misallocation", "cost_ratio", "overshoot_peak", "overshoot_time"]
    return (
        summary[columns]
        .assign(
            unused=1.0 - summary["utilisation"],
            cost_of_use=used.cost / optimum.cost,
            peak_bound=1.0 + added / problem.capacity,
        )
        .reset_index()
    )


def _event_driven_agrees(problem: Problem, steps: int, seed: int) -> bool:
    """Compare the event-driven simulation with the algorithm, bit by bit, for both lags."""
    return all(
        Simulation(problem, channel=BroadcastChannel(latency=latency), seed=seed).run(steps).digest
        == run_synchronous(problem, steps=steps, seed=seed, lag=lag).digest
        for latency, lag in ((0.5, 1), (0.0, 0))
    )


def figures(study: PaperStudy) -> dict[str, Figure]:
    """Draw the paper's four figures, figure1 to figure4, three panels each."""
    expected = theory.convergence(study.results[0].problem, lag=_CASES[0][1])
    drawn = paper_figures(study.results, study.optimum, expected=expected)
    errors = drawn["figure2"].axes[1]
    errors.axhline(ERROR_BOUND, color="0.35", linewidth=1.2, linestyle=":")
    beside, words = errors.get_yaxis_transform(), f"the paper: below {100 * ERROR_BOUND:g} %"
    errors.text(0.03, ERROR_BOUND, words, transform=beside, va="bottom")
    return drawn


def write(study: PaperStudy, place: Place) -> None:
    """Write figures, tables and provenance into a folder, as `check_folder` has found it."""
    common.write(_finding(study), place)


def _one(drawn: Callable[[], dict[str, Figure]], name: str) -> Figure:
    return drawn()[name]


def _finding(study: PaperStudy) -> Finding:
    header, rows = grid(study)
    drawn = cache(partial(figures, study))
    return Finding(
        "paper",
        {"steps": study.steps, "draws": study.draws, "seed": study.seed},
        table(study),
        pd.DataFrame(rows, columns=header),
        sentences(study),
        {name: partial(_one, drawn, name) for name in _FIGURES},
        {"table.md": markdown(study)},
        title=caption(study),
        record={"digests": [result.digest for result in study.results]},
    )


def _study(quick: bool, seed: int, runs: Path | None) -> Finding:
    return _finding(run(*(QUICK if quick else FULL), seed, runs))


main = command("paper", _study, "The paper's experiment: twelve panels, and its numbers beside ours.")
