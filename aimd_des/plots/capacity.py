"""Totals over all agents against the capacities, and the signals it takes."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from aimd_des.plots import selection, style, units
from aimd_des.plots.panel import panel
from aimd_des.results.looks import looks
from aimd_des.results.result import Result
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_CURVE_POINTS = 400
_COUNT_POINTS = 200

_NOT_RECORDED = (
    "Too little of the run was recorded.\nRecord the totals over time to see this panel:\n"
    'Recording(demand="auto", tail=100)'
)


def capacity_at(result: Result, resource: int, times: FloatArray) -> FloatArray:
    """Look up which capacity was in force."""
    starts = [piece.start for piece in result.history]
    levels = np.array([piece.capacity[resource] for piece in result.history])
    return np.asarray(levels[np.searchsorted(starts, times, side="right") - 1])


def capacity_line(
    axes: Axes, result: Result, resource: int, divisor: float, first: float, last: float
) -> None:
    """Draw the capacity in force as a dashed line, with a step where an intervention changes it."""
    changes = [piece.start for piece in result.history if first < piece.start < last]
    times = np.array([first, *changes, last])
    level = capacity_at(result, resource, times) / divisor
    axes.plot(
        times, level, "--", color=style.colour(resource), linewidth=1.0, alpha=0.8, drawstyle="steps-post"
    )


@panel
def sum_of_averages(axes: Axes, result: Result) -> Axes:
    """Draw how the sum of the averages of all agents evolves, with the capacities as dashed lines.

    Parameters
    ----------
    result : Result
        The run, with totals recorded over time.
    """
    seen = result.observations
    shown = looks(seen.demand_times, _CURVE_POINTS, log=True)
    return _totals(
        axes, result, "sum of averages", seen.demand_times[shown], seen.total_average[shown], log=True
    )


@panel
def sum_of_demand(axes: Axes, result: Result, *, last: int = 40) -> Axes:
    """Draw the sum of what all agents demand over the last units of time, with the capacities.

    Parameters
    ----------
    result : Result
        The run, with a tail of at least `last` recorded.
    last : int
        How many units of time; where the recording has too few samples there, its last samples, at any time.
    """
    seen = result.observations
    shown = selection.window(seen.demand_times, last)
    times = seen.demand_times[shown]
    dense = len(times) > 1 and bool(np.diff(times).max() <= 1.0)
    form = ".-" if dense else "."
    return _totals(axes, result, "sum of allocations", times, seen.total_demand[shown], form=form)


def _totals(
    axes: Axes,
    result: Result,
    what: str,
    times: FloatArray,
    totals: FloatArray,
    *,
    form: str = "-",
    log: bool = False,
) -> Axes:
    """Draw totals, shape (q, m), against the capacities."""
    problem, scale = result.problem, units.scale_for_totals(result.problem)
    axes.set_ylabel(style.axis_label(what, scale.unit))
    if len(times) < 2:
        return style.note(axes, _NOT_RECORDED)
    for j in range(problem.n_resources):
        capacity_line(axes, result, j, scale.divisor[j], times[0], times[-1])
        curve = totals[:, j] / scale.divisor[j]
        # Along the logarithm of time curves are smooth, and lie on each other.
        look = style.marked(j, len(times), 2 * j) if log else {"markersize": 4.0}
        axes.plot(times, curve, form, color=style.colour(j), linewidth=1.4, **look)
    style.name_resources(axes, problem, "capacity")
    axes.set_xlim(times[0], times[-1])
    if log:
        axes.set_ylim(bottom=0.0)
    style.number_axis(axes.yaxis)
    style.time_axis(axes, result, log=log)
    return axes


@panel
def capacity_events(axes: Axes, results: Result | Sequence[Result]) -> Axes:
    """Draw the number of capacity events over time, for one run or several.

    Parameters
    ----------
    results : Result or sequence of Result
        Runs with the same resources.  The first is drawn strong, the others faint.

    Raises
    ------
    InputError
        If there is no run, or their resources differ.
    """
    runs = [results] if isinstance(results, Result) else list(results)
    names = [run.problem.resource_names for run in runs]
    if not runs or len(set(names)) > 1:
        raise InputError.of("results", names, "one or more runs with the same resources")
    for place, run in reversed(list(enumerate(runs))):
        grid = np.linspace(0.0, run.until, _COUNT_POINTS)
        sent = run.signals_sent
        for j in range(run.problem.n_resources):
            count = np.searchsorted(sent.time[sent.resource == j], grid)
            width, alpha = (1.8, 1.0) if place == 0 else (0.6, 0.35)
            look = style.marked(j, len(grid), 9 * j) if place == 0 else {}
            axes.plot(grid, count, color=style.colour(j), linewidth=width, alpha=alpha, **look)
    axes.set_ylabel("number of capacity events")
    style.name_resources(axes, runs[0].problem)
    axes.set_xlim(0.0, max(run.until for run in runs))
    axes.set_ylim(bottom=0.0)
    style.number_axis(axes.yaxis, whole=True)
    style.time_axis(axes, runs[0])
    return axes
