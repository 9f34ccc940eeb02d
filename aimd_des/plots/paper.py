"""The paper's figures 1 to 4, for any run: a row of three panels each."""

from collections.abc import Callable, Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from aimd_des.plots.allocations import average_allocations, derivatives, instantaneous_allocations
from aimd_des.plots.capacity import capacity_events, sum_of_averages, sum_of_demand
from aimd_des.plots.channel import copies, latencies
from aimd_des.plots.convergence import averages_against_optimum
from aimd_des.plots.errors import absolute_error, cost_ratio, error_histogram, relative_error
from aimd_des.plots.style import plain, shared_legend
from aimd_des.plots.tracking import tracking_error, tracking_level
from aimd_des.problem.optimum import Optimum
from aimd_des.results.result import Result
from aimd_des.theory import Convergence
from aimd_des.utils.errors import InputError

_PANEL = (4.3, 3.7)  # inches: text of the default size stays readable on a page

# Fewer are not counted in bins.
_FEW_AGENTS = 15

_Panel = tuple[str, Callable[[Axes], Axes]]


def paper_figures(
    results: Result | Sequence[Result],
    optimum: Optimum | None = None,
    *,
    expected: Convergence | None = None,
) -> dict[str, Figure]:
    """Draw the paper's four figures.

    Parameters
    ----------
    results : Result or sequence of Result
        The run to draw; of several, the first, and all of them where capacity events are counted.
        Best recorded with ``Recording("auto", "auto", tail=100)``: a panel for which too little
        was recorded says so.
    optimum : Optimum, optional
        What stands for the optimum of the first run's problem at its end; default: the one in force.
    expected : Convergence, optional
        What theory says of the first run, such as `Simulation.convergence`, for a band behind its relative
        error.

    Returns
    -------
    dict of str to Figure
        ``figure1``: averages of some agents, their demand over the last 100 units of time, profile
        of the derivatives.  ``figure2``: distance of the averages from the optimum, relative error,
        cost ratio.  ``figure3``: for each resource a histogram of the distances at the end.
        ``figure4``: sum of the averages, sum of the demands over the last 40 units of time,
        capacity events.

    Raises
    ------
    InputError
        If there is no run, their resources differ, the optimum is for another number of agents, or
        `expected` is of other resources.
    """
    return {name: draw() for name, draw in figure_makers(results, optimum, expected).items()}


def figure_makers(
    results: Result | Sequence[Result],
    optimum: Optimum | None = None,
    expected: Convergence | None = None,
) -> dict[str, Callable[[], Figure]]:
    """Give what draws each of the paper's figures, so that one that fails does not take the others along."""
    runs = [results] if isinstance(results, Result) else list(results)
    if not runs:
        raise InputError.of("results", runs, "at least one run")
    run = runs[0]
    histograms: list[_Panel] = [
        (f"Errors at the end: {name}", partial(error_histogram, result=run, optimum=optimum, resource=j))
        for j, name in enumerate(run.problem.resource_names)
    ]
    return {
        "figure1": partial(
            _row,
            ("Averages of some agents", lambda axes: average_allocations(axes, run, optimum)),
            ("Demand of one agent for each resource", lambda axes: instantaneous_allocations(axes, run)),
            ("Derivatives, mean ± std over all agents", lambda axes: derivatives(axes, run, optimum)),
        ),
        "figure2": partial(
            _row,
            ("Distance from the optimum", lambda axes: absolute_error(axes, run, optimum)),
            ("Relative error", lambda axes: relative_error(axes, run, optimum, expected=expected)),
            ("Total cost over optimal cost", lambda axes: cost_ratio(axes, run, optimum)),
        ),
        "figure3": partial(_row, *histograms, legend=False),
        "figure4": partial(
            _row,
            ("Sum of the averages", lambda axes: sum_of_averages(axes, run)),
            ("Sum of the demands at the end", lambda axes: sum_of_demand(axes, run)),
            (_events_title(len(runs)), lambda axes: capacity_events(axes, runs)),
        ),
    }


def run_figures(run: Result) -> dict[str, Callable[[], Figure]]:
    """Give what draws the figures of any run: the paper's, or what fits better.

    A histogram of few agents says nothing: each is drawn against its optimum.  A fifth figure follows the
    optimum of a run whose problem changes, and one of the channel shows copies that were late or lost.
    """
    makers = figure_makers(run)
    panels: list[_Panel]
    if run.problem.n_agents < _FEW_AGENTS:
        panels = [
            (f"Averages of {name}", partial(averages_against_optimum, result=run, optimum=None, resource=j))
            for j, name in enumerate(run.problem.resource_names)
        ]
        makers["figure3"] = partial(_row, *panels)
    if len(run.history) > 1:
        makers["figure5"] = partial(
            _row,
            ("Distance from the optimum in force", lambda axes: tracking_error(axes, run)),
            ("Use of the capacity in force", lambda axes: tracking_level(axes, run)),
        )
    if run.account.lost.any() or run.account.in_flight.any():
        panels = [
            (f"Copies of signals of {name}", partial(copies, result=run, resource=j))
            for j, name in enumerate(run.problem.resource_names)
        ]
        if run.log is not None:
            panels.append(("Latency of all copies", lambda axes: latencies(axes, run)))
        makers["channel"] = partial(_row, *panels)
    return makers


def _events_title(count: int) -> str:
    return "Capacity events" if count == 1 else f"Capacity events, {count} simulations"


def _row(*panels: _Panel, legend: bool = True) -> Figure:
    """Put panels side by side, in two rows where they are more than three."""
    rows = 1 if len(panels) <= 3 else 2
    columns = -(-len(panels) // rows)
    figure = Figure(
        figsize=(columns * _PANEL[0], rows * _PANEL[1]), layout=ConstrainedLayoutEngine(w_pad=0.1)
    )
    for place, (title, draw) in enumerate(panels):
        axes = figure.add_subplot(rows, columns, place + 1)
        draw(axes)
        axes.set_title(f"({chr(ord('a') + place)}) {plain(title)}", loc="left", fontsize="medium")
    if legend:
        shared_legend(figure)
    return figure
