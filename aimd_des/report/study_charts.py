"""The charts of a study: measures along one axis, and over two, while sliders move along the others."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import altair as alt
import pandas as pd

from aimd_des.report.charts import chosen, data, finished, resource_colour, slid
from aimd_des.report.html_page import Chart, Choice, Slider
from aimd_des.report.verdicts import JUDGED
from aimd_des.results.measures import MEASURES


class Along(NamedTuple):
    """An axis of the study as charts have it; axes that vary together are one."""

    name: str  # for people
    values: tuple[str, ...]  # what its positions are called


def _slider(axis: int) -> str:
    return f"axis{axis}"


def study_controls(
    axes: Sequence[Along], resources: Sequence[str], measures: Sequence[str], start: Sequence[int]
) -> list[Slider | Choice]:
    """Make the controls of the charts."""
    numbered = [(str(number), axis.name) for number, axis in enumerate(axes)]
    controls: list[Slider | Choice] = []
    if len(axes) > 1:
        controls.append(Choice("along", "Run along", numbered, "0"))
    controls += [
        Slider(_slider(number), axis.name, axis.values, start[number], str(number))
        for number, axis in enumerate(axes)
        if len(axes) > 1
    ]
    if len(axes) > 1:
        controls += [
            Choice("up", "Map: up", numbered, "1"),
            Choice(
                "measure",
                "Map: measure",
                [(str(k), MEASURES[name].title) for k, name in enumerate(measures)],
                "0",
            ),
            Choice("of", "Map: resource", [(str(k), name) for k, name in enumerate(resources)], "0"),
        ]
    return controls


def _parameters(axes: Sequence[Along], start: Sequence[int]) -> list[alt.Parameter]:
    """Give what charts know of the axes, and the controls that they follow."""
    fixed = [
        alt.param(name="labels", value=[list(axis.values) for axis in axes]),
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


def _ordinal(field: str, of: str, **more: Any) -> dict[str, Any]:
    axis = alt.Axis(labelExpr=f"labels[toNumber({of})][datum.value]", title=None, labelAngle=0)
    return {"shorthand": f"{field}:O", "axis": axis, **more}


def line_chart(
    frame: pd.DataFrame, name: str, axes: Sequence[Along], resources: Sequence[str], start: Sequence[int]
) -> Chart:
    """Show one measure along an axis, with the confidence intervals of its means."""
    measure = MEASURES[name]
    base = (
        alt.Chart(data(frame))
        .transform_filter(_here(axes, ["along"]))
        .transform_calculate(x="datum['i' + along]", at="labels[toNumber(along)][datum['i' + along]]")
    )
    x_axis = alt.X(**_ordinal("x", "along"))
    share = alt.Axis(format="%") if name in JUDGED else alt.Axis()
    y_axis = alt.Y("mean:Q", title=measure.unit, axis=share, scale=alt.Scale(zero=False))
    colours = resource_colour(resources)
    band = base.mark_area(opacity=0.2).encode(x_axis, alt.Y("low:Q"), alt.Y2("high:Q"), colours)
    line = base.mark_line(point={"size": 40, "filled": True}).encode(
        x_axis,
        y_axis,
        colours,
        tooltip=[
            alt.Tooltip("at:N", title="at"),
            alt.Tooltip("resource:N", title="resource"),
            *(alt.Tooltip(f"{end}:Q", title=end, format=".4g") for end in ("mean", "low", "high")),
        ],
    )
    below = alt.Title(text=alt.ExprRef("names[toNumber(along)]"), orient="bottom", anchor="middle")
    chart = alt.layer(band, line).add_params(*_parameters(axes, start)).properties(title=below)
    text = "Means over the replications, with their 95 % confidence intervals."
    return Chart(f"line-{name.replace('_', '-')}", measure.title, text, finished(chart, 240), wide=False)


def map_chart(
    frame: pd.DataFrame,
    measures: Sequence[str],
    axes: Sequence[Along],
    start: Sequence[int],
) -> Chart:
    """Show one measure of one resource over two axes."""
    parameters = [
        *_parameters(axes, start),
        chosen("up", "1"),
        # Along and up the same axis there would be nothing but a diagonal.
        alt.param(name="other", expr="up != along ? up : along == '0' ? '1' : '0'"),
        chosen("measure", "0"),
        chosen("of", "0"),
        alt.param(name="titles", value=[MEASURES[name].title for name in measures]),
    ]
    base = (
        alt.Chart(data(frame))
        .transform_filter(f"datum.r == toNumber(of) && {_here(axes, ['along', 'other'])}")
        .transform_calculate(
            x="datum['i' + along]",
            y="datum['i' + other]",
            value="datum['m' + measure]",
            half="datum['h' + measure]",
            at="labels[toNumber(along)][datum['i' + along]]",
            over="labels[toNumber(other)][datum['i' + other]]",
        )
        .transform_filter("isValid(datum.value)")
    )
    colour = alt.Color(
        "value:Q",
        scale=alt.Scale(scheme="cividis", zero=False),
        legend=alt.Legend(title=None, orient="right", format=".3~g"),
    )
    cells = base.mark_rect(stroke="#ffffff", strokeWidth=0.5).encode(
        alt.X(**_ordinal("x", "along")),
        alt.Y(**_ordinal("y", "other", sort="descending")),
        colour,
        tooltip=[
            alt.Tooltip("at:N", title="along"),
            alt.Tooltip("over:N", title="up"),
            alt.Tooltip("value:Q", title="mean", format=".4g"),
            alt.Tooltip("half:Q", title="± (95 %)", format=".2g"),
        ],
    )
    words = (
        "titles[toNumber(measure)] + ': ' + names[toNumber(other)] + ' (up) over ' + names[toNumber(along)]"
    )
    title = alt.Title(text=alt.ExprRef(words), anchor="start")
    chart = cells.add_params(*parameters).properties(title=title)
    text = (
        "One cell for each point; all cells are equally large, whatever the steps between values."
        " Bright is high. Choose what is along, what is up, the measure and the resource above."
    )
    return Chart("map", "Over two axes", text, finished(chart, 320))
