"""Does what sixty cameras do hold for a city of a hundred thousand?

It does, and it gets smoother. With capacities that grow with the number of cameras, signals per unit of
time and utilisation stay what they are: the one bit is sent as often for a hundred thousand cameras as
for sixty. Chance evens out in the total, whose ups and downs become the same from one signal to the
next; it does not in the allocations, since every camera has its own luck: their distance from the
optimum depends on how long the cameras have been running, not on how many there are.
"""  # noqa: D400 - a question

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Recording, Result, metrics, solve_optimum
from aimd_des.latency import Exponential
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from aimd_des.study import replicate
from models import smart_cameras
from scenarios.common import figures
from scenarios.common.command import Finding, command
from scenarios.common.measure import quietly, sensed
from scenarios.common.tables import pick

_CHANNEL = {"latency": 0.5, "loss": 0.1}
_HOLD_OFF = 1.0
# The last stretch of a run, which is drawn, and how often it is looked at.
_STRETCH, _LOOK = 20.0, 0.05
_MEASURES = ("signals", "utilisation", "misallocation", "consensus spread", "scatter")


class _City(NamedTuple):
    """What a run of one size comes to: tidy rows, and the last stretch as (time, total over capacity)."""

    rows: list[dict[str, Any]]
    time: FloatArray
    load: FloatArray


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run the paper's system with more and more cameras, behind a slow and lossy channel."""
    sizes, until = ((60, 2000), 150.0) if quick else ((60, 600, 6000, 100_000), 1000.0)
    jobs = [partial(_city, cameras, until) for cameras in sizes]
    outcomes = replicate(jobs, 1, seed, workers=1, out=runs)
    cities = {cameras: city for cameras, (city,) in zip(sizes, outcomes, strict=True)}
    table = pd.DataFrame([row for city in cities.values() for row in city.rows])
    settings = {"seed": seed, "until": until, **_CHANNEL, "hold_off": _HOLD_OFF}
    drawn = {"city": partial(_figure, cities, table)}
    return Finding("city", settings, table, _shown(table), _findings(table), drawn)


def _city(cameras: int, until: float, seed: int) -> _City:
    problem = smart_cameras(seed=seed, n_cameras=cameras)
    looks = [until - _STRETCH + _LOOK * look for look in range(int(_STRETCH / _LOOK))]
    simulation = sensed(
        problem,
        _HOLD_OFF,
        channel=BroadcastChannel(Exponential(_CHANNEL["latency"]), _CHANNEL["loss"]),
        seed=seed,
        recording=Recording(demand=looks, overshoot=False),
    )
    result = quietly(simulation, until)
    load = result.observations.total_demand / problem.capacity
    rows = [
        {"cameras": cameras, "resource": name, "measure": measure, "value": float(value)}
        for measure, values in zip(_MEASURES, _measured(result, until), strict=True)
        for name, value in zip(problem.resource_names, values, strict=True)
    ]
    return _City(rows, result.observations.demand_times, load)


def _measured(result: Result, until: float) -> list[Any]:
    """Measure signals per unit of time since the first, averages at the end, and how peaks scatter."""
    problem, average, sent = result.problem, result.average_at_end, result.signals_sent
    first = np.array([sent.time[sent.resource == j].min() for j in range(problem.n_resources)])
    best = solve_optimum(problem, capacity=average.sum(axis=0))
    return [
        sent.counts(problem.n_resources) / (until - first),
        metrics.utilisation(average, problem.capacity),
        metrics.relative_error(average, best.allocation),
        metrics.consensus_spread(problem.costs, average),
        _scatter(result),
    ]


def _scatter(result: Result) -> FloatArray:
    """Measure how the times between two signals scatter about their mean, in the second half of the run."""
    sent, m = result.signals_sent, result.problem.n_resources
    late = sent.time > 0.5 * result.until
    gaps = [np.diff(sent.time[late & (sent.resource == j)]) for j in range(m)]
    return np.array([gap.std() / gap.mean() for gap in gaps])


def _figure(cities: dict[int, _City], table: pd.DataFrame) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (13.0, 4.6))
    names = list(dict.fromkeys(table["resource"]))
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
            x, y = rows["cameras"], 100 * rows["value"]
            axes.plot(x, y, style, color=colour(j), markerfacecolor=face, linewidth=1.2)
    figures.named(axes, "distance from the optimum", "o-")
    figures.named(axes, "scatter of the times between signals", "s--", markerfacecolor="white")
    across, up = "number of cameras", "distance, and scatter over the mean (%)"
    figures.dress(axes, "(c) What chance leaves", across, up, numbers="", xscale="log", yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")


def _values(table: pd.DataFrame, cameras: int, measure: str) -> pd.Series:
    return pick(table, cameras=cameras, measure=measure).set_index("resource")["value"]


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    wide = table.pivot_table(index=["cameras", "resource"], columns="measure", values="value", sort=False)
    wide = wide.reset_index().rename(
        columns={"signals": "signals per unit of time", "scatter": "scatter of gaps"}
    )
    text = {name: [f"{value:.4f}" for value in wide[name]] for name in wide.columns[2:]}
    return wide.assign(cameras=[f"{number:,.0f}" for number in wide["cameras"]], **text)


def _findings(table: pd.DataFrame) -> list[str]:
    few, many = int(table["cameras"].min()), int(table["cameras"].max())
    before, after = ({name: _values(table, size, name) for name in _MEASURES} for size in (few, many))
    signals = 100 * (after["signals"] / before["signals"] - 1.0).abs().max()
    used = 100 * (after["utilisation"] - before["utilisation"]).abs().max()
    gaps, luck = (
        [100 * side[name].max() for side in (before, after)] for name in ("scatter", "misallocation")
    )
    same = f"signals per unit of time change by up to {signals:.1f} %, utilisation by up to {used:.1f} points"
    apart = f"by up to {gaps[0]:.0f} % of their mean with {few} cameras, {gaps[1]:.1f} % with {many:,}"
    far = f"up to {luck[0]:.1f} % from the optimum for what is used with {few} cameras, {luck[1]:.1f} % with"
    return [
        f"From {few} to {many:,} cameras {same}.",
        f"Once settled, the times between two signals scatter {apart}.",
        f"The averages are {far} {many:,}: a camera's own luck wears off with time, not with company.",
    ]


main = command("city", study, "Does what sixty cameras do hold for a city of a hundred thousand?")

if __name__ == "__main__":
    main()
