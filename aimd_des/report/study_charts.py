"""The charts of a study: measures along one axis, and over two, while sliders move along the others."""

from collections.abc import Sequence
from typing import Any

import altair as alt
import pandas as pd

from aimd_des.report.boundaries import Critical
from aimd_des.report.charts import (
    REFERENCE,
    Column,
    Rows,
    chosen,
    finished,
    picked,
    resource_colour,
    resource_dash,
    resource_shape,
    slid,
    unchecked,
)
from aimd_des.report.html_page import Chart, Choice, Slider
from aimd_des.report.study_axes import Along
from aimd_des.results.shown_measures import AROUND_CAPACITY, LIMITS, shown_measure
from aimd_des.utils.formatting import short


def _slider(axis: int) -> str:
    return f"axis{axis}"


def study_controls(
    axes: Sequence[Along], resources: Sequence[str], measures: Sequence[str], start: Sequence[int]
) -> list[Slider | Choice]:
    """Make the controls of the charts."""
    if len(axes) == 1:
        return []
    numbered = [(str(number), axis.name) for number, axis in enumerate(axes)]
    titles = [(str(k), shown_measure(name).title) for k, name in enumerate(measures)]
    return [
        Choice("along", "Run along", numbered, "0"),
        *(
            Slider(_slider(number), axis.name, axis.labels, start[number], str(number))
            for number, axis in enumerate(axes)
        ),
        Choice("measure", "Map shows", titles, "0"),
        Choice("of", "of resource", [(str(k), name) for k, name in enumerate(resources)], "0"),
        Choice("up", "with upwards", numbered, "1"),
    ]


def _parameters(axes: Sequence[Along], start: Sequence[int]) -> list[alt.Parameter]:
    """Give what charts know of the axes, and the controls that they follow."""
    fixed = [
        alt.param(name="labels", value=[list(axis.labels) for axis in axes]),
        alt.param(name="places", value=[list(axis.places) for axis in axes]),
        alt.param(name="joined", value=[axis.joined for axis in axes]),
        alt.param(name="names", value=[axis.name for axis in axes]),
    ]
    if len(axes) == 1:
        return [*fixed, alt.param(name="along", value="0")]
    followed = [slid(_slider(number), str(position)) for number, position in enumerate(start)]
    return [*fixed, chosen("along", "0"), *followed]


def _here(axes: Sequence[Along], free: Sequence[str]) -> str:
    """Say which rows are at the sliders, along the axes that are free."""
    if len(axes) == 1:
        return "true"
    conditions = []
    for number in range(len(axes)):
        loose = " || ".join(f"toNumber({name}) == {number}" for name in free)
        conditions.append(f"({loose} || datum.i{number} == toNumber({_slider(number)}))")
    return " && ".join(conditions)


def _ticks(axis: str, **more: Any) -> alt.Axis:
    """Name the positions of an axis where they stand."""
    here = f"toNumber({axis})"
    name = f"labels[{here}][indexof(places[{here}], datum.value)]"
    return alt.Axis(values=alt.ExprRef(f"places[{here}]"), labelExpr=name, grid=False, title=None, **more)


def _saved_axes(axes: Sequence[Along]) -> list[Column]:
    return [Column(f"i{number}", axis.name, axis.labels) for number, axis in enumerate(axes)]


@unchecked
def line_chart(
    frame: pd.DataFrame,
    name: str,
    axes: Sequence[Along],
    resources: Sequence[str],
    start: Sequence[int],
    critical: Critical | None,
) -> Chart:
    """Show one measure along an axis, with the confidence intervals of its means.

    Rows have the positions along the axes, resource, mean, low, high, the anchor of the point, and expected
    where theory has something.
    """
    shown, pick = shown_measure(name), picked()
    rows = Rows(frame.assign(**{of: shown.factor * frame[of] for of in ("mean", "low", "high")}))
    base = (
        alt.Chart(rows.saved)
        .transform_filter(_here(axes, ["along"]))
        .transform_calculate(
            x="places[toNumber(along)][datum['i' + along]]",
            at="labels[toNumber(along)][datum['i' + along]]",
        )
    )
    x_axis = alt.X("x:Q", axis=_ticks("along"), scale=alt.Scale(zero=False, nice=False, padding=14))
    y_axis = alt.Y("mean:Q", title=shown.label, scale=alt.Scale(zero=False))
    look = {"color": resource_colour(resources), "opacity": pick.opacity}
    between = alt.ExprRef("joined[toNumber(along)] ? 1 : 0")
    tooltip = [
        alt.Tooltip("at:N", title="at"),
        alt.Tooltip("resource:N", title="resource"),
        *(
            alt.Tooltip(f"{of}:Q", title=f"{of} ({shown.unit})" if of == "mean" else of, format=".4g")
            for of in ("mean", "low", "high")
        ),
    ]
    points = base.mark_point(size=45, filled=True, cursor="pointer").encode(
        x_axis, y_axis, shape=resource_shape(resources), tooltip=tooltip, href=alt.Href("link:N"), **look
    )
    bars = base.mark_rule(strokeWidth=1.2).encode(x_axis, alt.Y("low:Q"), alt.Y2("high:Q"), **look)
    line = base.mark_line(strokeOpacity=between).encode(
        x_axis, y_axis, strokeDash=resource_dash(resources), **look
    )
    layers = [
        points.add_params(pick.parameter, *_parameters(axes, start)),
        line,
        bars,
        *_levels(rows, name, shown.factor),
    ]
    if "expected" in frame:
        expected = base.transform_calculate(level=f"{shown.factor} * datum.expected")
        layers.append(
            expected.mark_line(strokeDash=[1, 3], strokeOpacity=between).encode(
                x_axis, alt.Y("level:Q"), **look
            )
        )
    if critical is not None:
        layers.append(_critical_rule(rows, critical, axes, x_axis, look))
    below = alt.Title(text=alt.ExprRef("names[toNumber(along)]"), orient="bottom", anchor="middle")
    chart = alt.layer(*layers, title=below)
    columns = [*_saved_axes(axes), Column("resource", "resource")]
    columns += [Column(of, f"{of} of {shown.label}") for of in ("mean", "low", "high")]
    spec = finished(chart, rows, columns, 260)
    return Chart(
        f"line-{name.replace('_', '-')}", shown.title, _said(name, frame, critical), spec, wide=False
    )


def _said(name: str, frame: pd.DataFrame, critical: Critical | None) -> str:
    """Say what a chart along an axis shows."""
    parts = ["Means over the replications, with their 95 % confidence intervals"]
    if name in AROUND_CAPACITY:
        parts.append("dashed: the capacity")
    elif name in LIMITS:
        parts.append(f"dashed: {short(100.0 * LIMITS[name])} %")
    if "expected" in frame:
        parts.append("dotted: what theory expects in the mean")
    text = "; ".join(parts) + "."
    if critical is not None:
        text += " Along the loss, vertical lines are theory's critical losses, beyond which demand runs away."
    return f"{text} A point leads to its runs."


def _levels(rows: Rows, name: str, factor: float) -> list[alt.Chart]:
    """Draw the capacity, or the limit of what is good."""
    at = 1.0 if name in AROUND_CAPACITY else LIMITS.get(name)
    if at is None:
        return []
    rule = alt.Chart(rows.add("level", pd.DataFrame({"level": [factor * at]})))
    return [rule.mark_rule(color=REFERENCE, strokeDash=[5, 4]).encode(alt.Y("level:Q"))]


def _critical_frame(critical: Critical, axes: Sequence[Along], resources: Sequence[str]) -> pd.DataFrame:
    axis = axes[critical.axis]
    inside = critical.rows[critical.rows["loss"] > 0.0] if axis.log else critical.rows
    return inside.assign(
        x=[axis.place(loss) for loss in inside["loss"]],
        words=[short(round(loss, 3)) for loss in inside["loss"]],
        r=inside["resource"].map({name: k for k, name in enumerate(resources)}),
    )


def _critical_rule(
    rows: Rows, critical: Critical, axes: Sequence[Along], x_axis: alt.X, look: dict[str, Any]
) -> alt.Chart:
    """Draw the critical loss of each resource where charts run along the loss."""
    frame = _critical_frame(critical, axes, list(dict.fromkeys(critical.rows["resource"])))
    rule: alt.Chart = (
        alt.Chart(rows.add("critical", frame))
        .transform_filter(f"toNumber(along) == {critical.axis} && {_here(axes, ['along'])}")
        .mark_rule(strokeDash=[6, 3], strokeWidth=1.5)
        .encode(x_axis, tooltip=[alt.Tooltip("words:N", title="critical loss by theory")], **look)
    )
    return rule


@unchecked
def map_chart(
    frame: pd.DataFrame,
    measures: Sequence[str],
    axes: Sequence[Along],
    resources: Sequence[str],
    start: Sequence[int],
    critical: Critical | None,
) -> Chart:
    """Show one measure of one resource over two axes.

    Rows have the positions along the axes, r, and of each measure the mean m0, m1 and so on and the
    half-width of its interval h0, h1 and so on.
    """
    edges = [axis.edges for axis in axes]
    rows = Rows(frame)
    base = _map_base(rows.saved, axes)
    flush = alt.Scale(zero=False, nice=False)
    x_axis = alt.X("x:Q", axis=_ticks("along"), scale=flush)
    y_axis = alt.Y("y:Q", axis=_ticks("other"), scale=flush)
    cells = base.mark_rect(stroke="#ffffff", strokeWidth=0.5, cursor="pointer").encode(
        x_axis,
        y_axis,
        alt.X2("x2:Q"),
        alt.Y2("y2:Q"),
        color=_map_colour(),
        href=alt.Href("link:N"),
        tooltip=[
            alt.Tooltip("at:N", title="at"),
            alt.Tooltip("over:N", title="and"),
            alt.Tooltip("said:N", title="mean (95 %)"),
        ],
    )
    beyond = (
        base.transform_filter("datum.value > limits[toNumber(measure)]")
        .mark_point(shape="circle", size=14, filled=True, color="#000000", stroke="#ffffff", opacity=1.0)
        .encode(alt.X("xc:Q"), alt.Y("yc:Q"))
    )
    cells = cells.add_params(*_map_parameters(frame, measures, axes, edges, start))
    layers = [cells, beyond, *([] if critical is None else _critical_lines(rows, critical, axes, resources))]
    over = "names[toNumber(other)] + ' (up) over ' + names[toNumber(along)]"
    what = "shown[toNumber(measure)] + ' (' + units[toNumber(measure)] + ')'"
    words = f"{what} + ': ' + {over}"
    title = alt.Title(text=alt.ExprRef(words), anchor="start")
    chart = alt.layer(*layers, title=title)
    columns = [
        *_saved_axes(axes),
        Column("r", "resource", tuple(resources)),
        *(
            Column(f"{kind}{k}", f"{name}{word}")
            for k, name in enumerate(measures)
            for kind, word in (("m", " (mean)"), ("h", " (half-width of the 95 % interval)"))
        ),
    ]
    spec = finished(chart, rows, columns, 340)
    return Chart("map", "Over two axes", _map_text(measures, critical), spec)


def _map_base(saved: alt.NamedData, axes: Sequence[Along]) -> alt.Chart:
    """Take the rows that the map shows, with their cells, values and words."""
    base: alt.Chart = (
        alt.Chart(saved)
        .transform_filter(f"datum.r == toNumber(of) && {_here(axes, ['along', 'other'])}")
        .transform_calculate(
            **{
                end: f"{ends}[toNumber({axis})][datum['i' + {axis}]]"
                for axis, end, ends in (
                    ("along", "x", "lows"),
                    ("along", "x2", "highs"),
                    ("other", "y", "lows"),
                    ("other", "y2", "highs"),
                )
            },
            xc="places[toNumber(along)][datum['i' + along]]",
            yc="places[toNumber(other)][datum['i' + other]]",
            value="factors[toNumber(measure)] * datum['m' + measure]",
            half="factors[toNumber(measure)] * datum['h' + measure]",
            at="names[toNumber(along)] + ' ' + labels[toNumber(along)][datum['i' + along]]",
            over="names[toNumber(other)] + ' ' + labels[toNumber(other)][datum['i' + other]]",
            said="format(datum.value, '.4~g') + ' ± ' + format(datum.half, '.2~g')"
            " + ' ' + units[toNumber(measure)]",
        )
        .transform_filter("isValid(datum.value)")
    )
    return base


def _map_text(measures: Sequence[str], critical: Critical | None) -> str:
    text = (
        "One cell for each point, as wide as the steps between values. What is held against the capacity has"
        " the capacity, 100 %, as the middle of its colours: blue below, red above; of other measures bright"
        " is high."
    )
    limits = [
        f"{shown_measure(name).title.lower()} above {short(100.0 * LIMITS[name])} %"
        for name in measures
        if name in LIMITS
    ]
    if limits:
        text += f" A dot marks {' or '.join(limits)}."
    return text + ("" if critical is None else " The line is the critical loss by theory.")


def _map_colour() -> alt.Color:
    """Colour cells around the capacity, or from low to high: which of the two, the measure decides."""
    middle = "around[toNumber(measure)]"
    around = "['#2166ac', '#92c5de', '#f7f7f7', '#f4a582', '#b2182b']"
    scale = alt.Scale(
        scheme=alt.ExprRef(f"{middle} ? {around} : 'cividis'"),
        domainMid=alt.ExprRef(f"{middle} ? 100 : null"),
        domainMin=alt.ExprRef("ends[toNumber(measure)][toNumber(of)][0]"),
        domainMax=alt.ExprRef("ends[toNumber(measure)][toNumber(of)][1]"),
        zero=False,
        nice=False,
    )
    legend = alt.Legend(title=None, orient="right", format=".3~g")
    return alt.Color("value:Q", scale=scale, legend=legend)


def _map_parameters(
    frame: pd.DataFrame,
    measures: Sequence[str],
    axes: Sequence[Along],
    edges: Sequence[tuple[Sequence[float], Sequence[float]]],
    start: Sequence[int],
) -> list[alt.Parameter]:
    """Give what the map knows of axes and measures, and the controls that it follows."""
    shown = [shown_measure(name) for name in measures]
    known = {
        "lows": [list(low) for low, _ in edges],
        "highs": [list(high) for _, high in edges],
        "shown": [one.title for one in shown],
        "units": [one.unit for one in shown],
        "factors": [one.factor for one in shown],
        "around": [name in AROUND_CAPACITY for name in measures],
        # What has no limit is never beyond it.
        "limits": [one.factor * LIMITS.get(name, 1e300) for name, one in zip(measures, shown, strict=True)],
        "ends": [
            _ends(frame, k, name, one.factor)
            for k, (name, one) in enumerate(zip(measures, shown, strict=True))
        ],
    }
    return [
        *_parameters(axes, start),
        chosen("up", "1"),
        # Along and up the same axis there would only be a diagonal.
        alt.param(name="other", expr="up != along ? up : along == '0' ? '1' : '0'"),
        chosen("measure", "0"),
        chosen("of", "0"),
        *(alt.param(name=name, value=value) for name, value in known.items()),
    ]


def _ends(frame: pd.DataFrame, number: int, name: str, factor: float) -> list[list[float]]:
    """Say from where to where colours go, of each resource: the same for all positions of the sliders."""
    found = []
    for _, values in frame.groupby("r")[f"m{number}"]:
        low, high = factor * float(values.min()), factor * float(values.max())
        if name in AROUND_CAPACITY:
            reach = max(abs(low - 100.0), abs(high - 100.0), 1.0)
            low, high = 100.0 - reach, 100.0 + reach
        found.append([low, high] if low < high else [low - 1.0, high + 1.0])
    return found


def _critical_lines(
    rows: Rows, critical: Critical, axes: Sequence[Along], resources: Sequence[str]
) -> list[alt.Chart]:
    """Draw the critical loss across the map, for the loss on either axis."""
    base = alt.Chart(rows.add("critical", _critical_frame(critical, axes, resources)))
    lines = []
    for loss, across, (one, two) in (("along", "other", ("y", "y2")), ("other", "along", ("x", "x2"))):
        at = "x" if loss == "along" else "y"
        here = f"toNumber({loss}) == {critical.axis} && datum.r == toNumber(of)"
        placed = base.transform_filter(f"{here} && {_here(axes, ['along', 'other'])}").transform_calculate(
            level="datum.x",
            start=f"lows[toNumber({across})][datum['i' + {across}]]",
            end=f"highs[toNumber({across})][datum['i' + {across}]]",
        )
        channel = {"x": alt.X, "y": alt.Y}
        second = {"x2": alt.X2, "y2": alt.Y2}
        lines.append(
            placed.mark_rule(strokeWidth=2.5, color="#000000").encode(
                channel[at]("level:Q"), channel[one]("start:Q"), second[two]("end:Q")
            )
        )
    return lines
