"""What all charts share: data, colours of the resources, controls, and the look that styles can change."""

import math
from collections.abc import Sequence
from typing import Any

import altair as alt
import pandas as pd

from aimd_des.utils.colours import COLOURS

#: Of lines that are no data; seen on light and on dark ground.
REFERENCE = "#808890"
_HEIGHT = 260
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


def resource_colour(names: Sequence[str], *, legend: bool = True) -> alt.Color:
    """Give every resource the colour that it has in all figures."""
    # Black would not be seen on a dark ground.
    shown = ["currentColor" if colour == "#000000" else colour for colour in COLOURS]
    colours = [shown[j % len(shown)] for j in range(len(names))]
    scale = alt.Scale(domain=list(names), range=colours)
    key = (
        alt.Legend(orient="top", title=None, columns=3, labelLimit=140, symbolOpacity=1.0) if legend else None
    )
    return alt.Color("resource:N", scale=scale, legend=key)


def slid(name: str, start: str) -> alt.Parameter:
    """Make a parameter that follows a slider of the page while it moves."""
    return _bound(name, start, "input")


def chosen(name: str, start: str) -> alt.Parameter:
    """Make a parameter that follows a choice of the page."""
    return _bound(name, start, "change")


def _bound(name: str, start: str, event: str) -> alt.Parameter:
    return alt.param(name=name, value=start, bind=alt.BindDirect(element=f"#{name}", event=event))


def finished(chart: alt.Chart | alt.LayerChart | alt.FacetChart, height: int = _HEIGHT) -> dict[str, Any]:
    """Make a chart as wide as its place."""
    sized = chart.properties(width="container", height=height, background="transparent")
    spec: dict[str, Any] = sized.to_dict()
    spec["autosize"] = {"type": "fit-x", "contains": "padding"}
    spec["config"] = {
        "view": {"stroke": None},
        "axis": {"labelFontSize": 12, "titleFontSize": 12, "titleFontWeight": "normal", "labelOverlap": True},
        "legend": {"labelFontSize": 12, "symbolSize": 90},
        "title": {"fontSize": 12, "fontWeight": "normal"},
        "line": {"strokeWidth": 2},
        # The chart as a whole is described; thousands of marks would drown that.
        "mark": {"aria": False},
    }
    return spec
