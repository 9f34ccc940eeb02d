"""What agents hold: averages, instantaneous demand, and the derivatives that should agree."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from aimd_des.checks import FloatArray
from aimd_des.optimum import Optimum
from aimd_des.plots import selection, style, units
from aimd_des.results import Result

__all__ = ["average_allocations", "derivatives", "instantaneous_allocations"]

_CURVE_POINTS = 400
_BARS = 12
_MOST_CURVES = 9

NOT_RECORDED = (
    "Too little of the run was recorded.\nRecord the allocations over time to see this panel:\n"
    'Recording(allocations="auto", tail=100)'
)


def average_allocations(
    axes: Axes,
    result: Result,
    optimum: Optimum | None = None,
    *,
    agents: npt.ArrayLike | None = None,
) -> Axes:
    """Draw how the long-term averages of some agents evolve.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    optimum : Optimum, optional
        Its optimal allocations are drawn as dashed lines.
    agents : array_like of int, shape (q,), optional
        Which agents, the same for all resources; unless given, three for each resource (fewer for
        more than three resources), spread over the ranks of what they hold.

    Returns
    -------
    Axes
        The same axes.
    """
    scale = units.scale_for_agents(result.problem)
    axes.set_ylabel(style.axis_label("average allocation", scale.unit))
    seen = result.observations
    shown = selection.looks(seen.allocation_times, _CURVE_POINTS, log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    for j, chosen in enumerate(_chosen(result, agents, _agents_each(result))):
        for i in chosen:
            # Row by row: an array of all looks of all agents can be larger than the memory left.
            curve = seen.average[shown, j, i] / scale.divisor[j]
            axes.plot(times, curve, color=style.colour(j), linewidth=1.4)
            if optimum is not None:
                level = optimum.allocation[i, j] / scale.divisor[j]
                axes.axhline(level, color=style.colour(j), linewidth=1.0, linestyle="--", alpha=0.8)
    style.name_resources(axes, result.problem, "" if optimum is None else "optimum")
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    style.time_axis(axes, result, log=True)
    return axes


def instantaneous_allocations(
    axes: Axes, result: Result, *, last: int = 100, agents: npt.ArrayLike | None = None
) -> Axes:
    """Draw what some agents demand over the last units of time.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with a tail of at least `last` recorded.
    last : int
        How many units of time; where the recording has too few looks there, the last of its
        looks, whenever they were.
    agents : array_like of int, shape (q,), optional
        Which agents, the same for all resources; unless given, for each resource the agent in
        the middle.

    Returns
    -------
    Axes
        The same axes.
    """
    scale = units.scale_for_agents(result.problem)
    axes.set_ylabel(style.axis_label("instantaneous allocation", scale.unit))
    seen = result.observations
    shown = selection.window(seen.allocation_times, last)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    # Dots alone where steps lie between looks: a line would invent what happened there.
    form = "-" if np.diff(times).max() <= 1.0 else "."
    for j, chosen in enumerate(_chosen(result, agents, 1)):
        for i in chosen:
            curve = seen.demand[shown, j, i] / scale.divisor[j]
            axes.plot(times, curve, form, color=style.colour(j), linewidth=1.2, markersize=3.0)
    style.name_resources(axes, result.problem)
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    style.time_axis(axes, result)
    return axes


def derivatives(axes: Axes, result: Result, optimum: Optimum | None = None) -> Axes:
    """Draw mean and standard deviation, across all agents, of the derivatives of their costs.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    optimum : Optimum, optional
        Its multipliers, which all derivatives equal at the optimum, are drawn as dashed lines.

    Returns
    -------
    Axes
        The same axes.
    """
    problem, seen = result.problem, result.observations
    unit = units.units_of(problem, "unit as in the legend")
    axes.set_ylabel(style.axis_label("derivative of cost", unit and f"per {unit}"))
    shown = selection.looks(seen.allocation_times, _BARS, log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    gradient = [problem.costs.gradient(seen.average[look].T) for look in shown]
    mean = np.array([page.mean(axis=0) for page in gradient])
    spread = np.array([page.std(axis=0) for page in gradient])
    _error_bars(axes, times, mean, spread)
    if units.comparable(mean[-1]):
        axes.set_ylim(bottom=0.0)
    else:
        axes.set_yscale("log", nonpositive="clip")
    if optimum is not None:
        for j, level in enumerate(optimum.multipliers):
            axes.axhline(level, color=style.colour(j), linewidth=1.0, linestyle="--", alpha=0.8)
    style.name_resources(axes, problem, "" if optimum is None else "optimum")
    style.time_axis(axes, result, log=True)
    return axes


def _error_bars(axes: Axes, times: FloatArray, mean: FloatArray, spread: FloatArray) -> None:
    """Draw the bars of the resources side by side: on top of each other they cannot be told apart."""
    m = mean.shape[1]
    step = (times[-1] / times[0]) ** (1.0 / len(times))
    for j in range(m):
        beside = times * step ** (0.4 * (j - (m - 1) / 2) / m)
        axes.errorbar(
            beside,
            mean[:, j],
            spread[:, j],
            color=style.colour(j),
            linewidth=1.0,
            marker="o",
            markersize=3.0,
            capsize=2.5,
        )


def _agents_each(result: Result) -> int:
    """How many agents for each resource can be told apart in one panel."""
    return int(np.clip(_MOST_CURVES // result.problem.n_resources, 1, 3))


def _chosen(result: Result, agents: npt.ArrayLike | None, count: int) -> npt.NDArray[np.intp]:
    """Which agents to draw for each resource, shape (m, q)."""
    if agents is None:
        return selection.typical_agents(result, count)
    wanted = np.atleast_1d(np.asarray(agents, dtype=np.intp))
    return np.tile(wanted, (result.problem.n_resources, 1))
