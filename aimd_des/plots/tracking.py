"""How a run follows an optimum that moves, from one intervention to the next."""

from matplotlib.axes import Axes

from aimd_des.plots import style
from aimd_des.plots.allocations import NOT_RECORDED
from aimd_des.plots.in_force import NEVER
from aimd_des.plots.panel import panel
from aimd_des.results.result import Result


@panel
def tracking_error(axes: Axes, result: Result) -> Axes:
    """Draw how far the averages are from the optimum that is in force, through all interventions.

    Dotted lines stand where the problem changes, and with it the optimum.
    """
    axes.set_ylabel(style.axis_label("relative error", "share of the optimum in force"))
    if not _draw(axes, result, "relative_error"):
        return style.note(axes, NOT_RECORDED)
    if result.tracking["relative_error"].isna().all():
        return style.note(axes, NEVER)
    axes.set_yscale("log")
    style.name_resources(axes, result.problem)
    return _finish(axes, result)


@panel
def tracking_level(axes: Axes, result: Result) -> Axes:
    """Draw how much of the capacity in force the averages use, through all interventions."""
    axes.set_ylabel(style.axis_label("sum of averages", "share of the capacity in force"))
    if not _draw(axes, result, "level"):
        return style.note(axes, NOT_RECORDED)
    axes.axhline(1.0, color=style.REFERENCE, linewidth=1.2, linestyle="--")
    style.name_resources(axes, result.problem, "capacity")
    axes.set_ylim(bottom=0.0)
    return _finish(axes, result)


def _draw(axes: Axes, result: Result, column: str) -> bool:
    """Draw a column of `Result.tracking` for each resource; nothing where there is too little."""
    if len(result.observations.allocation_times) < 2:
        return False
    frame = result.tracking
    for j, name in enumerate(result.problem.resource_names):
        rows = frame[(frame["resource"] == name) & (frame["time"] > 0.0)]
        look = style.marked(j, len(rows), 2 * j)
        axes.plot(rows["time"], rows[column], color=style.colour(j), linewidth=1.5, **look)
    return True


def _finish(axes: Axes, result: Result) -> Axes:
    """Mark the pieces and dress the axes."""
    for piece in result.history[1:]:
        axes.axvline(piece.start, color=style.REFERENCE, linewidth=0.9, linestyle=":")
    if len(result.history) > 1:
        axes.plot([], [], ":", color=style.REFERENCE, linewidth=1.2, label="the problem changes")
    axes.set_xlim(0.0, result.until)
    style.number_axis(axes.yaxis, percent=True)
    style.time_axis(axes, result)
    return axes
