"""What changes when agents grow and answer in continuous time instead of on one clock?

Continuous agents take 1.4 to 1.7 times the signals: rho per unit of time against rho / (1 + rho)
per step of the clock, on which agents that answer do not grow. The clock uses 2 to 3 points more of
the capacities, and pays with peaks of 5 to 12 % above them; ideal crossings never exceed them.
Shares are about as right in all ways.
"""  # noqa: D400 - a question

from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import Crossing, Problem, Sampled, theory
from aimd_des.plots import shared_legend
from models.smart_cameras import smart_cameras
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import Run, measure_all
from scenarios.common.tables import numbers, pick, shown


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


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run the paper's system in five ways."""
    replications, until = (2, 240.0) if quick else (20, 1500.0)
    problem = smart_cameras(0)
    cases: list[tuple[dict[str, Any], Run]] = [
        ({"way": way.name}, Run(problem, until, until // 3, way.dynamics, way.unit, way.latency))
        for way in _WAYS
    ]
    table, _ = measure_all(cases, replications, seed, quick, runs)
    expected = {way.name: _expected(problem, way) for way in _WAYS}
    names = list(problem.resource_names)
    table["theory"] = [
        expected[row["way"]].get(row["measure"], np.full(3, np.nan))[names.index(row["resource"])]
        for row in table.to_dict("records")
    ]
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = shown(table[table["measure"] != "saturated"], ["way", "resource", "measure"])
    drawn = {"continuous_vs_discrete": partial(_figure, table, problem)}
    return Finding("continuous_vs_discrete", settings, table, printed, _findings(table), drawn)


def _expected(problem: Problem, way: _Way) -> dict[str, Any]:
    found = theory.predict(problem, way.dynamics, latency=way.latency, period=way.period)
    growth = problem.increase.sum(axis=0)
    return {
        "signals": found.signals,
        "utilisation": found.utilisation,
        "peak": 1.0 + way.steps_above * growth / problem.capacity,
    }


def _figure(table: pd.DataFrame, problem: Problem) -> Figure:
    figure, panels = figures.panels(1, 4, (13.5, 4.4))
    for axes, (measure, factor, label, title) in zip(panels, _PANELS, strict=True):
        _draw(axes, pick(table, measure=measure), list(problem.resource_names), factor)
        from_zero: dict[str, Any] = {"ylim": (0.0, None)} if measure in ("signals", "misallocation") else {}
        figures.dress(axes, title, y=label, numbers="y", **from_zero)
        axes.grid(visible=False, axis="x")
        if not from_zero:
            figures.level(axes, 100.0)
    shared_legend(figure)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, resources: list[str], factor: float) -> None:
    for place, way in enumerate(_WAYS):
        mine = pick(rows, way=way.name)
        beside = np.arange(len(resources)) + 0.15 * (place - 2)
        expected = factor * mine["theory"]
        axes.hlines(expected, beside - 0.07, beside + 0.07, color="black", linewidth=1.4, zorder=3)
        figures.points(axes, beside, mine, place, way.name, scale=factor, fmt="osD^v"[place], markersize=6.0)
    figures.named(axes, "theory", color="black")
    axes.set_xticks(range(len(resources)), resources)


def _findings(table: pd.DataFrame) -> list[str]:
    later, clock, ideal = (_WAYS[place].name for place in (0, 1, 4))
    share, rho = (numbers(table, way=way, measure="signals") for way in (clock, ideal))
    gap = np.abs(share / (rho / (1.0 + rho)) - 1.0).max()
    used, less = (100.0 * numbers(table, way=way, measure="utilisation") for way in (clock, ideal))
    peaks, flat = (100.0 * numbers(table, way=way, measure="peak") for way in (later, ideal))
    wrong = 100.0 * numbers(table, measure="misallocation")
    ratio, points = rho / share, used - less
    return sentences(f"""
        - Continuous time takes {ratio.min():.2f} to {ratio.max():.2f} times the signals: with rho of the
          continuous run, the clock's share of steps is rho / (1 + rho) to within {100 * gap:.1f} %.
        - The clock uses {points.min():.1f} to {points.max():.1f} points more of the capacities, and goes up
          to {peaks.max() - 100.0:.0f} % beyond them where a signal acts a step later; with ideal crossings
          total demand never exceeds them (highest {flat.max():.2f} %).
        - Shares are about as right in all ways: misallocation of a single run is {wrong.min():.1f} to
          {wrong.max():.1f} %, most of it luck.
    """)


main = command(
    "continuous_vs_discrete",
    study,
    "What changes when agents grow and answer in continuous time instead of on one clock?",
)

if __name__ == "__main__":
    main()
