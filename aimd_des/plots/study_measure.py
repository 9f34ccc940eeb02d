"""A measure of a study: along an axis with its confidence intervals, or over two axes of numbers as a map."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas.api.types import is_numeric_dtype

from aimd_des.plots.maps import heat_map
from aimd_des.plots.style import REFERENCE, NotebookFigure, axis_label, colour, frame, mark, plain
from aimd_des.results.shown_measures import AROUND_CAPACITY, shown_measure
from aimd_des.utils.errors import InputError

_LEGEND: Any = {"frameon": False, "fontsize": "small", "title_fontsize": "small"}


def plot_measure(table: pd.DataFrame, axes: Sequence[str], measure: str) -> Figure:
    """Draw the summary of a study along one axis, or over two; at most two axes may vary.

    There is a line for each resource, or for each case where one axis has cases and the other numbers.
    """
    varied = [name for name in axes if len(set(table[name])) > 1]
    if not 1 <= len(varied) <= 2:
        found = ", ".join(varied) or "none"
        raise InputError(
            f"a figure needs one or two axes with several values, not {found}; choose them by name"
        )
    rows = table[table["measure"] == measure].copy()
    rows[["mean", "low", "high"]] *= shown_measure(measure).factor
    names = list(dict.fromkeys(rows["resource"].astype(str)))
    if len(varied) == 1:
        figure = NotebookFigure(figsize=(6.4, 4.0), layout="constrained")
        _lines(figure.add_subplot(), _of_each(rows, "resource"), varied[0], measure)
        return figure
    figure = NotebookFigure(figsize=(4.6 * len(names) + 0.6, 3.8), layout="constrained")
    along, cases = sorted(varied, key=lambda axis: not _has_numbers(rows[axis]))
    lines = _has_numbers(rows[along]) and not _has_numbers(rows[cases])
    for panel, name in zip(figure.subplots(1, len(names), squeeze=False).flat, names, strict=True):
        own = rows[rows["resource"] == name]
        if lines:
            _lines(panel, _of_each(own, cases), along, measure)
            panel.legend(title=plain(cases), **_LEGEND)
        else:
            _map(panel, own, varied, measure)
        panel.set_title(plain(name), loc="left", fontsize="medium")
    return figure


def _has_numbers(column: Any) -> bool:
    return is_numeric_dtype(column) and column.dtype != bool


def _of_each(rows: pd.DataFrame, axis: str) -> dict[str, pd.DataFrame]:
    """Take the rows of each case of an axis, in their order."""
    return {str(case): rows[rows[axis] == case] for case in dict.fromkeys(rows[axis])}


def _map(panel: Axes, rows: pd.DataFrame, varied: list[str], measure: str) -> None:
    title, unit, factor = shown_measure(measure)
    around = factor if measure in AROUND_CAPACITY else None
    cells = rows.rename(columns={"mean": title})
    heat_map(panel, cells, varied[1], varied[0], title, units={title: unit}, middle=around)


def _lines(panel: Axes, series: Mapping[str, pd.DataFrame], axis: str, measure: str) -> None:
    for j, (name, own) in enumerate(series.items()):
        numbers = _has_numbers(own[axis])
        at: Any = own[axis] if numbers else own[axis].astype(str).map(plain)
        reach = [own["mean"] - own["low"], own["high"] - own["mean"]]
        style = "-" if numbers else "none"
        look: dict[str, Any] = {"marker": mark(j), "linestyle": style, "capsize": 2.5, "markersize": 5.0}
        panel.errorbar(at, own["mean"], reach, color=colour(j), label=plain(name), **look)
    title, unit, factor = shown_measure(measure)
    if measure in AROUND_CAPACITY:
        panel.axhline(factor, color=REFERENCE, linewidth=1.0, linestyle="--", label="capacity")
    panel.set_xlabel(plain(axis))
    panel.set_ylabel(axis_label(title, unit))
    frame(panel)
    panel.legend(**_LEGEND)
