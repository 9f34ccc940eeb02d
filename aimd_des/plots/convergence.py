"""Whether a run comes to its optimum: shares agent by agent, agreement of derivatives, speed."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes

from aimd_des.plots import style
from aimd_des.plots.allocations import NOT_RECORDED
from aimd_des.plots.expected import check_expected, draw_expected
from aimd_des.plots.in_force import NEVER, NOBODY, Observation, measured
from aimd_des.plots.panel import panel
from aimd_des.problem.lookup import resource_index
from aimd_des.problem.optimum import Optimum
from aimd_des.results import metrics
from aimd_des.results.looks import looks
from aimd_des.results.misallocation import misallocation, optimum_for_used
from aimd_des.results.result import Result
from aimd_des.results.tracking import piece_problem
from aimd_des.theory import Convergence
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_BAND_LOOKS = 60
_DECAY_LOOKS = 30
_MEASURES = {"misallocation": "misallocation", "relative_error": "relative error"}


@panel
def averages_against_optimum(
    axes: Axes, result: Result, optimum: Optimum | None, resource: str | int
) -> Axes:
    """Draw what each agent holds on average at the end against what it should hold.

    On the line, an agent holds its optimal allocation; above it, more.

    Parameters
    ----------
    result : Result
        The run.
    optimum : Optimum or None
        The centralised solution, for the agents that are here at the end; None: the one in force.

    Raises
    ------
    InputError
        If there is no such resource, or the optimum is for another number of agents.
    """
    resource = resource_index(result.problem, resource)
    shared = result.problem.resources[resource]
    axes.set_xlabel(style.axis_label("optimal allocation", shared.unit))
    axes.set_ylabel(style.axis_label("average", shared.unit))
    last = result.history[-1]
    found = result.optimum_of(last, optimum if last.present.any() else None)
    if found is None:
        return style.note(axes, NOBODY)
    average, best = result.average_at_end[last.present, resource], found.allocation[:, resource]
    size = float(np.clip(2000.0 / len(best), 4.0, 30.0))
    mark = style.mark(resource)
    ink = style.colour(resource)
    axes.scatter(best, average, size, ink, marker=mark, alpha=0.8, linewidths=0.0)
    low, high = float(min(best.min(), average.min())), float(max(best.max(), average.max()))
    margin = 0.05 * (high - low) or 0.05 * high or 1.0
    ends = (low - margin, high + margin)
    axes.plot(ends, ends, "--", color=style.REFERENCE, linewidth=1.2, label="optimum")
    used = optimum_for_used(piece_problem(result.problem, last), result.average_at_end[last.present])
    if used is not None:
        order, label = np.argsort(best), "optimum for what is used"
        level = used.allocation[order, resource]
        axes.plot(best[order], level, ":", color=style.REFERENCE, linewidth=1.4, label=label)
    axes.plot(
        [],
        [],
        mark,
        color=style.colour(resource),
        markersize=4.5,
        label=style.plain(f"an agent's {shared.name}"),
    )
    axes.set_xlim(ends)
    axes.set_ylim(ends)
    axes.set_aspect("equal", adjustable="box")
    for axis in (axes.xaxis, axes.yaxis):
        style.number_axis(axis)
    style.frame(axes)
    return axes


@panel
def consensus(axes: Axes, result: Result, optimum: Optimum | None = None) -> Axes:
    """Draw how the derivatives of the private costs come to agree.

    For each resource the median over all agents as a line, with a band that holds nine tenths of them, in
    multiples of the optimal multiplier.  At the optimum, all are 1.
    """
    problem, seen = result.problem, result.observations
    axes.set_ylabel("derivative of cost\n(multiples of the optimal multiplier)")
    shown = looks(seen.allocation_times, _BAND_LOOKS, log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    times = seen.allocation_times[shown]
    low, middle, high = np.moveaxis(
        measured(result, shown, optimum, _agreement, 3, problem.n_resources), 1, 0
    )
    for j in range(problem.n_resources):
        axes.fill_between(times, low[:, j], high[:, j], color=style.colour(j), alpha=0.2, linewidth=0.0)
        look = style.marked(j, len(times), 2 * j)
        axes.plot(times, middle[:, j], color=style.colour(j), linewidth=1.6, **look)
    axes.axhline(1.0, color=style.REFERENCE, linewidth=1.2, linestyle="--")
    style.name_resources(axes, problem, "optimum")
    meaning = "5 to 95 % of the agents"
    axes.fill_between([], [], [], color=style.REFERENCE, alpha=0.25, linewidth=0.0, label=meaning)
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    style.number_axis(axes.yaxis)
    style.time_axis(axes, result, log=True)
    return axes


def _agreement(look: Observation) -> FloatArray:
    """Give quantiles of the derivatives in multiples of what they all should be: shape (3, m)."""
    gradient = look.problem.costs.gradient(look.average)
    return np.asarray(np.quantile(gradient, (0.05, 0.5, 0.95), axis=0) / look.best.multipliers)


@panel
def error_decay(
    axes: Axes,
    results: Result | Sequence[Result],
    *,
    measure: Literal["misallocation", "relative_error"] = "misallocation",
    slope: float = -0.5,
    expected: Convergence | None = None,
) -> Axes:
    """Draw how fast the error falls, on logarithmic axes, beside a line of a given slope.

    An average over independent pieces of time scatters like time to the power -1/2.  The misallocation falls
    so for long; the relative error ends at what is not used of the capacity.

    Parameters
    ----------
    results : Result or sequence of Result
        Runs of one problem, with allocations recorded at the same times; their errors are averaged.
    measure : {"misallocation", "relative_error"}
        Against the optimum for what is used, which is solved for at every look that is drawn, or against
        the one that is in force.
    slope : float
        Of the reference line.
    expected : Convergence, optional
        What theory says, such as `Simulation.convergence`: the measure in the mean over runs as a
        dash-dotted line, and the band that holds 95 % of them.

    Raises
    ------
    InputError
        If there is no run, their times differ, the measure is unknown, or `expected` is of other resources.
    """
    runs = [results] if isinstance(results, Result) else list(results)
    if measure not in _MEASURES:
        raise InputError.of("measure", measure, " or ".join(map(repr, _MEASURES)))
    validation.number("slope", slope)
    times = [run.observations.allocation_times for run in runs]
    if not runs or any(not np.array_equal(times[0], other) for other in times):
        raise InputError.of("results", len(runs), "one or more runs whose allocations were recorded alike")
    check_expected(expected, runs[0])
    axes.set_ylabel(style.axis_label(_MEASURES[measure], "share of the optimum"))
    shown = looks(times[0], _DECAY_LOOKS, log=True)
    if len(shown) < 2:
        return style.note(axes, NOT_RECORDED)
    drawn = times[0][shown]
    of = _misallocation if measure == "misallocation" else _relative_error
    error = np.mean([measured(run, shown, None, of, run.problem.n_resources) for run in runs], axis=0)
    known = np.flatnonzero(np.isfinite(error).any(axis=1))
    if not known.size:
        return style.note(axes, NEVER)
    for j in range(error.shape[1]):
        ink, mark = style.colour(j), style.mark(j)
        axes.plot(drawn, error[:, j], "-", marker=mark, color=ink, linewidth=1.4, markersize=4.0)
    axes.set_yscale("log")
    style.name_resources(axes, runs[0].problem)
    if expected is not None:
        draw_expected(axes, drawn, getattr(expected, measure)(drawn))
    last = known[-1]
    reference = 1.6 * float(np.nanmax(error[last])) * (drawn / drawn[last]) ** slope
    axes.plot(
        drawn,
        reference,
        ":",
        color=style.REFERENCE,
        linewidth=1.6,
        label=f"slope {slope:g}".replace("-", "−"),
    )
    axes.set_xlim(drawn[0], drawn[-1])
    top = float(np.nanmax(error))
    axes.set_ylim(0.6 * float(np.nanmin(error[error > 0.0], initial=top)), 1.6 * top)
    style.number_axis(axes.yaxis, percent=True)
    style.time_axis(axes, runs[0], log=True)
    return axes


def _misallocation(look: Observation) -> FloatArray:
    return misallocation(look.problem, look.average)


def _relative_error(look: Observation) -> FloatArray:
    return metrics.relative_error(look.average, look.best.allocation)
