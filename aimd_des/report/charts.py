"""What all charts share: data, colours of the resources, controls, and the look that styles can change."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import altair as alt
import pandas as pd
from altair.utils.schemapi import debug_mode

from aimd_des.utils.colours import COLOURS

#: Of lines that are no data; seen on light and on dark ground.
REFERENCE = "#808890"
_HEIGHT = 260
# Of the lines and marks of resources; they repeat later than colours do.
_DASHES = ((1, 0), (7, 3), (2, 2), (9, 3, 2, 3), (12, 4), (4, 2, 1, 2, 1, 2), (5, 5))
_SHAPES = ("circle", "square", "triangle-up", "diamond", "cross", "triangle-down", "triangle-right")
# Charts follow the range of their values: of 1.00021 to 1.00027 five digits are two steps.
_DIGITS = 8

#: Around functions that make charts: Altair would check each part when it is made, and again with each whole.
#: Tests check finished charts instead.
unchecked = debug_mode(False)


class Rows:
    """The rows of one chart, which refers to them by their names.

    Altair copies and checks what a chart holds at every step.  Rows are thus put in when it is finished.
    """

    def __init__(self, saved: pd.DataFrame) -> None:
        """Begin with the rows that the chart saves as CSV."""
        self.datasets: dict[str, list[dict[str, Any]]] = {}
        self.saved = self.add("rows", saved)

    def add(self, name: str, frame: pd.DataFrame) -> alt.NamedData:
        """Add what another layer draws."""
        self.datasets[name] = [
            {str(key): rounded(value) for key, value in row.items() if not _missing(value)}
            for row in frame.to_dict("records")
        ]
        return alt.NamedData(name=name)


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
    opacity: alt.OpacityValue


def picked(opacity: float = 1.0) -> Picked:
    """Let the legend of a chart select its resources."""
    parameter = alt.selection_point(name="picked", fields=["resource"], bind="legend")
    shown = {"param": parameter.name, "value": opacity}
    return Picked(parameter, alt.OpacityValue(min(0.12, opacity), condition=shown))


def slid(name: str, start: str) -> alt.Parameter:
    """Make a parameter that follows a slider of the page while it moves."""
    return _bound(name, start, "input")


def chosen(name: str, start: str) -> alt.Parameter:
    """Make a parameter that follows a choice of the page."""
    return _bound(name, start, "change")


def _bound(name: str, start: str, event: str) -> alt.Parameter:
    return alt.param(name=name, value=start, bind=alt.BindDirect(element=f"#{name}", event=event))


def level_rule(rows: Rows, at: float) -> alt.Chart:
    """Draw a level that others are held against."""
    level = alt.Chart(rows.add("level", pd.DataFrame({"one": [at]})))
    rule: alt.Chart = level.mark_rule(color=REFERENCE, strokeDash=[5, 4]).encode(alt.Y("one:Q"))
    return rule


class Column(NamedTuple):
    """A column of what a chart saves as CSV."""

    key: str  # of the rows
    name: str  # for people, with the unit
    values: tuple[str, ...] = ()  # what positions stand for, where the rows have positions


def finished(
    chart: alt.Chart | alt.LayerChart | alt.FacetChart,
    rows: Rows,
    columns: Sequence[Column],
    height: int = _HEIGHT,
) -> dict[str, Any]:
    """Make a chart as wide as its place, give it its rows, and say which of them it saves."""
    # A layered chart copies and combines its layers anew in each of its methods, so that none is called.
    spec: dict[str, Any] = chart.to_dict(validate=False)
    spec |= {"width": "container", "height": height, "autosize": {"type": "fit-x", "contains": "padding"}}
    spec |= {"background": "transparent", "datasets": rows.datasets}
    named = {
        column.key: {"name": column.name, **({"values": list(column.values)} if column.values else {})}
        for column in columns
    }
    spec["usermeta"] = {"rows": rows.saved["name"], "columns": named}
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
