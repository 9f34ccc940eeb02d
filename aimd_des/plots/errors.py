"""How far a run is from the optimum."""

import numpy as np
from matplotlib.axes import Axes

from aimd_des import metrics
from aimd_des.optimum import Optimum
from aimd_des.plots import selection, style, units
from aimd_des.plots.allocations import NOT_RECORDED
from aimd_des.results import Result

__all__ = ["absolute_error", "cost_ratio", "error_histogram", "relative_error"]

# How many numbers the panels over time may look at: with very many agents, fewer looks are drawn.
_BUDGET = 10_000_000
_MOST_LOOKS = 200
_FEWEST_LOOKS = 12
_BINS = 20


def _curve_points(result: Result) -> int:
    size = result.problem.n_agents * result.problem.n_resources
    return int(np.clip(_BUDGET // size, _FEWEST_LOOKS, _MOST_LOOKS))


def absolute_error(axes: Axes, result: Result, optimum: Optimum) -> Axes:
    """Draw how the distance of the averages from the optimum evolves.

    For each resource the median over all agents as a line, with a band up to the distance below
    which 95 % of the agents lie.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    optimum : Optimum
        What its averages are held against.

    Returns
    -------
    Axes
        The same axes.
    """
    scale, seen = units.scale_for_agents(result.problem), result.observations
    axes.set_ylabel(style.axis_label("|average − optimum|", scale.unit))
    shown = selection.looks(seen.allocation_times, _curve_points(result), log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    for j in range(result.problem.n_resources):
        best = optimum.allocation[:, j]
        quantiles = np.array(
            [np.quantile(np.abs(seen.average[look, j] - best), (0.5, 0.95)) for look in shown]
        )
        middle, high = quantiles.T / scale.divisor[j]
        axes.fill_between(times, middle, high, color=style.colour(j), alpha=0.18, linewidth=0.0)
        axes.plot(times, middle, color=style.colour(j), linewidth=1.6)
    axes.set_yscale("log")
    style.name_resources(axes, result.problem)
    meaning = "median to 95 % of the agents"
    axes.fill_between([], [], [], color=style.REFERENCE, alpha=0.25, linewidth=0.0, label=meaning)
    axes.set_xlim(times[0], times[-1])
    style.number_axis(axes.yaxis)
    style.time_axis(axes, result, log=True)
    return axes


def relative_error(axes: Axes, result: Result, optimum: Optimum) -> Axes:
    """Draw how the relative error of each resource evolves.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    optimum : Optimum
        What its averages are held against.

    Returns
    -------
    Axes
        The same axes.
    """
    seen = result.observations
    axes.set_ylabel("relative error")
    shown = selection.looks(seen.allocation_times, _curve_points(result), log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    error = np.array([metrics.relative_error(seen.average[look].T, optimum.allocation) for look in shown])
    for j in range(result.problem.n_resources):
        axes.plot(times, error[:, j], color=style.colour(j), linewidth=1.6)
    axes.set_yscale("log")
    style.number_axis(axes.yaxis, percent=True)
    style.name_resources(axes, result.problem)
    axes.set_xlim(times[0], times[-1])
    style.time_axis(axes, result, log=True)
    return axes


def cost_ratio(axes: Axes, result: Result, optimum: Optimum) -> Axes:
    """Draw how the total cost of the averages, over that of the optimum, evolves.

    It is below 1 where the averages do not use up the capacities.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    optimum : Optimum
        What its averages are held against.

    Returns
    -------
    Axes
        The same axes.
    """
    costs, seen = result.problem.costs, result.observations
    axes.set_ylabel("total cost / optimal cost")
    shown = selection.looks(seen.allocation_times, _curve_points(result), log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    ratio = [metrics.cost_ratio(costs, seen.average[look].T, optimum.allocation) for look in shown]
    axes.plot(times, ratio, color="black", linewidth=1.6, label=f"total cost, {ratio[-1]:.3f} at the end")
    axes.axhline(1.0, color=style.REFERENCE, linewidth=1.2, linestyle="--", label="optimum")
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    style.time_axis(axes, result, log=True)
    return axes


def error_histogram(axes: Axes, result: Result, optimum: Optimum, resource: int) -> Axes:
    """Draw how many agents end how far from their optimal allocation of one resource.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run.
    optimum : Optimum
        What its averages are held against.
    resource : int
        j, counted from 0.

    Returns
    -------
    Axes
        The same axes.
    """
    shared = result.problem.resources[resource]
    best = optimum.allocation[:, resource]
    error = np.abs(result.average_at_end[:, resource] - best)
    widest = float(error.max()) or 1.0
    count, _, _ = axes.hist(
        error, bins=_BINS, range=(0.0, widest), color=style.colour(resource), edgecolor="white", linewidth=0.5
    )
    mean = float(error.mean())
    axes.axvline(mean, ymax=0.86, color=style.REFERENCE, linewidth=1.2, linestyle="--")
    axes.text(
        0.98,
        0.97,
        f"dashed: mean, {100 * mean / best.mean():.1f} % of the mean optimum",
        transform=axes.transAxes,
        ha="right",
        va="top",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )
    axes.set_ylim(0.0, 1.15 * float(np.max(count)))  # room for the text
    axes.set_xlabel(f"|average − optimum| of {style.resource_label(shared)}")
    axes.set_ylabel("number of agents")
    axes.set_xlim(0.0, widest * 1.03)
    style.number_axis(axes.xaxis)
    style.number_axis(axes.yaxis, whole=True)
    style.frame(axes)
    return axes
