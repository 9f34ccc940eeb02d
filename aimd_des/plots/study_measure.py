"""A measure of a study: along one axis with its confidence intervals, or over two axes as a map."""

from collections.abc import Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas.api.types import is_numeric_dtype

from aimd_des.plots.maps import heat_map
from aimd_des.plots.style import REFERENCE, NotebookFigure, axis_label, colour, frame, mark, plain
from aimd_des.results.shown_measures import AROUND_CAPACITY, shown_measure
from aimd_des.utils.errors import InputError


def plot_measure(table: pd.DataFrame, axes: Sequence[str], measure: str) -> Figure:
    """Draw the summary of a study, a line or a map for each resource; at most two axes may vary."""
    varied = [name for name in axes if len(set(table[name])) > 1]
    if not 1 <= len(varied) <= 2:
        found = ", ".join(varied) or "none"
        raise InputError(
            f"a figure needs one or two axes with several values, not {found}; choose them by name"
        )
    rows = table[table["measure"] == measure].copy()
    rows[["mean", "low", "high"]] *= shown_measure(measure).factor
    names = list(dict.fromkeys(rows["resource"].astype(str)))
    maps = len(varied) == 2
    size = (4.6 * len(names) + 0.6, 3.8) if maps else (6.4, 4.0)
    figure = NotebookFigure(figsize=size, layout="constrained")
    if maps:
        for panel, name in zip(figure.subplots(1, len(names), squeeze=False).flat, names, strict=True):
            _map(panel, rows[rows["resource"] == name], varied, measure, name)
    else:
        _lines(figure.add_subplot(), rows, varied[0], measure, names)
    return figure


def _map(panel: Axes, rows: pd.DataFrame, varied: list[str], measure: str, name: str) -> None:
    title, unit, factor = shown_measure(measure)
    around = factor if measure in AROUND_CAPACITY else None
    cells = rows.rename(columns={"mean": title})
    heat_map(panel, cells, varied[1], varied[0], title, units={title: unit}, middle=around)
    panel.set_title(plain(name), loc="left", fontsize="medium")


def _lines(panel: Axes, rows: pd.DataFrame, axis: str, measure: str, names: list[str]) -> None:
    numbers = is_numeric_dtype(rows[axis]) and rows[axis].dtype != bool
    for j, name in enumerate(names):
        own = rows[rows["resource"] == name]
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
    panel.legend(frameon=False, fontsize="small")
