"""One figure about a run, and any single panel as a figure of its own."""

import inspect
from collections.abc import Callable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import allocations, capacity, channel, convergence, errors, score, signals, tracking
from aimd_des.plots.style import NotebookFigure, plain, shared_legend
from aimd_des.results.result import Result
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

_OVERVIEW = "overview"
_SIZE, _WIDE = (6.0, 3.6), (9.6, 6.8)  # inches
# Swings of the sawtooth to be told apart in the panel of total demand.
_SWINGS = 12

# Every panel that draws one run.
_PANELS: dict[str, Callable[..., Axes]] = {
    panel.__name__: panel
    for panel in (
        allocations.average_allocations,
        allocations.instantaneous_allocations,
        allocations.derivatives,
        capacity.sum_of_averages,
        capacity.sum_of_demand,
        capacity.capacity_events,
        convergence.averages_against_optimum,
        convergence.consensus,
        convergence.error_decay,
        channel.copies,
        channel.latencies,
        errors.absolute_error,
        errors.relative_error,
        errors.cost_ratio,
        errors.error_histogram,
        score.score,
        score.agent_timeline,
        signals.demand_and_signals,
        signals.signal_raster,
        tracking.tracking_error,
        tracking.tracking_level,
    )
}


def overview(result: Result) -> Figure:
    """Draw what matters of a run in four panels.

    Parameters
    ----------
    result : Result
        The run, best recorded with ``Recording("auto", "auto")``: a panel for which too little was recorded
        says so.

    Returns
    -------
    Figure
        Total demand at the end with its signals, the sum of the averages, capacity events, and the
        misallocation over time.
    """
    figure = NotebookFigure(figsize=_WIDE, layout="constrained")
    sent = result.signals_sent.time
    start = float(sent[-_SWINGS]) if len(sent) >= _SWINGS else 0.0
    panels: list[tuple[str, Callable[[Axes], Axes]]] = [
        ("Total demand", lambda axes: signals.demand_and_signals(axes, result, start=start)),
        ("Sum of the averages", lambda axes: capacity.sum_of_averages(axes, result)),
        ("Capacity events", lambda axes: capacity.capacity_events(axes, result)),
        ("Misallocation", lambda axes: convergence.error_decay(axes, result)),
    ]
    for place, (title, draw) in enumerate(panels, start=1):
        axes = figure.add_subplot(2, 2, place)
        draw(axes)
        axes.set_title(plain(title), loc="left", fontsize="medium")
    shared_legend(figure)
    return figure


def plot_result(result: Result, kind: str = _OVERVIEW, **options: Any) -> Figure:
    """Draw one figure of a run, by the name of what it shows."""
    validation.known("kind", kind, (_OVERVIEW, *_PANELS))
    if kind == _OVERVIEW:
        _check_options(kind, options, overview)
        return overview(result)
    panel = _PANELS[kind]
    _check_options(kind, options, panel)
    figure = NotebookFigure(figsize=_SIZE, layout="constrained")
    # Panels that hold averages against one optimum take the one in force for None.
    given = {"optimum": None} if "optimum" in inspect.signature(panel).parameters else {}
    panel(figure.add_subplot(), result, **{**given, **options})
    shared_legend(figure)
    return figure


def _check_options(kind: str, options: dict[str, Any], function: Callable[..., Any]) -> None:
    """Refuse options that a kind does not take, and name those that it needs."""
    taken = inspect.signature(function).parameters
    known = [name for name in taken if name not in ("axes", "result", "results")]
    for name in options:
        validation.known(f"option of plot({kind!r})", name, known, f"one of {', '.join(known) or 'none'}")
    for name in known:
        if taken[name].default is inspect.Parameter.empty and name not in ("optimum", *options):
            raise InputError(f"plot({kind!r}): needs {name}; give it, as in plot({kind!r}, {name}=0)")
