"""The study: what is run, and what is made of it."""

import json
import platform
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import click
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

import aimd_des
from aimd_des import checks
from aimd_des.channel import BroadcastChannel
from aimd_des.discrete import run_discrete
from aimd_des.errors import InputError
from aimd_des.optimum import Optimum, solve_optimum
from aimd_des.output import Place, check_folder, new_folder
from aimd_des.plots import paper_figures
from aimd_des.problem import Problem
from aimd_des.recording import Recording
from aimd_des.results import Result
from aimd_des.simulation import Simulation
from models.smart_cameras import smart_cameras
from scenarios.paper.table import ERROR_BOUND, caption, grid, table
from scenarios.paper.text import markdown, sentences

__all__ = ["FULL", "QUICK", "PaperStudy", "figures", "main", "run", "write"]

#: Steps and draws of the paper's size, and of one that takes seconds less.
FULL = (30_000, 20)
QUICK = (3_000, 4)

#: The file by which a folder is recognised as one that this scenario wrote.
MARK = "paper.json"

_CASES: tuple[tuple[Literal["as_run", "as_printed"], int], ...] = (
    ("as_run", 1),
    ("as_run", 0),
    ("as_printed", 1),
)
_LOOKS = 300
_EVENT_DRIVEN_STEPS = 300
_DPI = 200


@dataclass(frozen=True, eq=False)
class PaperStudy:
    """What the study found.

    Attributes
    ----------
    steps, draws, seed : int
        Length of each run, number of draws of the costs, and seed of the first; draw d has the
        seed ``seed + d`` for its costs and for its responses.
    measures : DataFrame
        One row per increase, lag, draw and resource.  Columns: signals, relative_error,
        misallocation, cost_ratio, overshoot_peak, overshoot_time as in `Result.summary`; unused,
        the share of the capacity that the averages leave; cost_of_use, the cost of sharing optimally
        what was used, over the optimal cost; peak_bound, one plus what all agents add, over the
        capacity, before a signal acts.
    results : tuple of Result
        The run of each draw with the increase as run and the lag as printed; the first is recorded.
    optimum : Optimum
        For the first draw.
    event_driven_steps : int
        How far the event-driven simulation was held against the algorithm.
    same_digests : bool
        Whether latency 0.5 and latency 0 gave the digests of lag 1 and lag 0.
    """

    steps: int
    draws: int
    seed: int
    measures: pd.DataFrame
    results: tuple[Result, ...]
    optimum: Optimum
    event_driven_steps: int
    same_digests: bool


def run(steps: int = FULL[0], draws: int = FULL[1], seed: int = 0) -> PaperStudy:
    """Run the study.

    Parameters
    ----------
    steps : int
        K, at least 1.
    draws : int
        How many draws of the costs, at least 2.
    seed : int
        Of the first draw, at least 0.

    Returns
    -------
    PaperStudy
        A pure function of the arguments.

    Raises
    ------
    InputError
        If an argument is outside its range.
    """
    steps = checks.integer("steps", steps, low=1)
    draws = checks.integer("draws", draws, low=2)
    seed = checks.integer("seed", seed, low=0)
    shown = np.unique(np.round(np.geomspace(1.0, steps, _LOOKS)))
    measures, results, first_optimum = [], [], None
    for draw in range(draws):
        optimum = None
        for increase, lag in _CASES:
            problem = smart_cameras(seed + draw, increase=increase)
            optimum = optimum or solve_optimum(problem)  # it does not depend on the increase
            kept = draw == 0 and (increase, lag) == _CASES[0]
            recording = Recording(shown, shown, tail=100) if kept else Recording("end", "end")
            result = run_discrete(problem, steps=steps, seed=seed + draw, lag=lag, recording=recording)
            measures.append(_measure(result, optimum, lag).assign(increase=increase, lag=lag, draw=draw))
            if (increase, lag) == _CASES[0]:
                results.append(result)
        first_optimum = first_optimum or optimum
    assert first_optimum is not None  # noqa: S101 - there are draws and cases
    compared = min(steps, _EVENT_DRIVEN_STEPS)
    return PaperStudy(
        steps=steps,
        draws=draws,
        seed=seed,
        measures=pd.concat(measures, ignore_index=True),
        results=tuple(results),
        optimum=first_optimum,
        event_driven_steps=compared,
        same_digests=_event_driven_agrees(results[0].problem, compared, seed),
    )


def _measure(result: Result, optimum: Optimum, lag: int) -> pd.DataFrame:
    """Measure one run, one row per resource."""
    problem, summary = result.problem, result.summary(optimum)
    used = solve_optimum(problem, capacity=result.average_at_end.sum(axis=0))
    added = (1 + lag) * problem.increase.sum(axis=0)
    columns = [
        "signals",
        "relative_error",
        "misallocation",
        "cost_ratio",
        "overshoot_peak",
        "overshoot_time",
    ]
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
        == run_discrete(problem, steps=steps, seed=seed, lag=lag).digest
        for latency, lag in ((0.5, 1), (0.0, 0))
    )


def figures(study: PaperStudy) -> dict[str, Figure]:
    """Draw the paper's four figures.

    Parameters
    ----------
    study : PaperStudy
        What to draw.

    Returns
    -------
    dict of str to Figure
        figure1 to figure4, three panels each.
    """
    drawn = paper_figures(study.results, study.optimum)
    errors = drawn["figure2"].axes[1]
    errors.axhline(ERROR_BOUND, color="0.35", linewidth=1.2, linestyle=":")
    beside, words = errors.get_yaxis_transform(), f"the paper: below {100 * ERROR_BOUND:g} %"
    errors.text(0.03, ERROR_BOUND, words, transform=beside, va="bottom")
    return drawn


def write(study: PaperStudy, place: Place) -> None:
    """Write figures, tables and provenance, all or nothing.

    Parameters
    ----------
    study : PaperStudy
        What was found.
    place : Place
        Where to, as `check_folder` has found it.

    Raises
    ------
    InputError
        If something has come to that place meanwhile; it says where the results are.
    """
    provenance = {
        "scenario": "paper",
        "steps": study.steps,
        "draws": study.draws,
        "seed": study.seed,
        "digests": [result.digest for result in study.results],
        "versions": {
            "aimd_des": aimd_des.__version__,
            "python": platform.python_version(),
            **{library: version(library) for library in ("numpy", "scipy", "numba", "simpy", "matplotlib")},
        },
    }
    with new_folder(place) as folder:
        for name, figure in figures(study).items():
            figure.savefig(folder / f"{name}.png", dpi=_DPI)
        table(study).to_csv(folder / "table.csv", index=False)
        (folder / "table.md").write_text(markdown(study), encoding="utf-8")
        (folder / MARK).write_text(json.dumps(provenance, indent=2) + "\n", encoding="utf-8")


class _Refusal(click.ClickException):
    """A user's mistake: the sentence, and exit code 2."""

    exit_code = 2


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--quick", is_flag=True, help=f"Only {QUICK[0]:,} steps and {QUICK[1]} draws of the costs.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the first draw.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/paper"),
    show_default=True,
    help="Folder for figures and tables, new or empty.",
)
@click.option("--overwrite", is_flag=True, help="Replace a folder that this scenario wrote.")
def main(quick: bool, seed: int, out: Path, overwrite: bool) -> None:
    """Run the paper's experiment: twelve panels, and its numbers beside ours."""
    steps, draws = QUICK if quick else FULL
    console = Console(width=None if sys.stdout.isatty() else 110, highlight=False)
    try:
        place = check_folder(out, overwrite=overwrite, mark=MARK)
        with console.status(f"{steps:,} steps, {draws} draws of the costs, {len(_CASES)} ways"):
            study = run(steps, draws, seed)
            write(study, place)
    except InputError as refusal:
        raise _Refusal(str(refusal)) from None
    header, rows = grid(study)
    shown = Table(title=caption(study))
    for column, name in enumerate(header):
        shown.add_column(name, justify="left" if column < 2 else "right")
    for row in rows:
        shown.add_row(*row)
    console.print(shown)
    for sentence in sentences(study):
        console.print(f"• {sentence}")
    console.print(f"Results in {out}")
