"""What changes when agents grow and answer in continuous time instead of on one clock?

Continuous agents take 1.4 to 1.7 times the signals: rho per unit of time against rho / (1 + rho)
per step of the clock, on which agents that answer do not grow. The clock uses 2 to 3 points more of
the capacities, and pays with peaks of 5 to 12 % above them; ideal crossings never exceed them.
Shares are about as right in all ways.
"""  # noqa: D400 - a question

from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import theory
from aimd_des.control_unit import Crossing, Sampled
from aimd_des.plots import colour, shared_legend
from aimd_des.plots.style import REFERENCE, frame, number_axis
from aimd_des.problem import Problem
from models.smart_cameras import smart_cameras
from scenarios.common.command import Study, command
from scenarios.common.measure import Run, measure_all
from scenarios.common.replicate import numbers

__all__ = ["main", "study"]


class _Way(NamedTuple):
    name: str
    dynamics: Literal["discrete", "continuous"]
    unit: Sampled | Crossing
    latency: float = 0.0
    period: float = 0.0
    # Steps of growth that the highest total can have on top of the capacity.
    steps_above: float = 0.0


_WAYS = (
    _Way("clock, acts a step later", "discrete", Sampled(), 1.0, steps_above=2.0),
    _Way("clock, acts in the same step", "discrete", Sampled(), steps_above=1.0),
    _Way("continuous, sampled each period", "continuous", Sampled(), period=1.0, steps_above=1.0),
    _Way("continuous, crossing, hold-off 1", "continuous", Crossing(1.0)),
    _Way("continuous, crossing, hold-off 0", "continuous", Crossing(0.0)),
)

_PANELS = (
    ("signals", 1.0, "signals per unit of time", "(a) Signals: rho, rho / (1 + rho)"),
    ("utilisation", 100.0, "averages over capacity (%)", "(b) Utilisation"),
    ("peak", 100.0, "highest total over capacity (%)", "(c) Peak"),
    ("misallocation", 100.0, "distance from the optimum (%)", "(d) Misallocation of single runs"),
)


def study(quick: bool = False, seed: int = 0) -> Study:
    """Run the paper's system in five ways.

    Parameters
    ----------
    quick : bool
        Whether to run the small size.
    seed : int
        Of the first replication.

    Returns
    -------
    Study
        A pure function of the arguments.
    """
    replications, until = (2, 240.0) if quick else (20, 1500.0)
    problem = smart_cameras(0)
    cases: list[tuple[dict[str, Any], Run]] = [
        ({"way": way.name}, Run(problem, until, until // 3, way.dynamics, way.unit, way.latency))
        for way in _WAYS
    ]
    table, _ = measure_all(cases, replications, seed, workers=1 if quick else None)
    expected = {way.name: _expected(problem, way) for way in _WAYS}
    names = list(problem.resource_names)
    table["theory"] = [
        expected[row["way"]].get(row["measure"], np.full(3, np.nan))[names.index(row["resource"])]
        for row in table.to_dict("records")
    ]
    return Study(
        "continuous_vs_discrete",
        {"seed": seed, "replications": replications, "until": until},
        table,
        _shown(table),
        _findings(table),
        {"continuous_vs_discrete": _figure(table, problem)},
    )


def _expected(problem: Problem, way: _Way) -> dict[str, Any]:
    found = theory.predict(problem, way.dynamics, latency=way.latency, period=way.period)
    growth = problem.increase.sum(axis=0)
    return {
        "signals": found.signals,
        "utilisation": found.utilisation,
        "peak": 1.0 + way.steps_above * growth / problem.capacity,
    }


def _figure(table: pd.DataFrame, problem: Problem) -> Figure:
    figure = Figure(figsize=(13.5, 4.4), layout="constrained")
    for axes, (measure, factor, label, title) in zip(figure.subplots(1, 4), _PANELS, strict=True):
        _draw(axes, table[table["measure"] == measure], list(problem.resource_names), factor)
        axes.set_ylabel(label)
        axes.set_title(title, loc="left", fontsize="medium")
        if measure in ("signals", "misallocation"):
            axes.set_ylim(bottom=0.0)
        else:
            axes.axhline(100.0, color=REFERENCE, linewidth=1.0, linestyle=":")
    shared_legend(figure)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, resources: list[str], factor: float) -> None:
    for place, way in enumerate(_WAYS):
        mine = rows[rows["way"] == way.name]
        beside = np.arange(len(resources)) + 0.15 * (place - 2)
        axes.hlines(
            factor * mine["theory"], beside - 0.07, beside + 0.07, color="black", linewidth=1.4, zorder=3
        )
        axes.errorbar(
            beside,
            factor * mine["mean"],
            2.0 * factor * mine["standard_error"],
            fmt="osD^v"[place],
            color=colour(place),
            markersize=6.0,
            capsize=2.5,
            label=way.name,
        )
    axes.plot([], [], color="black", linewidth=1.4, label="theory")
    axes.set_xticks(range(len(resources)), resources)
    number_axis(axes.yaxis)
    frame(axes)
    axes.grid(visible=False, axis="x")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    rows = table[table["measure"] != "saturated"]
    return pd.DataFrame(
        [
            {
                "way": row["way"],
                "resource": row["resource"],
                "measure": row["measure"],
                "theory": "" if np.isnan(row["theory"]) else f"{row['theory']:.4f}",
                "simulation": f"{row['mean']:.4f} ± {row['standard_error']:.4f}",
            }
            for row in rows.to_dict("records")
        ]
    )


def _findings(table: pd.DataFrame) -> list[str]:
    later, clock, ideal = (_WAYS[place].name for place in (0, 1, 4))
    share, rho = (numbers(table, way=way, measure="signals") for way in (clock, ideal))
    gap = np.abs(share / (rho / (1.0 + rho)) - 1.0).max()
    used, less = (100.0 * numbers(table, way=way, measure="utilisation") for way in (clock, ideal))
    peaks, flat = (100.0 * numbers(table, way=way, measure="peak") for way in (later, ideal))
    wrong = 100.0 * numbers(table, measure="misallocation")
    ratio, points = rho / share, used - less
    return [
        (
            f"Continuous time takes {ratio.min():.2f} to {ratio.max():.2f} times the signals: with rho of "
            f"the continuous run, the clock's share of steps is rho / (1 + rho) to within {100 * gap:.1f} "
            "%."
        ),
        (
            f"The clock uses {points.min():.1f} to {points.max():.1f} points more of the capacities, and "
            f"goes up to {peaks.max() - 100.0:.0f} % beyond them where a signal acts a step later; with "
            f"ideal crossings total demand never exceeds them (highest {flat.max():.2f} %)."
        ),
        (
            f"Shares are about as right in all ways: misallocation of a single run is {wrong.min():.1f} "
            f"to {wrong.max():.1f} %, most of it luck."
        ),
    ]


main = command(
    "continuous_vs_discrete",
    study,
    "What changes when agents grow and answer in continuous time instead of on one clock?",
)

if __name__ == "__main__":
    main()
