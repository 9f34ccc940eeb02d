"""Charts of how a run settles, along the logarithm of time: use, shares, error and cost."""

from collections.abc import Sequence

import altair as alt
import pandas as pd

from aimd_des.report.charts import (
    REFERENCE,
    Column,
    Rows,
    finished,
    level_rule,
    picked,
    resource_colour,
    resource_dash,
    unchecked,
)
from aimd_des.report.html_page import Chart


def _time() -> alt.X:
    return alt.X(
        "time:Q",
        title="time",
        scale=alt.Scale(type="log", nice=False),
        axis=alt.Axis(tickCount=4, format="~g"),
    )


@unchecked
def use_chart(demand: pd.DataFrame, names: list[str]) -> Chart:
    """Show how the sum of the averages settles."""
    # A logarithm has no place for the beginning.
    rows = Rows(
        demand.loc[demand["time"] > 0.0, ["time", "resource"]].assign(level=100.0 * demand["average"])
    )
    title, pick = "sum of averages (% of the capacity)", picked()
    line = (
        alt.Chart(rows.saved)
        .mark_line(clip=True)
        .encode(
            _time(),
            alt.Y("level:Q", title=title),
            resource_colour(names),
            resource_dash(names),
            opacity=pick.opacity,
        )
        .add_params(pick.parameter)
    )
    text = "The sum of the averages of all agents, over the capacity in force, which is the dashed line."
    columns = [Column("time", "time"), Column("resource", "resource"), Column("level", title)]
    chart = finished(alt.layer(line, level_rule(rows, 100.0)), rows, columns, 240)
    return Chart("averages", "The averages settle", text, chart, wide=False)


@unchecked
def convergence_chart(frame: pd.DataFrame, names: list[str], words: Sequence[str]) -> Chart:
    """Show how fast the misallocation falls, in the band in which theory expects it."""
    shares = ["misallocation", "expected", "low", "high"]
    columns = frame[["time", "resource", *shares]].assign(
        resource=frame["resource"].astype(str), **{name: 100.0 * frame[name] for name in shares}
    )
    # A logarithm has no place for a run that is right to the last digit.
    rows = Rows(columns[columns["misallocation"] > 0.0])
    title, pick = "misallocation (% of what is used)", picked()
    level = alt.Y(
        "misallocation:Q",
        title=title,
        scale=alt.Scale(type="log"),
        axis=alt.Axis(format="~g", tickCount=4),
    )
    colours, dashes = resource_colour(names), resource_dash(names)
    line = (
        alt.Chart(rows.saved)
        .mark_line(point={"size": 30, "filled": True})
        .encode(_time(), level, colours, dashes, opacity=pick.opacity)
        .add_params(pick.parameter)
    )
    layers = [line]
    if len(columns["low"].dropna()):
        faint = picked(0.2)
        base = alt.Chart(rows.add("band", columns[columns["low"] > 0.0]))
        band = base.mark_area().encode(
            _time(), alt.Y("low:Q"), alt.Y2("high:Q"), colours, opacity=faint.opacity
        )
        mean = base.mark_line(strokeDash=[1, 3], strokeWidth=1.5).encode(
            _time(), alt.Y("expected:Q"), colours, opacity=pick.opacity
        )
        layers = [line, band, mean]
    text = "How far the averages are from the optimum for what is used; both axes are logarithmic."
    if words:
        text += " Dotted: what theory expects in the mean; 95 % of runs lie in the band. " + " ".join(words)
    saved = [
        Column("time", "time"),
        Column("resource", "resource"),
        Column("misallocation", title),
        *(Column(name, f"{name} by theory (%)") for name in shares[1:]),
    ]
    chart = finished(alt.layer(*layers), rows, saved, 320)
    return Chart("convergence", "How fast, how near", text, chart, wide=False)


@unchecked
def error_chart(frame: pd.DataFrame, names: list[str]) -> Chart:
    """Show the distance from the optimum for all of the capacity, which what is not used keeps large."""
    errors = frame[["time", "resource"]].assign(
        resource=frame["resource"].astype(str), error=100.0 * frame["relative_error"]
    )
    rows = Rows(errors[errors["error"] > 0.0])
    title, pick = "relative error (% of the optimum)", picked()
    line = (
        alt.Chart(rows.saved)
        .mark_line(point={"size": 30, "filled": True})
        .encode(
            _time(),
            alt.Y(
                "error:Q",
                title=title,
                scale=alt.Scale(type="log"),
                axis=alt.Axis(format="~g", tickCount=4),
            ),
            resource_colour(names),
            resource_dash(names),
            opacity=pick.opacity,
        )
        .add_params(pick.parameter)
    )
    text = (
        "How far the averages are from the optimum for all of the capacity: it ends at what is not used, and"
        " says nothing of the shares from there on."
    )
    saved = [Column("time", "time"), Column("resource", "resource"), Column("error", title)]
    return Chart("error", "Distance from the optimum", text, finished(line, rows, saved, 240), wide=False)


@unchecked
def cost_chart(frame: pd.DataFrame) -> Chart:
    """Show the cost of all agents, over that of the optimum."""
    rows = Rows(frame[["time", "cost_ratio"]].drop_duplicates("time"))
    title = "total cost (over the optimal cost)"
    line = alt.Chart(rows.saved).mark_line(point={"size": 30, "filled": True}, color=REFERENCE)
    layers = alt.layer(line.encode(_time(), alt.Y("cost_ratio:Q", title=title)), level_rule(rows, 1.0))
    text = (
        "The cost of all agents over that of the optimum for all of the capacity, which is the dashed line."
        " Below it, less than all is used: what is not held costs nothing."
    )
    saved = [Column("time", "time"), Column("cost_ratio", title)]
    return Chart("cost", "Total cost", text, finished(layers, rows, saved, 240), wide=False)
