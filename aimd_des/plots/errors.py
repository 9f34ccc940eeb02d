"""How far a run is from the optimum."""

import numpy as np
from matplotlib.axes import Axes

from aimd_des.plots import selection, style, units
from aimd_des.plots.allocations import NOT_RECORDED
from aimd_des.plots.expected import check_expected, draw_expected
from aimd_des.plots.in_force import NEVER, NOBODY, Observation, measured
from aimd_des.plots.panel import panel
from aimd_des.problem.lookup import resource_index
from aimd_des.problem.optimum import Optimum
from aimd_des.results import metrics
from aimd_des.results.looks import looks
from aimd_des.results.result import Result
from aimd_des.theory import Convergence
from aimd_des.utils import formatting
from aimd_des.utils.validation import FloatArray

_BINS = 20
_BAND_LOOKS = 60
_FEW_OPTIMA = 20


@panel
def absolute_error(axes: Axes, result: Result, optimum: Optimum | None = None) -> Axes:
    """Draw how the distance of the averages from the optimum evolves.

    For each resource the median over all agents as a line, with a band up to the distance below
    which 95 % of the agents lie.
    """
    scale, seen = units.scale_for_agents(result.problem), result.observations
    axes.set_ylabel(style.axis_label("|average − optimum|", scale.unit))
    shown = selection.few_looks(result)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    m = result.problem.n_resources
    quantiles = measured(result, shown, optimum, _quantiles, 2, m) / scale.divisor
    if np.isnan(quantiles).all():
        return style.note(axes, NEVER)
    for j in range(m):
        middle, high = quantiles[:, :, j].T
        axes.fill_between(times, middle, high, color=style.colour(j), alpha=0.18, linewidth=0.0)
        look = style.marked(j, len(times), 2 * j)
        axes.plot(times, middle, color=style.colour(j), linewidth=1.6, **look)
    axes.set_yscale("log")
    style.name_resources(axes, result.problem)
    meaning = "median to 95 % of the agents"
    axes.fill_between([], [], [], color=style.REFERENCE, alpha=0.25, linewidth=0.0, label=meaning)
    axes.set_xlim(times[0], times[-1])
    style.number_axis(axes.yaxis)
    style.time_axis(axes, result, log=True)
    return axes


@panel
def relative_error(
    axes: Axes, result: Result, optimum: Optimum | None = None, *, expected: Convergence | None = None
) -> Axes:
    """Draw how the relative error of each resource evolves.

    Parameters
    ----------
    expected : Convergence, optional
        What theory says, such as `Simulation.convergence`: the error in the mean over runs as a
        dash-dotted line, and the band of `Convergence.relative_error`.

    Raises
    ------
    InputError
        If `expected` is of other resources.
    """
    seen = result.observations
    check_expected(expected, result)
    axes.set_ylabel("relative error")
    shown = selection.few_looks(result)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    m = result.problem.n_resources
    error = measured(result, shown, optimum, _error, m)
    if np.isnan(error).all():
        return style.note(axes, NEVER)
    for j in range(m):
        look = style.marked(j, len(times), 2 * j)
        axes.plot(times, error[:, j], color=style.colour(j), linewidth=1.6, **look)
    axes.set_yscale("log")
    style.number_axis(axes.yaxis, percent=True)
    style.name_resources(axes, result.problem)
    if expected is not None:
        at = times[looks(times, _BAND_LOOKS, log=True)]
        draw_expected(axes, at, expected.relative_error(at))
    axes.set_xlim(times[0], times[-1])
    style.time_axis(axes, result, log=True)
    return axes


@panel
def cost_ratio(axes: Axes, result: Result, optimum: Optimum | None = None) -> Axes:
    """Draw how the total cost of the averages, over that of the optimum, evolves.

    It is below 1 where the averages do not use up the capacities; the dotted line is what the same totals
    would cost at best.
    """
    seen = result.observations
    axes.set_ylabel("total cost / optimal cost")
    shown = selection.few_looks(result)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    ratio = measured(result, shown, optimum, _cost)
    at_end = NOBODY if np.isnan(ratio[-1]) else f"total cost, {ratio[-1]:.3f} at the end"
    axes.plot(times, ratio, color="black", linewidth=1.6, label=at_end)
    axes.axhline(1.0, color=style.REFERENCE, linewidth=1.2, linestyle="--", label="optimum")
    few = shown[looks(times, _FEW_OPTIMA, log=True)]
    used = measured(result, few, optimum, _cost_for_used)
    label = "optimum for what is used"
    axes.plot(seen.allocation_times[few], used, ":", color=style.REFERENCE, linewidth=1.4, label=label)
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    style.time_axis(axes, result, log=True)
    return axes


@panel
def error_histogram(axes: Axes, result: Result, optimum: Optimum | None, resource: str | int) -> Axes:
    """Draw how many agents end how far from their optimal allocation of one resource.

    Parameters
    ----------
    result : Result
        The run.
    """
    resource = resource_index(result.problem, resource)
    shared, last = result.problem.resources[resource], result.history[-1]
    axes.set_xlabel(style.plain(f"|average − optimum| of {style.resource_label(shared)}"))
    axes.set_ylabel("number of agents")
    found = result.optimum_of(last, optimum)
    if found is None:
        return style.note(axes, NOBODY)
    best = found.allocation[:, resource]
    error = np.abs(result.average_at_end[last.present, resource] - best)
    widest = float(error.max()) or 1.0
    count, _, _ = axes.hist(
        error, bins=_BINS, range=(0.0, widest), color=style.colour(resource), edgecolor="white", linewidth=0.5
    )
    mean = float(error.mean())
    axes.axvline(mean, ymax=0.86, color=style.REFERENCE, linewidth=1.2, linestyle="--")
    axes.text(
        0.98,
        0.97,
        f"dashed: mean, {formatting.percent(mean / best.mean(), decimals=1)} of the mean optimum",
        transform=axes.transAxes,
        ha="right",
        va="top",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )
    axes.set_ylim(0.0, 1.15 * float(np.max(count)))  # room for the text
    axes.set_xlim(0.0, widest * 1.03)
    style.number_axis(axes.xaxis)
    style.number_axis(axes.yaxis, whole=True)
    style.frame(axes)
    return axes


def _quantiles(look: Observation) -> FloatArray:
    return np.asarray(np.quantile(np.abs(look.average - look.best.allocation), (0.5, 0.95), axis=0))


def _error(look: Observation) -> FloatArray:
    return metrics.relative_error(look.average, look.best.allocation)


def _cost_for_used(look: Observation) -> float:
    best = look.for_used
    if best is None:
        return float("nan")
    return metrics.cost_ratio(look.problem.costs, best.allocation, look.best.allocation)


def _cost(look: Observation) -> float:
    return metrics.cost_ratio(look.problem.costs, look.average, look.best.allocation)
