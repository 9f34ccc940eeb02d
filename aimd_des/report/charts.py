"""What all charts share: data, colours of the resources, controls, and the look that styles can change."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import altair as alt
import pandas as pd

from aimd_des.utils.colours import COLOURS

#: Of lines that are no data; seen on light and on dark ground.
REFERENCE = "#808890"
_HEIGHT = 260
# Of the lines and marks of resources; they repeat later than colours do.
_DASHES = ((1, 0), (7, 3), (2, 2), (9, 3, 2, 3), (12, 4), (4, 2, 1, 2, 1, 2), (5, 5))
_SHAPES = ("circle", "square", "triangle-up", "diamond", "cross", "triangle-down", "triangle-right")
_DIGITS = 5


def data(frame: pd.DataFrame) -> alt.InlineData:
    """Put a frame into a chart."""
    rows = [
        {str(name): rounded(value) for name, value in row.items() if not _missing(value)}
        for row in frame.to_dict("records")
    ]
    return alt.InlineData(values=rows)


def _missing(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def rounded(value: Any) -> Any:
    """Write no more of a number than can be seen."""
    if not isinstance(value, float):
        return value
    short = float(f"{value:.{_DIGITS}g}")
    return int(short) if short.is_integer() and abs(short) < 2**53 else short


def _key() -> alt.Legend:
    return alt.Legend(orient="top", title=None, columns=3, labelLimit=140, symbolOpacity=1.0)


def resource_colour(names: Sequence[str], *, legend: bool = True) -> alt.Color:
    """Give every resource the colour that it has in all figures."""
    # Black would not be seen on a dark ground.
    shown = ["currentColor" if colour == "#000000" else colour for colour in COLOURS]
    colours = [shown[j % len(shown)] for j in range(len(names))]
    scale = alt.Scale(domain=list(names), range=colours)
    return alt.Color("resource:N", scale=scale, legend=_key() if legend else None)


def resource_dash(names: Sequence[str], *, legend: bool = True) -> alt.StrokeDash:
    """Give every resource a line of its own besides its colour."""
    scale = alt.Scale(domain=list(names), range=[list(_DASHES[j % len(_DASHES)]) for j in range(len(names))])
    return alt.StrokeDash("resource:N", scale=scale, legend=_key() if legend else None)


def resource_shape(names: Sequence[str], *, legend: bool = True) -> alt.Shape:
    """Give every resource a mark of its own besides its colour."""
    scale = alt.Scale(domain=list(names), range=[_SHAPES[j % len(_SHAPES)] for j in range(len(names))])
    return alt.Shape("resource:N", scale=scale, legend=_key() if legend else None)


class Picked(NamedTuple):
    """What the legend selects: a click shows one resource and lets the others fade."""

    parameter: alt.Parameter
    opacity: alt.Opacity


def picked(opacity: float = 1.0) -> Picked:
    """Let the legend of a chart select its resources."""
    parameter = alt.selection_point(name="picked", fields=["resource"], bind="legend")
    faint = alt.value(min(0.12, opacity))
    return Picked(parameter, alt.condition(parameter, alt.value(opacity), faint))  # type: ignore[arg-type]


def slid(name: str, start: str) -> alt.Parameter:
    """Make a parameter that follows a slider of the page while it moves."""
    return _bound(name, start, "input")


def chosen(name: str, start: str) -> alt.Parameter:
    """Make a parameter that follows a choice of the page."""
    return _bound(name, start, "change")


def _bound(name: str, start: str, event: str) -> alt.Parameter:
    return alt.param(name=name, value=start, bind=alt.BindDirect(element=f"#{name}", event=event))


def level_rule(at: float) -> alt.Chart:
    """Draw a level that others are held against."""
    level = alt.Chart(data(pd.DataFrame({"one": [at]})))
    rule: alt.Chart = level.mark_rule(color=REFERENCE, strokeDash=[5, 4]).encode(alt.Y("one:Q"))
    return rule


class Column(NamedTuple):
    """A column of what a chart saves as CSV."""

    key: str  # of the rows
    name: str  # for people, with the unit
    values: tuple[str, ...] = ()  # what positions stand for, where the rows have positions


def finished(
    chart: alt.Chart | alt.LayerChart | alt.FacetChart,
    columns: Sequence[Column],
    height: int = _HEIGHT,
    *,
    layer: int = 0,
) -> dict[str, Any]:
    """Make a chart as wide as its place, and say which rows it saves: those of one of its layers."""
    sized = chart.properties(width="container", height=height, background="transparent")
    spec: dict[str, Any] = sized.to_dict()
    spec["autosize"] = {"type": "fit-x", "contains": "padding"}
    source = spec if "data" in spec else spec["layer"][layer]
    named = {
        column.key: {"name": column.name, **({"values": list(column.values)} if column.values else {})}
        for column in columns
    }
    spec["usermeta"] = {"rows": source["data"]["name"], "columns": named}
    spec["config"] = {
        "view": {"stroke": None},
        "axis": {"labelFontSize": 12, "titleFontSize": 12, "titleFontWeight": "normal", "labelOverlap": True},
        "legend": {"labelFontSize": 12, "titleFontSize": 12, "titleFontWeight": "normal", "symbolSize": 90},
        "title": {"fontSize": 12, "fontWeight": "normal"},
        "line": {"strokeWidth": 2},
        # The chart as a whole is described; thousands of marks would drown that.
        "mark": {"aria": False},
    }
    return spec
