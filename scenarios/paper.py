"""The paper's experiment: its twelve panels, and its numbers beside ours.

60 cameras share memory, disk and bandwidth for 30,000 steps of the synchronous algorithm. Runs cover
several draws of their costs, both readings of when a signal acts (``lag``), and both values of disk's
additive increase.  Written are the paper's figures 1 to 4, the table "paper / this run / mean and
standard deviation over the draws" as CSV and Markdown, and what to make of the differences.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cache, partial
from math import ceil
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
from models.smart_cameras import INCREASES, smart_cameras
from scenarios.common import command as common
from scenarios.common.command import Finding, command

__all__ = ["FULL", "MARK", "QUICK", "PaperStudy", "figures", "main", "run", "write"]

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


#: What the paper reports: capacity events in 30,000 steps, and a bound for the relative error.
CAPACITY_EVENTS = {"memory": 11_427, "disk": 11_988, "bandwidth": 8_355}
PAPER_STEPS = 30_000
ERROR_BOUND = 0.05

# Column of the measures, its name in words, the factor and the format in which it is written.
_MEASURES = (
    ("signals", "capacity events", 1, "{:,.0f}"),
    ("relative_error", "relative error, %", 100, "{:.2f}"),
    ("unused", "unused capacity, %", 100, "{:.2f}"),
    ("misallocation", "misallocation, %", 100, "{:.2f}"),
    ("overshoot_peak", "peak / capacity", 1, "{:.3f}"),
    ("cost_ratio", "cost ratio", 1, "{:.3f}"),
)


@dataclass(frozen=True, eq=False)
class PaperStudy:
    """What the study found."""

    # Length of each run, number of draws of the costs, and seed of the first; draw d has the seed ``seed
    # + d`` for its costs and for its responses.
    steps: int
    draws: int
    seed: int
    # One row per increase, lag, draw and resource.  Columns: signals, relative_error, misallocation,
    # cost_ratio, overshoot_peak, overshoot_time as in `Result.summary`; unused, the share of the capacity
    # that the averages leave; cost_of_use, the cost of sharing optimally what was used, over the optimal
    # cost; peak_bound, one plus what all agents add, over the capacity, before a signal acts.
    measures: pd.DataFrame
    # The run of each draw with the increase as run and the lag as printed; the first is recorded.
    results: tuple[Result, ...]
    optimum: Optimum  # for the first draw
    event_driven_steps: int  # how far the event-driven simulation was held against the algorithm
    same_digests: bool  # whether latency 0.5 and latency 0 gave the digests of lag 1 and lag 0


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


def table(study: PaperStudy) -> pd.DataFrame:
    """Put the paper's numbers beside ours, a row for each increase, lag, measure and resource.

    Further columns: paper (its capacity events scaled to the steps of the study), this_run (the first draw),
    mean and std (over the draws).
    """
    rows = []
    for (increase, lag), case in study.measures.groupby(["increase", "lag"], sort=False):
        for column, *_ in _MEASURES:
            for resource in _rows_of(column):
                # The cost ratio is of all resources together and stands in the row of each.
                place = "memory" if resource == "all" else resource
                drawn = case.loc[case["resource"] == place, column]
                rows.append(
                    {
                        "increase": increase,
                        "lag": lag,
                        "measure": column,
                        "resource": resource,
                        "paper": _paper(column, resource, study.steps),
                        "this_run": drawn.iloc[0],
                        "mean": drawn.mean(),
                        "std": drawn.std(),
                    }
                )
    return pd.DataFrame(rows)


def _rows_of(column: str) -> list[str]:
    return ["all"] if column == "cost_ratio" else list(CAPACITY_EVENTS)


def _paper(column: str, resource: str, steps: int) -> str:
    """Say what the paper reports."""
    if column == "signals":
        return f"{CAPACITY_EVENTS[resource] * steps / PAPER_STEPS:.0f}"
    return {"relative_error": f"below {ERROR_BOUND:g}", "cost_ratio": "close to 1"}.get(column, "")


def grid(study: PaperStudy) -> tuple[list[str], list[list[str]]]:
    """Lay out the table for readers, both lags side by side; the last row is disk's increase as printed."""
    header = ["measure", "resource", "paper", "run, lag 1", "draws, lag 1", "run, lag 0", "draws, lag 0"]
    numbers = {
        (row["increase"], row["lag"], row["measure"], row["resource"]): row
        for row in table(study).to_dict("records")
    }
    rows = []
    for column, words, factor, form in _MEASURES:
        for resource in _rows_of(column):
            pair = [numbers["as_run", lag, column, resource] for lag in (1, 0)]
            cells = [cell for row in pair for cell in _cells(row, factor, form)]
            rows.append([words, resource, _for_readers(pair[0]["paper"]), *cells])
    printed = numbers["as_printed", 1, "signals", "disk"]
    words = f"events, alpha {INCREASES['as_printed'][1]:g}"
    rows.append([words, "disk", _for_readers(printed["paper"]), *_cells(printed, 1, "{:,.0f}"), "", ""])
    return header, rows


def _for_readers(paper: str) -> str:
    if paper.isdigit():
        return f"{int(paper):,}"
    return paper.replace(f"{ERROR_BOUND:g}", f"{100 * ERROR_BOUND:g}")


def _cells(row: dict[Hashable, Any], factor: int, form: str) -> list[str]:
    this, mean, std = (form.format(factor * row[column]) for column in ("this_run", "mean", "std"))
    return [this, f"{mean} ± {std}"]


def caption(study: PaperStudy) -> str:
    """Say what the table shows, as a heading."""
    return (
        f"60 cameras, {study.steps:,} steps: the run with seed {study.seed}, "
        f"and mean ± standard deviation over {study.draws} draws of the costs"
    )


def markdown(study: PaperStudy) -> str:
    """Write table and sentences as a page of Markdown."""
    header, rows = grid(study)
    lines = [
        "# The paper's experiment",
        "",
        f"{caption(study)}.",
        "",
        f"| {' | '.join(header)} |",
        f"|---|---|{'---:|' * (len(header) - 2)}",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
        *(f"- {sentence}" for sentence in sentences(study)),
    ]
    return "\n".join(lines) + "\n"


def sentences(study: PaperStudy) -> list[str]:
    """Say where the paper's word and the figures differ, in computed numbers, a few sentences a point."""
    scaled = f"The paper's capacity events are scaled from {PAPER_STEPS:,} to {study.steps:,} steps."
    return [
        *([] if study.steps == PAPER_STEPS else [scaled]),
        _alpha(study),
        _cost(study),
        _split(study),
        _lag(study),
        _peaks(study),
        _event_driven(study),
    ]


def _case(study: PaperStudy, lag: int, increase: str = "as_run") -> pd.DataFrame:
    """Take the measures of one way of running, all draws and resources."""
    rows = study.measures
    return rows[(rows["increase"] == increase) & (rows["lag"] == lag)]


def _first(study: PaperStudy) -> pd.DataFrame:
    """Take the measures of the run that is drawn, one row per resource."""
    case = _case(study, 1)
    return case[case["draw"] == 0]


def _events(study: PaperStudy, lag: int, resource: str, increase: str = "as_run") -> tuple[str, float]:
    """Sum up capacity events: mean and spread in words, and standard deviations to the paper's number."""
    case = _case(study, lag, increase)
    drawn = case.loc[case["resource"] == resource, "signals"]
    mean, std = float(drawn.mean()), float(drawn.std())
    paper = CAPACITY_EVENTS[resource] * study.steps / PAPER_STEPS
    return f"{mean:,.0f} ± {std:,.0f}", abs(paper - mean) / std


def _percent(share: float, digits: int = 1) -> str:
    return f"{100 * share:.{digits}f} %"


def _percents(shares: "pd.Series[float]", digits: int = 1) -> str:
    return _join([_percent(share, digits) for share in shares])


def _join(texts: list[str]) -> str:
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def _alpha(study: PaperStudy) -> str:
    """Tell which additive increase of disk was run."""
    gives, far = {}, {}
    for increase, alphas in INCREASES.items():
        counts, far[increase] = _events(study, 1, "disk", increase)
        gives[increase] = (
            f"{alphas[1]:g} ({10_000 * alphas[1]:g} MB) gives {counts} capacity events, {far[increase]:.1f}"
        )
    clear = far["as_printed"] > 5.0 and far["as_run"] <= 2.0
    return (
        f"Disk's printed increase of {gives['as_printed']} standard deviations from the paper's number. "
        f"An increase of {gives['as_run']} from it."
        f"{' The printed value cannot be the one that was run.' if clear else ''}"
    )


def _cost(study: PaperStudy) -> str:
    """Explain why the cost ratio is not 1."""
    first, drawn = _first(study), _case(study, 1)["cost_ratio"]
    ratio, use = float(first["cost_ratio"].iloc[0]), float(first["cost_of_use"].iloc[0])
    return (
        f"The cost ratio is {ratio:.3f} in this run and {drawn.mean():.3f} over the draws, as totals are "
        f"above the capacities in only {_percents(first['overshoot_time'], 0)} of the steps. Optimal "
        f"shares of what was used would cost {use:.3f}; the averages cost "
        f"{_percent(ratio / use - 1.0, 2)} more."
    )


def _split(study: PaperStudy) -> str:
    """Split the relative error into what is unused and what is shared wrongly."""
    first = _first(study)
    unused = float((first["unused"] / first["relative_error"]).min())
    return (
        f"Of this run's relative errors at least {_percent(unused, 0)} is unused capacity. The misallocation "
        f"is {_percents(first['misallocation'])}."
    )


def _lag(study: PaperStudy) -> str:
    """Tell which lag fits the paper's bound of the relative error."""
    spans, fits = {}, {}
    for lag in (1, 0):
        case = _case(study, lag)
        error = case.loc[case["resource"] == "bandwidth", "relative_error"]
        fits[lag] = int((error < ERROR_BOUND).sum())
        spans[lag] = (
            f"{_percent(error.min())} to {_percent(error.max())}, "
            f"below {100 * ERROR_BOUND:g} % in {fits[lag]} of {study.draws} draws."
        )
    verdict = "fits the run without the lag" if fits[0] > fits[1] else "does not tell the two apart here"
    return (
        f"With lag 1 the relative error of bandwidth is {spans[1]} With lag 0 it is {spans[0]} "
        f"The paper's “below {100 * ERROR_BOUND:g} %” {verdict}."
    )


def _peaks(study: PaperStudy) -> str:
    """Tell what counts and peaks say of the lag."""
    counts, largest, below = {}, 0.0, 0.0
    for lag in (1, 0):
        far = [_events(study, lag, resource)[1] for resource in CAPACITY_EVENTS]
        largest = max(largest, *far)
        counts[lag] = _join([f"{distance:.1f}" for distance in far])
        highest = _case(study, lag).groupby("resource", sort=False)[["overshoot_peak", "peak_bound"]].max()
        below = max(below, float((highest["peak_bound"] - highest["overshoot_peak"]).max()))
    return (
        f"The paper's capacity events lie {counts[1]} standard deviations from the mean with lag 1 and "
        f"{counts[0]} with lag 0{', so they cannot tell which was run' if largest <= 2.0 else ''}. Peaks "
        "could: they exceed the capacity by what all agents add in two steps with lag 1, in one with lag 0, "
        f"to within {ceil(1e3 * below - 1e-9) / 1e3:g} of the capacity."
    )


def _event_driven(study: PaperStudy) -> str:
    """Say whether the event-driven simulation is the same system."""
    steps = study.event_driven_steps
    if not study.same_digests:
        return f"The event-driven run differs from the algorithm over the first {steps} steps: a fault."
    return (
        f"Over the first {steps} steps the event-driven run has the digest of the algorithm: latency 0.5 "
        "that of lag 1, latency 0 that of lag 0."
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


def _finding(study: PaperStudy) -> Finding:
    header, rows = grid(study)
    drawn = cache(partial(figures, study))  # all at once, when the first is written

    def draw(name: str) -> Figure:
        return drawn()[name]

    return Finding(
        "paper",
        {"steps": study.steps, "draws": study.draws, "seed": study.seed},
        table(study),
        pd.DataFrame(rows, columns=header),
        sentences(study),
        {name: partial(draw, name) for name in _FIGURES},
        {"table.md": markdown(study)},
        title=caption(study),
        record={"digests": [result.digest for result in study.results]},
    )


def _study(quick: bool, seed: int, runs: Path | None) -> Finding:
    return _finding(run(*(QUICK if quick else FULL), seed, runs))


main = command("paper", _study, __doc__)

if __name__ == "__main__":
    main()
