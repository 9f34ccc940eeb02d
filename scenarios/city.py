"""Does what sixty cameras do hold for a city of a hundred thousand?

It does, with less scatter. If capacities grow with the number of cameras, signals per unit of time and
utilisation stay the same in the mean over draws of the costs. Random error averages out in the total, which
becomes regular from signal to signal. It does not in the allocations: their distance from the optimum
depends on how long the cameras have run, not on their number.
"""  # noqa: D400 - a question

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Recording, Result, metrics
from aimd_des.latency import Exponential
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from models import smart_cameras
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, quietly, run_draws, sensed
from scenarios.common.tables import over_draws, pick, summarise_draws

_CHANNEL = {"latency": 0.5, "loss": 0.1}
_HOLD_OFF = 1.0
# The last stretch of a run, which is drawn, and how often it is looked at.
_STRETCH, _LOOK = 20.0, 0.05
_EARLY = "misallocation, first quarter"
_LABELS = ["cameras", "resource"]
_NAMES = smart_cameras().resource_names


class _Size(NamedTuple):
    cameras: int
    until: float


class _City(NamedTuple):
    """What a run of one size comes to, and the last stretch of it."""

    values: dict[str, FloatArray]  # (m,), by measure
    # (q,) and (q, m): times, and totals over the capacities.
    time: FloatArray
    load: FloatArray


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run the paper's system with more and more cameras, behind a slow and lossy channel."""
    until = 150.0 if quick else 1000.0
    draws = {60: 2, 2000: 2} if quick else {60: 20, 600: 20, 6000: 10, 100_000: 10}
    rows: list[dict[str, Any]] = []
    cities: dict[int, _City] = {}
    for cameras, count in draws.items():
        ((_, found),) = run_draws(_city, [_Size(cameras, until)], count, 1, seed, quick, runs)
        cities[cameras] = found[0][0]
        rows += [
            {"cameras": cameras, "resource": name, "draw": draw}
            | {measure: float(values[j]) for measure, values in city.values.items()}
            for draw, (city,) in enumerate(found, start=seed)
            for j, name in enumerate(_NAMES)
        ]
    table = summarise_draws(rows, _LABELS)
    settings = {"seed": seed, "until": until, **_CHANNEL, "hold_off": _HOLD_OFF}
    drawn = {"city": partial(_figure, cities, table)}
    return Finding("city", settings, table, _shown(table), _findings(table, until), drawn)


def _city(size: _Size, draw: int, seed: int) -> _City:
    problem, until = smart_cameras(seed=draw, n_cameras=size.cameras), size.until
    looks = [until - _STRETCH + _LOOK * look for look in range(int(_STRETCH / _LOOK))]
    simulation = sensed(
        problem,
        _HOLD_OFF,
        channel=BroadcastChannel(Exponential(_CHANNEL["latency"]), _CHANNEL["loss"]),
        seed=seed,
        recording=Recording(demand=looks, allocations=[0.25 * until], overshoot=False),
    )
    result = quietly(simulation, until)
    load = result.observations.total_demand / problem.capacity
    return _City(_measured(result), result.observations.demand_times, load)


def _measured(result: Result) -> dict[str, FloatArray]:
    """Measure signals per unit of time since the first, averages at the end, and how peaks scatter."""
    problem, average, sent = result.problem, result.average_at_end, result.signals_sent
    first = np.array([sent.time[sent.resource == j].min() for j in range(problem.n_resources)])
    return {
        "signals": sent.counts(problem.n_resources) / (result.until - first),
        "utilisation": metrics.utilisation(average, problem.capacity),
        "misallocation": distance(problem, average),
        "consensus spread": metrics.consensus_spread(problem.costs, average),
        "scatter": _scatter(result),
        _EARLY: distance(problem, result.observations.average[0].T),
    }


def _scatter(result: Result) -> FloatArray:
    """Measure how the times between two signals scatter about their mean, in the second half of the run."""
    sent, m = result.signals_sent, result.problem.n_resources
    late = sent.time > 0.5 * result.until
    gaps = [np.diff(sent.time[late & (sent.resource == j)]) for j in range(m)]
    return np.array([gap.std() / gap.mean() for gap in gaps])


def _figure(cities: dict[int, _City], table: pd.DataFrame) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (13.0, 4.6))
    names = list(_NAMES)
    for axes, cameras, letter in ((left, min(cities), "a"), (middle, max(cities), "b")):
        city = cities[cameras]
        for j, name in enumerate(names):
            axes.plot(city.time, 100 * city.load[:, j], color=colour(j), linewidth=1.2, label=name)
        figures.level(axes, 100.0)
        x, y, title = "time (units of the hold-off)", "total demand (% of capacity)", f"{cameras:,} cameras"
        figures.dress(axes, f"({letter}) {title}", x, y, numbers="y", ylim=(85.0, 102.0))
    _draw_sizes(right, table, names)
    shared_legend(figure)
    return figure


def _draw_sizes(axes: Axes, table: pd.DataFrame, names: list[str]) -> None:
    for measure, style, full in (("misallocation", "o-", True), ("scatter", "s--", False)):
        for j, name in enumerate(names):
            rows, face = pick(table, measure=measure, resource=name), colour(j) if full else "white"
            x, y = rows["cameras"], 100 * rows["mean"]
            axes.plot(x, y, style, color=colour(j), markerfacecolor=face, linewidth=1.2)
    figures.named(axes, "distance from the optimum", "o-")
    figures.named(axes, "scatter of the times between signals", "s--", markerfacecolor="white")
    title, up = "(c) Random error over the number of cameras", "distance, and scatter over the mean (%)"
    figures.dress(axes, title, "number of cameras", up, numbers="", xscale="log", yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    pairs = zip(table["mean"], table["spread"], strict=True)
    text = [f"{mean:.4f} (± {spread:.4f})" for mean, spread in pairs]
    wide = table.assign(value=text).pivot_table(
        index=_LABELS, columns="measure", values="value", sort=False, aggfunc="first", observed=True
    )
    wide = wide.reset_index().rename(
        columns={"signals": "signals per unit of time", "scatter": "scatter of gaps"}
    )
    return wide.assign(cameras=[f"{number:,.0f}" for number in wide["cameras"]])


def _findings(table: pd.DataFrame, until: float) -> list[str]:
    few, many = int(table["cameras"].min()), int(table["cameras"].max())

    def each(cameras: int, measure: str, scale: float = 1.0, digits: int = 2) -> str:
        rows = pick(table, cameras=cameras, measure=measure)
        return ", ".join(over_draws(rows, scale, digits, resource=name) for name in _NAMES)

    luck = (
        f"{each(cameras, _EARLY, 100.0, 1)} after {0.25 * until:g} and"
        f" {each(cameras, 'misallocation', 100.0, 1)} after {until:g} with {cameras:,}"
        for cameras in (few, many)
    )
    return sentences(f"""
        - Signals per unit of time are {each(few, "signals", 1.0, 3)} with {few} cameras and
          {each(many, "signals", 1.0, 3)} with {many:,}; of the capacities
          {each(few, "utilisation", 100.0, 1)} and {each(many, "utilisation", 100.0, 1)} % are used.
        - Once settled, the times between two signals scatter by {each(few, "scatter", 100.0, 1)} % of their
          mean with {few} cameras, by {each(many, "scatter", 100.0, 1)} % with {many:,}.
        - Averages are, in % from the optimum for what is used, {"; ".join(luck)}: a camera's random error
          wears off with time, not with the number of cameras.
    """)


main = command("city", study, __doc__)

if __name__ == "__main__":
    main()
