"""The charts of a run: demand and signals in a window that moves, and what each agent holds at the end."""

from typing import Any

import altair as alt
import numpy as np
import pandas as pd

from aimd_des.report.charts import (
    REFERENCE,
    Column,
    Rows,
    chosen,
    finished,
    level_rule,
    picked,
    resource_colour,
    resource_dash,
    resource_shape,
    slid,
    unchecked,
)
from aimd_des.report.html_page import Chart, Choice, Slider
from aimd_des.results.looks import looks
from aimd_des.utils.formatting import grouped

# What a page can hold, and an eye can see.
_MOST_ROWS = 12_000
_MOST_SIGNALS = 6_000
_MOST_AGENTS = 2_000
_POSITIONS = 100
_PARTS = (1, 2, 5, 10, 20, 50, 100)
# The window at first: a twentieth of the run, from the middle on.
_START, _PART = 50, 20
# A line between looks shows the sawtooth where it has so many looks a period; else there are
# envelopes, of so many looks each.
_LOOKS_A_TOOTH, _LOOKS_A_PIECE = 6, 8
_ROUNDED = 1.0 + 1e-9


def window_controls(until: float, part: int = _PART) -> list[Slider | Choice]:
    """Make the controls of the window of time that is shown."""
    starts = [grouped(until * k / _POSITIONS) for k in range(_POSITIONS + 1)]
    lengths = [
        (repr(until / some), "the whole run" if some == 1 else grouped(until / some)) for some in _PARTS
    ]
    return [
        Slider("window", "From time", starts, _START if part > 1 else 0),
        Choice("span", "For", lengths, repr(until / part)),
    ]


def _window(until: float, part: int) -> tuple[list[alt.Parameter], alt.X, str]:
    """Give the parameters of the window, the axis of time that shows it, and what lies in it."""
    parameters = [slid("window", str(_START if part > 1 else 0)), chosen("span", repr(until / part))]
    # A window that would reach beyond the end of the run ends there.
    first = f"min(toNumber(window) * {until / _POSITIONS!r}, {until!r} - toNumber(span))"
    scale = alt.Scale(
        domainMin=alt.ExprRef(first),
        domainMax=alt.ExprRef(f"{first} + toNumber(span)"),
        nice=False,
        zero=False,
    )
    inside = f"datum.time >= {first} && datum.time <= {first} + toNumber(span)"
    return parameters, alt.X("time:Q", title="time", scale=scale), inside


def over_capacity(demand: pd.DataFrame, capacity: pd.DataFrame) -> pd.DataFrame:
    """Measure totals and averages in capacities, at all samples."""
    own = pd.merge_asof(demand, capacity, on="time", by="resource")["capacity"].to_numpy()
    shares = {name: demand[name].to_numpy() / own for name in ("total", "average")}
    return pd.DataFrame({"time": demand["time"], "resource": demand["resource"].astype(str), **shares})


def few(demand: pd.DataFrame, resources: int, most: int = _MOST_ROWS, *, log: bool = False) -> pd.DataFrame:
    """Take as many samples as can be seen."""
    kept = looks(demand["time"].to_numpy()[::resources], max(most // resources, 50), log=log)
    return demand.iloc[(kept[:, None] * resources + np.arange(resources)).ravel()]


def teeth_are_seen(demand: pd.DataFrame, signals: pd.DataFrame, names: list[str], until: float) -> bool:
    """Tell whether samples are dense enough for a line between them to be the sawtooth of every resource."""
    times = demand["time"].to_numpy()[:: len(names)]
    widest = float(np.diff(times).max(initial=0.0))
    most = signals["resource"].astype(str).value_counts().max() if len(signals) else 0
    return bool(len(times) * len(names) <= _MOST_ROWS and widest * most * _LOOKS_A_TOOTH <= until * _ROUNDED)


@unchecked
def demand_charts(demand: pd.DataFrame, signals: pd.DataFrame, names: list[str], until: float) -> list[Chart]:
    """Show total demand over the capacity, and when signals were sent."""
    part = window_part(demand, signals, names, until)
    if teeth_are_seen(demand, signals, names, until):
        chart = _saw(demand, names, until, part)
    else:
        chart = _envelope(demand, names, until)
    return [chart, *([_signals_chart(signals, names, until, part)] if len(signals) else [])]


def window_part(demand: pd.DataFrame, signals: pd.DataFrame, names: list[str], until: float) -> int:
    """Say which part of the run is shown at first: all of it where no sawtooth is seen."""
    return _PART if len(signals) and teeth_are_seen(demand, signals, names, until) else 1


_DEMAND_TITLE = "total demand (% of the capacity)"


def _saw(demand: pd.DataFrame, names: list[str], until: float, part: int) -> Chart:
    """Show the sawtooth."""
    parameters, time, inside = _window(until, part)
    rows = Rows(demand[["time", "resource"]].assign(level=100.0 * demand["total"]))
    pick = picked()
    line = (
        alt.Chart(rows.saved)
        .transform_filter(inside)
        .mark_line(clip=True, strokeWidth=1.5)
        .encode(
            time,
            alt.Y("level:Q", title=_DEMAND_TITLE, scale=alt.Scale(zero=False)),
            resource_colour(names),
            resource_dash(names),
            opacity=pick.opacity,
        )
        .add_params(pick.parameter, *parameters)
    )
    layers = alt.layer(line, level_rule(rows, 100.0))
    text = (
        "Total demand of all agents over the capacity in force, which is the dashed line. "
        f"{len(demand) // len(names):,} samples are drawn, dense enough to show each period of the sawtooth."
    )
    columns = [Column("time", "time"), Column("resource", "resource"), Column("level", _DEMAND_TITLE)]
    return Chart("demand", "Demand against capacity", text, finished(layers, rows, columns))


def _envelope(demand: pd.DataFrame, names: list[str], until: float) -> Chart:
    """Show between which bounds demand swings, where samples are too far apart for its sawtooth."""
    parameters, time, inside = _window(until, 1)
    m = len(names)
    pieces = max(len(demand) // m // _LOOKS_A_PIECE, 1)
    pieces = min(pieces, _MOST_ROWS // m // 2)
    edges = np.linspace(0.0, until, pieces + 1)
    place = np.clip(np.searchsorted(edges, demand["time"], side="right") - 1, 0, pieces - 1)
    level = (100.0 * demand["total"]).groupby([place, demand["resource"].to_numpy()], sort=False)
    bounds = level.agg(["min", "max", "mean"]).reset_index(names=["piece", "resource"])
    middle = 0.5 * (edges[bounds["piece"]] + edges[bounds["piece"] + 1])
    rows = Rows(bounds.assign(time=middle).drop(columns="piece"))
    pick, faint = picked(), picked(0.3)
    base = alt.Chart(rows.saved).transform_filter(inside)
    scale = alt.Scale(zero=False)
    area = base.mark_area(clip=True, interpolate="step").encode(
        time,
        alt.Y("min:Q", title=_DEMAND_TITLE, scale=scale),
        alt.Y2("max:Q"),
        resource_colour(names),
        opacity=faint.opacity,
    )
    line = base.mark_line(clip=True, interpolate="step").encode(
        time, alt.Y("mean:Q"), resource_colour(names), resource_dash(names), opacity=pick.opacity
    )
    layers = alt.layer(area, line.add_params(pick.parameter, *parameters), level_rule(rows, 100.0))
    text = (
        "The least, the mean and the largest total demand over the capacity in force, which is the dashed"
        f" line: {pieces:,} pieces of the run, each of {len(demand) // m // pieces:,} samples or so. Samples"
        " are too far apart to show the sawtooth, and demand goes further than they do; recording.demand"
        " makes them denser."
    )
    columns = [
        Column("time", "time"),
        Column("resource", "resource"),
        *(Column(of, f"{of} of {_DEMAND_TITLE}") for of in ("min", "mean", "max")),
    ]
    return Chart("demand", "Demand against capacity", text, finished(layers, rows, columns))


def _signals_chart(signals: pd.DataFrame, names: list[str], until: float, part: int) -> Chart:
    """Show signals one by one where there are few, else how many there are in a hundredth of the run."""
    parameters, time, inside = _window(until, part)
    if len(signals) <= _MOST_SIGNALS and part > 1:
        y_axis = alt.Y("resource:N", title=None, sort=names, scale=alt.Scale(domain=names))
        rows = Rows(pd.DataFrame({"time": signals["time"], "resource": signals["resource"].astype(str)}))
        marks = (
            alt.Chart(rows.saved).transform_filter(inside).mark_tick(clip=True, thickness=1.2, opacity=0.7)
        )
        chart = marks.encode(time, y_axis, resource_colour(names, legend=False)).add_params(*parameters)
        text = f"Each stroke is one of the {len(signals):,} signals: one bit, sent to all agents."
        columns = [Column("time", "time"), Column("resource", "resource")]
        return Chart("signals", "Signals", text, finished(chart, rows, columns, 40 * len(names)))
    step = until / 100.0
    place = np.minimum((signals["time"] / step).astype(int), 99)
    counts = signals.groupby([place, signals["resource"].astype(str)]).size().rename("signals").reset_index()
    counts["end"] = step * (counts["time"] + 1)
    counts["rate"] = counts["signals"] / step
    counts["time"] = step * counts["time"]
    rows = Rows(counts)
    line = (
        alt.Chart(rows.saved)
        .transform_filter(inside)
        .mark_line(clip=True, interpolate="step-after")
        .encode(
            time,
            alt.Y("rate:Q", title="signals per unit of time"),
            resource_colour(names, legend=False),
            resource_dash(names, legend=False),
        )
        .add_params(*parameters)
    )
    text = f"{len(signals):,} signals, counted in hundredths of the run. Each is one bit, sent to all agents."
    columns = [
        Column("time", "from time"),
        Column("end", "to time"),
        Column("resource", "resource"),
        Column("signals", "signals"),
        Column("rate", "signals per unit of time"),
    ]
    return Chart("signals", "Signals", text, finished(line, rows, columns, 160))


@unchecked
def share_chart(
    average: np.ndarray[Any, Any],
    best: np.ndarray[Any, Any],
    for_used: np.ndarray[Any, Any] | None,
    agents: list[str],
    names: list[str],
) -> Chart:
    """Hold the average of every agent against what it should hold of what is used, or of all."""
    n, against, equal = len(average), best if for_used is None else for_used, best.mean(axis=0)
    kept = np.unique(np.linspace(0, n - 1, min(n, _MOST_AGENTS)).astype(int))
    frame = pd.concat(
        pd.DataFrame(
            {
                "agent": [agents[i] for i in kept],
                "resource": name,
                "best": against[kept, j] / equal[j],
                "held": average[kept, j] / equal[j],
                "whole": best[kept, j] / equal[j],
            }
        )
        for j, name in enumerate(names)
    )
    top = float(max(frame["best"].max(), frame["held"].max()))
    rows = Rows(frame)
    diagonal = rows.add("diagonal", pd.DataFrame({"best": [0.0, top], "held": [0.0, top]}))
    line = alt.Chart(diagonal).mark_line(color=REFERENCE, strokeDash=[5, 4], strokeWidth=1.5)
    what = "optimum for all of the capacity" if for_used is None else "optimum for what is used"
    columns = [
        Column("agent", "agent"),
        Column("resource", "resource"),
        Column("best", f"{what} (equal shares)"),
        Column("held", "average (equal shares)"),
        Column("whole", "optimum for all of the capacity (equal shares)"),
    ]
    pick = picked(0.8)
    points = (
        alt.Chart(rows.saved)
        .mark_point(size=40, filled=True)
        .encode(
            alt.X("best:Q", title=f"{what} (in equal shares of the capacity)"),
            alt.Y("held:Q", title="average (in equal shares of the capacity)"),
            resource_colour(names),
            resource_shape(names),
            opacity=pick.opacity,
            tooltip=[
                alt.Tooltip("agent:N", title="agent"),
                alt.Tooltip("resource:N", title="resource"),
                *(alt.Tooltip(f"{one.key}:Q", title=one.name, format=".3f") for one in columns[2:]),
            ],
        )
        .add_params(pick.parameter)
    )
    some = "Every agent" if len(kept) == n else f"{len(kept):,} of the {n:,} agents"
    text = (
        f"{some}, for each resource. On the dashed line an agent holds what a central planner would give it"
    )
    text += (
        "." if for_used is None else " of what is used; what is not used is the planner's to give besides."
    )
    chart = alt.layer(points, line.encode(alt.X("best:Q"), alt.Y("held:Q")))
    return Chart("shares", "What each agent holds", text, finished(chart, rows, columns, 320), wide=False)
