"""The paper's numbers beside ours: the table of `scenarios.paper`."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import pandas as pd

from aimd_des import Optimum, Result
from models.smart_cameras import INCREASES

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
