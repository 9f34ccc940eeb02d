"""Studies over two axes: a map of one measure, with what theory says about where it changes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import QuadMesh
from matplotlib.colors import CenteredNorm, LogNorm, Normalize, TwoSlopeNorm

from aimd_des.plots import style
from aimd_des.plots.panel import panel
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_MOST_NUMBERS = 120
_MOST_TICKS = 12
# Both can be told apart by people who see colours differently, and in grey.
_SEQUENTIAL, _DIVERGING = "cividis", "PuOr_r"
_MISSING = "0.9"


@panel
def heat_map(
    axes: Axes,
    frame: pd.DataFrame,
    x: str,
    y: str,
    value: str,
    *,
    units: Mapping[str, str] | None = None,
    middle: float | None = None,
    norm: Normalize | None = None,
    boundary: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    boundary_label: str = "theory",
) -> Axes:
    """Draw a measure over two axes of a study, one cell for each pair of values.

    All cells are equally large, for any steps between values; ticks are the values.  A cell with
    several rows, such as replications, shows their mean, and one without a number is hatched.

    Parameters
    ----------
    axes : Axes
        Where to draw; the colour bar takes some of its room.
    frame : DataFrame
        Tidy: a row for each run.
    x, y : str
        The columns of the two axes.
    value : str
        The column to show.
    units : mapping of str to str, optional
        Of the columns, for the labels; what has none needs none.
    middle : float, optional
        A value that parts good from bad, such as 1 for demand over capacity: colours then diverge from it.
    norm : Normalize, optional
        How values become colours, for maps that shall be compared.  Such a map has no colour bar of its own;
        what lies below a logarithmic norm has its least colour.
    boundary : pair of array_like, optional
        x and y along a curve of theory; placed between cells by linear interpolation.
    boundary_label : str
        What the curve is, for the legend.

    Raises
    ------
    InputError
        If a column is missing, the values are no numbers, or a curve is to be drawn over an axis of words.
    """
    for name in (x, y, value):
        if name not in frame.columns:
            raise InputError.of("column", name, f"one of {', '.join(map(repr, frame.columns))}")
    if not pd.api.types.is_numeric_dtype(frame[value]):
        raise InputError.of("value", value, f"a column of numbers, not of {frame[value].dtype}")
    if norm is not None and not isinstance(norm, Normalize):
        raise InputError.of("norm", norm, "a norm of matplotlib.colors, such as Normalize(0.0, 1.0)")
    x_label, y_label, value_label = (
        style.axis_label(name.replace("_", " "), (units or {}).get(name, "")) for name in (x, y, value)
    )
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    if frame.empty:
        return style.note(axes, "There is no run in this frame.")
    cells = frame.groupby([y, x], observed=True)[value].mean().unstack(x)  # noqa: PD010 - a table is wanted
    table = cells.to_numpy(dtype=np.float64)
    least = norm.vmin if isinstance(norm, LogNorm) else None
    seen = table if least is None else np.maximum(table, least)
    drawn = _draw_cells(axes, seen, _norm(middle) if norm is None else norm)
    _name_cells(axes.xaxis, cells.columns)
    _name_cells(axes.yaxis, cells.index)
    if table.size <= _MOST_NUMBERS:
        _write_numbers(axes, table, drawn.to_rgba(seen))
    if boundary is not None:
        _draw_boundary(axes, cells, boundary, boundary_label)
    if norm is None:
        style.colour_bar(axes, drawn, value_label)
    axes.set_xlim(-0.5, table.shape[1] - 0.5)
    axes.set_ylim(-0.5, table.shape[0] - 0.5)
    return axes


def _norm(middle: float | None) -> Normalize:
    return Normalize() if middle is None else CenteredNorm(vcenter=validation.number("middle", middle))


def _draw_cells(axes: Axes, table: FloatArray, norm: Normalize) -> QuadMesh:
    """Colour the cells; what is behind those without a number is hatched."""
    axes.patch.set(facecolor=_MISSING, hatch="///", edgecolor="0.7")
    diverging = isinstance(norm, CenteredNorm | TwoSlopeNorm)
    rows, columns = table.shape
    return axes.pcolormesh(
        np.arange(columns + 1) - 0.5,
        np.arange(rows + 1) - 0.5,
        np.ma.masked_invalid(table),
        cmap=_DIVERGING if diverging else _SEQUENTIAL,
        norm=norm,
        edgecolors="white",
        linewidth=0.6,
    )


def _name_cells(axis: Axis, values: "pd.Index[Any]") -> None:
    """Let the ticks say which values the cells stand for."""
    places = np.arange(0, len(values), -(-len(values) // _MOST_TICKS))
    numbers = pd.api.types.is_numeric_dtype(values)
    axis.set_ticks(places, [f"{value:g}" if numbers else style.plain(str(value)) for value in values[places]])


def _write_numbers(axes: Axes, table: FloatArray, colours: FloatArray) -> None:
    """Write the values into the cells, in black or white, for contrast."""
    size = "small" if table.shape[1] <= 8 else "x-small"
    for (row, column), number in np.ndenumerate(table):
        if np.isfinite(number):
            # Weights of red, green and blue in what the eye sees as bright.
            bright = float(np.dot(colours[row, column, :3], (0.299, 0.587, 0.114)))
            shade, halo = ("black", "white") if bright > 0.5 else ("white", "black")
            text = axes.text(column, row, f"{number:.3g}", ha="center", va="center", fontsize=size, zorder=3)
            text.set(color=shade, path_effects=[patheffects.withStroke(linewidth=1.5, foreground=halo)])


def _draw_boundary(
    axes: Axes, cells: pd.DataFrame, boundary: tuple[npt.ArrayLike, npt.ArrayLike], label: str
) -> None:
    """Draw a curve over cells that are equally large."""
    placed = []
    for field, given, values in zip("xy", boundary, (cells.columns, cells.index), strict=True):
        if not pd.api.types.is_numeric_dtype(values):
            raise InputError.of(
                "boundary", f"a curve over {values.name!r}", "left out where an axis has words"
            )
        points = validation.array(f"boundary in {field}", given, ("n_points",))
        placed.append(_place(points, values.to_numpy(dtype=np.float64)))
    across, up = placed
    if across.shape != up.shape:
        raise InputError.of("boundary", (len(across), len(up)), "as many x as y")
    outline = [patheffects.withStroke(linewidth=4.0, foreground="white")]
    axes.plot(across, up, color="black", linewidth=2.0, zorder=2.5, path_effects=outline, label=label)


def _place(points: FloatArray, values: FloatArray) -> FloatArray:
    """Place numbers between the middles of cells; beyond the first and the last, by the step there."""
    places = np.arange(len(values), dtype=np.float64)
    inside = np.interp(points, values, places)
    if len(values) == 1:
        return inside
    below = (points - values[0]) / (values[1] - values[0])
    above = places[-1] + (points - values[-1]) / (values[-1] - values[-2])
    return np.where(points < values[0], below, np.where(points > values[-1], above, inside))
