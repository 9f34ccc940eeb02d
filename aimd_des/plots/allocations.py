"""What agents hold: averages, instantaneous demand, and the derivatives that should agree."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from aimd_des.plots import selection, style, units
from aimd_des.plots.in_force import NEVER, Observation, measured
from aimd_des.plots.panel import panel
from aimd_des.problem.lookup import agent_indices
from aimd_des.problem.optimum import Optimum
from aimd_des.results.looks import looks
from aimd_des.results.result import Result
from aimd_des.utils.validation import FloatArray

_CURVE_POINTS = 400
_BARS = 12
_MOST_CURVES = 9

NOT_RECORDED = (
    "Too little of the run was recorded.\nRecord the allocations over time to see this panel:\n"
    'Recording(allocations="auto", tail=100)'
)


@panel
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
    optimum : Optimum, optional
        What stands for the optimum of the problem at the end; default: the one in force at each time.
        What it gives these agents is drawn as dashed lines, which end where an agent is away.
    agents : array_like of str or int, shape (q,), optional
        Which agents, by name or index, the same for all resources; default: three for each resource (fewer
        for more than three resources), spread over the ranks of what they hold.
    """
    scale = units.scale_for_agents(result.problem)
    axes.set_ylabel(style.axis_label("average allocation", scale.unit))
    seen = result.observations
    shown = looks(seen.allocation_times, _CURVE_POINTS, log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    some, few = _chosen(result, agents, _agents_each(result)), selection.few_looks(result)
    levels = _levels(result, few, some, optimum)
    for j, chosen in enumerate(some):
        for place, i in enumerate(chosen):
            # Row by row: an array of all looks of all agents can be larger than the memory left.
            curve = seen.average[shown, j, i] / scale.divisor[j]
            look = style.marked(j, len(times), 9 * place + 3 * j)
            axes.plot(times, curve, color=style.colour(j), linewidth=1.4, **look)
            _reference(axes, seen.allocation_times[few], levels[:, j, place] / scale.divisor[j], j)
    style.name_resources(axes, result.problem, "optimum")
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    style.time_axis(axes, result, log=True)
    return axes


@panel
def instantaneous_allocations(
    axes: Axes, result: Result, *, last: int = 100, agents: npt.ArrayLike | None = None
) -> Axes:
    """Draw what some agents demand over the last units of time.

    Parameters
    ----------
    result : Result
        The run, with a tail of at least `last` recorded.
    last : int
        How many units of time; where the recording has too few samples there, its last samples, at any time.
    agents : array_like of str or int, shape (q,), optional
        Which agents, by name or index, the same for all resources; default: for each resource the agent in
        the middle.
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


@panel
def derivatives(axes: Axes, result: Result, optimum: Optimum | None = None) -> Axes:
    """Draw mean and standard deviation, across all agents, of the derivatives of their costs.

    Parameters
    ----------
    optimum : Optimum, optional
        What stands for the optimum of the problem at the end; default: the one in force at each time.
        Its multipliers, which all derivatives equal at the optimum, are drawn as dashed lines, and those of
        the optimum for what is used, to which derivatives go, as dotted ones.
    """
    problem, seen = result.problem, result.observations
    unit = units.units_of(problem, "unit as in the legend")
    axes.set_ylabel(style.axis_label("derivative of cost", unit and f"per {unit}"))
    shown = looks(seen.allocation_times, _BARS, log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    m = problem.n_resources
    mean, spread = np.moveaxis(measured(result, shown, None, _agreement, 2, m), 1, 0)
    known = mean[np.isfinite(mean).all(axis=1)]
    if not known.size:
        return style.note(axes, NEVER)
    _error_bars(axes, times, mean, spread)
    if units.comparable(known[-1]):
        axes.set_ylim(bottom=0.0)
    else:
        axes.set_yscale("log", nonpositive="clip")
    few = selection.few_looks(result)
    level = measured(result, few, optimum, lambda look: look.best.multipliers, m)
    used = measured(result, shown, optimum, _multipliers_for_used, m)
    for j in range(m):
        _reference(axes, seen.allocation_times[few], level[:, j], j)
        axes.plot(times, used[:, j], ":", color=style.colour(j), linewidth=1.4)
    style.name_resources(axes, problem, "optimum")
    axes.plot([], [], ":", color=style.REFERENCE, linewidth=1.4, label="optimum for what is used")
    style.time_axis(axes, result, log=True)
    return axes


def _multipliers_for_used(look: Observation) -> FloatArray:
    best = look.for_used
    return np.full(look.average.shape[1], np.nan) if best is None else best.multipliers


def _agreement(look: Observation) -> FloatArray:
    """Measure mean and spread of the derivatives: shape (2, m)."""
    gradient = look.problem.costs.gradient(look.average)
    return np.array([gradient.mean(axis=0), gradient.std(axis=0)])


def _levels(
    result: Result, shown: npt.NDArray[np.intp], agents: npt.NDArray[np.intp], optimum: Optimum | None
) -> FloatArray:
    """Say what agents, (m, q), should hold at some samples: shape (samples, m, q)."""

    def level(look: Observation) -> FloatArray:
        place = np.cumsum(look.present) - 1
        resource = np.arange(len(agents))[:, None]
        return np.where(look.present[agents], look.best.allocation[place[agents], resource], np.nan)

    return measured(result, shown, optimum, level, *agents.shape)


def _reference(axes: Axes, times: FloatArray, level: FloatArray, resource: int) -> None:
    """Draw what an optimum says as a dashed line, with a step where another one comes into force."""
    axes.plot(
        times, level, "--", color=style.colour(resource), linewidth=1.0, alpha=0.8, drawstyle="steps-post"
    )


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
            marker=style.mark(j),
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
    wanted = agent_indices(result.problem, np.ravel(agents).tolist())
    return np.tile(wanted, (result.problem.n_resources, 1))
