"""What all panels look like: colours, labels, axes, legends."""

from io import BytesIO
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from aimd_des.problem.problem import Problem, Resource
from aimd_des.results.result import Result
from aimd_des.utils import formatting
from aimd_des.utils.colours import COLOURS

#: Grey of what is held against the curves: optimum and capacity.
REFERENCE = "0.35"

_LONGEST_LABEL = 28
_DPI = 160
_UNDATED: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
# Resources differ by their marks, too: not all readers tell colours apart, and print does not.
_MARKS = "os^Dv<>"


def colour(resource: int) -> str:
    """Give the colour of a resource.

    Parameters
    ----------
    resource : int
        j, counted from 0.

    Returns
    -------
    str
        The same in all panels; they repeat after seven.
    """
    return COLOURS[resource % len(COLOURS)]


def mark(resource: int) -> str:
    """Give the mark of a resource; they repeat after seven."""
    return _MARKS[resource % len(_MARKS)]


def marked(resource: int, count: int, first: int) -> dict[str, Any]:
    """Give the mark of a resource to some of so many points of a curve: of several curves to others."""
    every = max(count // 7, 1)
    return {"marker": mark(resource), "markevery": (min(first, count - 1), every), "markersize": 4.5}


def plain(text: str) -> str:
    """Write a text so that it is drawn unchanged, with dollar signs that begin no formula."""
    shown = text.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def axis_label(what: str, unit: str) -> str:
    """Compose the label of an axis."""
    if not unit:
        return plain(what)
    gap = " " if len(what) + len(unit) <= _LONGEST_LABEL else "\n"
    return plain(f"{what}{gap}({unit})")


def resource_label(resource: Resource) -> str:
    """Name a resource together with its unit."""
    return f"{resource.name} ({resource.unit})" if resource.unit else resource.name


def name_resources(axes: Axes, problem: Problem, reference: str = "") -> None:
    """Put the resources, and what the dashed lines mean, into the legend of these axes."""
    for j, resource in enumerate(problem.resources):
        look: dict[str, Any] = {"color": colour(j), "linewidth": 2.0, "marker": mark(j), "markersize": 5.0}
        axes.plot([], [], label=plain(resource_label(resource)), **look)
    if reference:
        axes.plot([], [], "--", color=REFERENCE, linewidth=1.2, label=reference)


def shared_legend(figure: Figure) -> Legend | None:
    """Put one legend below the panels, with each entry of theirs once.

    Parameters
    ----------
    figure : Figure
        Laid out with ``layout="constrained"``.

    Returns
    -------
    Legend or None
        None where no panel has anything to name.
    """
    entries: dict[str, Artist] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            entries.setdefault(str(label), handle)
    if not entries:
        return None
    # About fourteen letters an inch, ten of them for the handle; else rows of equal length.
    letters = sum(len(label) + 10 for label in entries)
    rows = int(np.ceil(letters / (14 * figure.get_figwidth())))
    return figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=-(-len(entries) // rows),
        frameon=False,
        handlelength=1.8,
    )


def _number(value: float, _position: int | None = None) -> str:
    return formatting.grouped(value, 10)


def _percent(share: float, _position: int | None = None) -> str:
    return formatting.percent(share, 10)


class NotebookFigure(Figure):
    """A figure that notebooks show as a picture without pyplot."""

    def _repr_png_(self) -> bytes:
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


def picture_of(figure: Figure, form: str) -> bytes:
    """Write a figure as the content of a file, the same for the same figure."""
    picture = BytesIO()
    # Fonts of type 3, which Matplotlib embeds by default, are refused by publishers' checks of PDF files.
    with rc_context({"pdf.fonttype": 42}):
        figure.savefig(picture, format=form, dpi=_DPI, metadata=_UNDATED.get(form))
    return picture.getvalue()


def number_axis(axis: Axis, *, percent: bool = False, whole: bool = False) -> None:
    """Let an axis show plain numbers with grouped digits, at 1, 2 and 5 where it is logarithmic and short.

    Parameters
    ----------
    axis : Axis
        The x or y axis of a panel.
    percent : bool
        Whether numbers are shares, to be shown in percent.
    whole : bool
        Whether there are ticks at integers only.
    """
    if axis.get_scale() == "log":
        low, high = axis.get_view_interval()
        subs = (1.0,) if high / low > 200 else (1.0, 2.0, 5.0)
        axis.set_major_locator(LogLocator(10.0, subs=subs))
        axis.set_minor_formatter(NullFormatter())
    else:
        axis.set_major_locator(MaxNLocator(5, integer=whole, steps=[1, 2, 2.5, 5, 10]))
    axis.set_major_formatter(FuncFormatter(_percent if percent else _number))


def time_axis(axes: Axes, result: Result, *, log: bool = False) -> None:
    """Dress the axis of time, and the axes around it."""
    steps = result.dynamics == "discrete"
    axes.set_xlabel("time step" if steps else "time")
    if log:
        axes.set_xscale("log")
    number_axis(axes.xaxis, whole=steps)
    frame(axes)


def colour_bar(axes: Axes, drawn: ScalarMappable, label: str) -> None:
    """Put a colour bar beside axes, from which it takes some room."""
    bar = axes.figure.colorbar(drawn, ax=axes, label=label)
    bar.outline.set_visible(False)


def frame(axes: Axes) -> None:
    """Give axes the light grid and the open frame that all panels have.

    Parameters
    ----------
    axes : Axes
        The panel.
    """
    axes.grid(visible=True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def note(axes: Axes, text: str) -> Axes:
    """Say in the axes why nothing is drawn."""
    axes.text(
        0.5,
        0.5,
        plain(text),
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize="small",
        color=REFERENCE,
    )
    axes.set_xticks([])
    axes.set_yticks([])
    frame(axes)
    return axes
