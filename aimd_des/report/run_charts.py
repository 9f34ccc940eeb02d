"""The charts of a run: demand and signals in a window that moves, and how the averages settle."""

from collections.abc import Sequence
from typing import Any

import altair as alt
import numpy as np
import pandas as pd

from aimd_des.report.charts import REFERENCE, chosen, data, finished, resource_colour, slid
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


def window_controls(until: float) -> list[Slider | Choice]:
    """Make the controls of the window of time that is shown."""
    starts = [grouped(until * k / _POSITIONS) for k in range(_POSITIONS + 1)]
    lengths = [
        (repr(until / part), "the whole run" if part == 1 else grouped(until / part)) for part in _PARTS
    ]
    return [
        Slider("window", "From time", starts, _START),
        Choice("span", "For", lengths, repr(until / _PART)),
    ]


def _window(until: float) -> tuple[list[alt.Parameter], alt.X, str]:
    """Give the parameters of the window, the axis of time that shows it, and what lies in it."""
    parameters = [slid("window", str(_START)), chosen("span", repr(until / _PART))]
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
    """Measure totals and averages in capacities, at as many looks as can be seen."""
    resources = capacity["resource"].nunique()
    kept = looks(demand["time"].to_numpy()[::resources], max(_MOST_ROWS // resources, 50))
    rows = demand.iloc[(kept[:, None] * resources + np.arange(resources)).ravel()]
    own = pd.merge_asof(rows, capacity, on="time", by="resource")["capacity"].to_numpy()
    shares = {name: rows[name].to_numpy() / own for name in ("total", "average")}
    return pd.DataFrame({"time": rows["time"], "resource": rows["resource"].astype(str), **shares})


def demand_charts(demand: pd.DataFrame, signals: pd.DataFrame, names: list[str], until: float) -> list[Chart]:
    """Show total demand over the capacity, and when signals were sent."""
    parameters, time, inside = _window(until)
    line = (
        alt.Chart(data(demand[["time", "resource"]].assign(level=demand["total"])))
        .transform_filter(inside)
        .mark_line(clip=True, strokeWidth=1.5)
        .encode(
            time,
            alt.Y(
                "level:Q",
                title="total demand over the capacity",
                axis=alt.Axis(format="%"),
                scale=alt.Scale(zero=False),
            ),
            resource_colour(names),
        )
    )
    rule = alt.Chart(data(pd.DataFrame({"one": [1.0]}))).mark_rule(color=REFERENCE, strokeDash=[5, 4])
    layers = alt.layer(line, rule.encode(alt.Y("one:Q"))).add_params(*parameters)
    text = (
        "Total demand of all agents over the capacity in force, which is the dashed line. "
        f"{len(demand) // len(names):,} looks are drawn."
    )
    charts = [Chart("demand", "Demand against capacity", text, finished(layers))]
    if len(signals):
        charts.append(_signals_chart(signals, names, until))
    return charts


def _signals_chart(signals: pd.DataFrame, names: list[str], until: float) -> Chart:
    """Show signals one by one where there are few, else how many there are in a hundredth of the run."""
    parameters, time, inside = _window(until)
    y_axis = alt.Y("resource:N", title=None, sort=names, scale=alt.Scale(domain=names))
    if len(signals) <= _MOST_SIGNALS:
        frame = pd.DataFrame({"time": signals["time"], "resource": signals["resource"].astype(str)})
        marks = (
            alt.Chart(data(frame)).transform_filter(inside).mark_tick(clip=True, thickness=1.2, opacity=0.7)
        )
        chart = marks.encode(time, y_axis, resource_colour(names, legend=False)).add_params(*parameters)
        text = f"Each stroke is one of the {len(signals):,} signals: one bit, sent to all agents."
        return Chart("signals", "Signals", text, finished(chart, 40 * len(names)))
    step = until / 100.0
    place = np.minimum((signals["time"] / step).astype(int), 99)
    counts = signals.groupby([place, signals["resource"].astype(str)]).size().rename("signals").reset_index()
    counts["end"] = step * (counts["time"] + 1)
    counts["rate"] = counts["signals"] / step
    counts["time"] = step * counts["time"]
    line = (
        alt.Chart(data(counts))
        .transform_filter(inside)
        .mark_line(clip=True, interpolate="step-after")
        .encode(time, alt.Y("rate:Q", title="signals per unit of time"), resource_colour(names, legend=False))
        .add_params(*parameters)
    )
    text = f"{len(signals):,} signals, counted in hundredths of the run. Each is one bit, sent to all agents."
    return Chart("signals", "Signals", text, finished(line, 160))


def settling_chart(demand: pd.DataFrame, names: list[str], until: float) -> Chart:
    """Show how the sum of the averages settles."""
    chart = (
        alt.Chart(data(demand[["time", "resource"]].assign(level=demand["average"])))
        .mark_line(clip=True)
        .encode(
            alt.X("time:Q", title="time", scale=alt.Scale(domain=[0.0, until], nice=False)),
            alt.Y("level:Q", title="sum of averages over the capacity", axis=alt.Axis(format="%")),
            resource_colour(names),
        )
    )
    text = "The sum of the long-term averages of all agents, over the capacity in force."
    return Chart("averages", "The averages settle", text, finished(chart, 200), wide=False)


def convergence_chart(frame: pd.DataFrame, names: list[str], words: Sequence[str]) -> Chart:
    """Show how fast the misallocation falls, in the band in which theory expects it."""
    columns = frame.assign(resource=frame["resource"].astype(str))
    # A logarithm has no place for a run that is right to the last digit.
    positive = columns[columns["misallocation"] > 0.0]
    base = alt.Chart(data(columns[columns["low"] > 0.0]))
    axis = alt.Axis(format="~%", tickCount=4)
    level = alt.Y("misallocation:Q", title="misallocation", scale=alt.Scale(type="log"), axis=axis)
    time = alt.X("time:Q", title="time", scale=alt.Scale(type="log", nice=False), axis=alt.Axis(tickCount=4))
    colours = resource_colour(names)
    line = (
        alt.Chart(data(positive)).mark_line(point={"size": 30, "filled": True}).encode(time, level, colours)
    )
    layers = [line]
    if len(columns["low"].dropna()):
        band = base.mark_area(opacity=0.2).encode(time, alt.Y("low:Q"), alt.Y2("high:Q"), colours)
        mean = base.mark_line(strokeDash=[5, 4], strokeWidth=1.5).encode(time, alt.Y("expected:Q"), colours)
        layers = [band, mean, line]
    text = "How far the averages are from the optimum for what is used; both axes are logarithmic."
    if words:
        text += " Dashed: what theory expects in the mean; 95 % of runs lie in the band. " + " ".join(words)
    return Chart("convergence", "How fast, how near", text, finished(alt.layer(*layers), 320), wide=False)


def share_chart(average: np.ndarray[Any, Any], best: np.ndarray[Any, Any], names: list[str]) -> Chart:
    """Hold the average of every agent against its optimum."""
    n = len(average)
    kept = np.unique(np.linspace(0, n - 1, min(n, _MOST_AGENTS)).astype(int))
    equal = best.mean(axis=0)
    frame = pd.concat(
        pd.DataFrame(
            {"best": best[kept, j] / equal[j], "held": average[kept, j] / equal[j], "resource": name}
        )
        for j, name in enumerate(names)
    )
    ends = pd.DataFrame({"best": [0.0, frame["best"].max()], "held": [0.0, frame["best"].max()]})
    line = alt.Chart(data(ends)).mark_line(color=REFERENCE, strokeDash=[5, 4], strokeWidth=1.5)
    line = line.encode(alt.X("best:Q"), alt.Y("held:Q"))
    points = (
        alt.Chart(data(frame))
        .mark_circle(opacity=0.75, size=36)
        .encode(
            alt.X("best:Q", title="optimal allocation over the mean of all agents"),
            alt.Y("held:Q", title="average over the mean"),
            resource_colour(names),
            tooltip=[
                alt.Tooltip("resource:N", title="resource"),
                alt.Tooltip("best:Q", title="optimum", format=".3f"),
                alt.Tooltip("held:Q", title="average", format=".3f"),
            ],
        )
    )
    some = "Every agent" if len(kept) == n else f"{len(kept):,} of the {n:,} agents"
    text = (
        f"{some}, for each resource. On the dashed line an agent holds what a central planner would give it."
    )
    return Chart("shares", "Who holds what", text, finished(alt.layer(line, points), 320), wide=False)
