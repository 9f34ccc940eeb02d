"""Figures of the studies: panels, points with their errors, lines of theory, and names for the legend."""

from collections.abc import Iterable
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import REFERENCE, colour, frame, number_axis
from aimd_des.study import mean_and_error

__all__ = [
    "MARKS",
    "REFERENCE",
    "course",
    "curve",
    "curves",
    "dress",
    "frame",
    "legends",
    "level",
    "named",
    "number_axis",
    "panels",
    "points",
    "theory",
]

MARKS = "os^DvPX"


def panels(rows: int, columns: int, size: tuple[float, float], **how: Any) -> tuple[Figure, list[Axes]]:
    """Make a figure of so many panels, listed row by row; `size` in inches."""
    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False, **how).flat)


def points(
    axes: Axes, x: Any, rows: pd.DataFrame, place: int, label: str = "", *, scale: float = 1.0, **look: Any
) -> None:
    """Draw the means of rows with ± 2 standard errors, in the colour and with the mark of a place."""
    usual: dict[str, Any] = {"fmt": MARKS[place], "color": colour(place), "markersize": 5.5, "capsize": 2.5}
    axes.errorbar(
        x, scale * rows["mean"], 2.0 * scale * rows["standard_error"], label=label, **(usual | look)
    )


def course(axes: Axes, time: Any, runs: Any, expected: Any, shade: str) -> None:
    """Draw the mean of runs of a demand (thin) and an average, ± 2 standard errors, and what theory has."""
    mean, error = mean_and_error(runs)
    for k, width in ((0, 0.9), (1, 2.2)):
        low, high = mean[k] - 2 * error[k], mean[k] + 2 * error[k]
        axes.fill_between(time, low, high, color=shade, alpha=0.2, linewidth=0)
        axes.plot(time, mean[k], color=shade, linewidth=width)
        axes.plot(time, expected[k], ":", color="black", linewidth=0.9)


def theory(axes: Axes, x: Any, rows: pd.DataFrame, place: int, *, scale: float = 1.0) -> None:
    """Draw what theory has for rows, in the colour of a place."""
    axes.plot(x, scale * rows["theory"], color=colour(place), linewidth=1.5)


def curve(
    axes: Axes, x: Any, rows: pd.DataFrame, place: int, label: str = "", *, scale: float = 1.0, **look: Any
) -> None:
    """Draw rows as `points` does, and what theory has for them."""
    points(axes, x, rows, place, label, scale=scale, **look)
    theory(axes, x, rows, place, scale=scale)


def curves(axes: Axes, x: str, by: str, table: pd.DataFrame, label: str = "{}", **how: Any) -> None:
    """Draw a `curve` over a column for each value of another, with the value in its label."""
    for place, value in enumerate(table[by].unique()):
        rows = table[table[by] == value]
        curve(axes, rows[x], rows, place, label.format(value), **how)


def level(axes: Axes, value: float, style: str = ":") -> None:
    """Draw a level that others are held against."""
    axes.axhline(value, color=REFERENCE, linewidth=1.0, linestyle=style)


def named(axes: Axes, label: str, style: str = "-", **look: Any) -> None:
    """Put a kind of line or mark into the legend."""
    usual: dict[str, Any] = {"color": REFERENCE, "linewidth": 1.5}
    axes.plot([], [], style, label=label, **(usual | look))


def legends(panels: Iterable[Axes], **how: Any) -> None:
    """Give each panel a legend of its own."""
    for axes in panels:
        axes.legend(**({"frameon": False, "fontsize": "small"} | how))


def dress(
    axes: Axes, title: str = "", x: str = "", y: str = "", *, numbers: str = "xy", **limits: Any
) -> None:
    """Give axes their title, labels, scales and limits (as of `Axes.set`), and numbers along x, y or both."""
    axes.set_title(title, loc="left", fontsize="medium")
    axes.set(xlabel=x, ylabel=y, **limits)
    for name in numbers:
        number_axis(axes.xaxis if name == "x" else axes.yaxis)
    frame(axes)
