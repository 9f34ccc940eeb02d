"""What the control unit does: demand against capacity with the signals, and what becomes of each signal."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from aimd_des.plots import capacity, style, units
from aimd_des.plots.panel import panel
from aimd_des.problem.lookup import agent_indices, resource_index
from aimd_des.problem.problem import Problem
from aimd_des.results.event_log import Entry, EventLog
from aimd_des.results.result import Result
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray, IntArray

_MOST_NAMES = 25
_MOST_ROWS = 100
_MOST_COLUMNS = 8

_NO_LOOKS = (
    "Fewer than two samples of total demand lie here.\nRecord them more densely to see this panel:\n"
    "Recording(demand=0.1)"
)
NO_LOG = "The run kept no log of its events.\nKeep it to see this panel:\nRecording(events=True)"
_LOST_COLOUR = "#D55E00"
_HEARD_COLOUR = "0.72"


@panel
def demand_and_signals(axes: Axes, result: Result, *, start: float = 0.0, end: float | None = None) -> Axes:
    """Draw total demand against the capacities over a window of time, with every signal marked.

    A triangle stands for a signal, at the time of the look or the crossing that caused it and on the
    threshold that was passed.  Capacities, dashed, follow interventions.

    Parameters
    ----------
    result : Result
        The run, with totals recorded densely: ``Recording(demand=0.1)`` for continuous agents, every
        step for discrete ones.

    Raises
    ------
    InputError
        If the window is empty or lies outside the run.
    """
    first, last = window(result, start, end)
    problem, seen, scale = result.problem, result.observations, units.scale_for_totals(result.problem)
    axes.set_ylabel(style.axis_label("sum of demands", scale.unit))
    shown = np.flatnonzero((seen.demand_times >= first) & (seen.demand_times <= last))
    if len(shown) < 2:
        return style.note(axes, _NO_LOOKS)
    times, sent = seen.demand_times[shown], result.signals_sent
    # Discrete demand is constant between ticks and jumps at them.
    steps = "steps-post" if result.dynamics == "discrete" else "default"
    for j, resource in enumerate(problem.resources):
        curve = seen.total_demand[shown, j] / scale.divisor[j]
        axes.plot(times, curve, color=style.colour(j), linewidth=1.3, drawstyle=steps)
        capacity.capacity_line(axes, result, j, scale.divisor[j], first, last)
        due = sent.time[(sent.resource == j) & (sent.time >= first) & (sent.time <= last)]
        level = resource.threshold * capacity.capacity_at(result, j, due) / scale.divisor[j]
        axes.plot(due, level, "v", color=style.colour(j), markersize=5.5, markeredgecolor="white")
    style.name_resources(axes, problem, "capacity")
    axes.plot([], [], "v", color=style.REFERENCE, markersize=5.5, label="signal")
    axes.set_xlim(first, last)
    style.number_axis(axes.yaxis)
    style.time_axis(axes, result)
    return axes


@panel
def signal_raster(
    axes: Axes,
    result: Result,
    resource: str | int,
    *,
    start: float = 0.0,
    end: float | None = None,
    agents: npt.ArrayLike | None = None,
) -> Axes:
    """Draw when each agent heard the signals of a resource, lost them, and responded.

    Parameters
    ----------
    result : Result
        The run, with its log kept: ``Recording(events=True)``.

    Raises
    ------
    InputError
        If the window is empty or lies outside the run, or there is no such resource or agent.

    Notes
    -----
    A vertical line is a broadcast.  A copy that is lost is marked at the time of the broadcast, one that
    is heard when it arrives, and a response when the agent acts.
    """
    first, last = window(result, start, end)
    n, shared = result.problem.n_agents, result.problem.resources
    resource = resource_index(result.problem, resource)
    rows = rows_of(result.problem, agents)
    axes.set_ylabel("agent")
    if result.log is None:
        return style.note(axes, NO_LOG)
    time, kind, agent = _entries(result.log, resource, first, last)
    broadcasts = time[kind == Entry.SIGNAL]
    if not broadcasts.size and not time.size:
        return style.note(axes, f"No signal of {shared[resource].name} was sent or heard here.")
    axes.vlines(broadcasts, -0.8, len(rows) - 0.2, color="0.6", linewidth=0.8, zorder=1, label="broadcast")
    place = np.full(n, -1)
    place[rows] = np.arange(len(rows))
    size = float(np.clip(400.0 / len(rows), 6.0, 26.0))
    own = style.colour(resource)
    for entry, mark, of, word in (
        (Entry.DELIVER, "o", _HEARD_COLOUR, "heard"),
        (Entry.RESPOND, "o", own, "responded"),
        (Entry.LOST, "x", lost_colour(own), "lost"),
    ):
        those = (kind == entry) & (agent >= 0)
        those[those] = place[agent[those]] >= 0
        axes.scatter(
            time[those], place[agent[those]], size, c=of, marker=mark, linewidths=1.0, zorder=2, label=word
        )
    finish_rows(axes, result, rows, first, last)
    return axes


def lost_colour(own: str) -> str:
    """Choose the colour of what is lost beside that of a resource."""
    return _LOST_COLOUR if own != _LOST_COLOUR else "black"


def finish_rows(axes: Axes, result: Result, rows: npt.NDArray[np.intp], first: float, last: float) -> None:
    """Give a panel with a row for each agent its axes, with the names of agents or of some of them."""
    axes.set_ylim(-0.8, len(rows) - 0.2)
    axes.set_xlim(first, last)
    style.time_axis(axes, result)
    axes.grid(visible=False)
    shown = np.arange(0, len(rows), -(-len(rows) // _MOST_NAMES))
    names = [style.plain(result.problem.agent_names[i]) for i in rows[shown]]
    axes.set_yticks(shown, names, fontsize="small")


def name_columns(axes: Axes, result: Result, columns: npt.NDArray[np.intp]) -> None:
    """Name the columns of agents, or some of them, so few that the names have room."""
    shown = np.arange(0, len(columns), -(-len(columns) // _MOST_COLUMNS))
    names = [style.plain(result.problem.agent_names[i]) for i in columns[shown]]
    axes.set_xticks(shown, names, fontsize="small")


def window(result: Result, start: float, end: float | None) -> tuple[float, float]:
    """Check a window of time."""
    first = validation.number("start", start, low=0.0, high=result.until, high_open=True)
    if end is None:
        return first, result.until
    last = validation.number("end", end, low=first, low_open=True)
    if last > result.until:
        raise InputError.of("end", last, f"at most {result.until:g}, the end of the run")
    return first, last


def rows_of(problem: Problem, agents: npt.ArrayLike | None) -> npt.NDArray[np.intp]:
    """Say which agents are drawn, from the bottom to the top."""
    n_agents = problem.n_agents
    if agents is None:
        return np.unique(np.linspace(0, n_agents - 1, min(n_agents, _MOST_ROWS)).astype(np.intp))
    return np.array(agent_indices(problem, np.ravel(agents).tolist()))


def _entries(
    log: EventLog, resource: int, first: float, last: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Pick time, kind and agent of the entries about one resource in a window."""
    time, entry, _ = log.columns()
    here = (entry[:, 1] == resource) & (time >= first) & (time <= last) & (entry[:, 0] <= Entry.RESPOND)
    return time[here], entry[here, 0], entry[here, 2]
