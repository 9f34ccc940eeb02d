"""Signals on their way: a score with a row for each agent, and the line of one agent with what reached it."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from aimd_des.plots import signals, style
from aimd_des.plots.panel import panel
from aimd_des.problem.lookup import agent_index, resource_index
from aimd_des.results.event_log import Entry
from aimd_des.results.result import Result
from aimd_des.utils.validation import BoolArray, FloatArray

_NO_LOOKS = (
    "Fewer than two samples of this agent lie here.\nRecord them more densely to see this panel:\n"
    "Recording(allocations=0.05, events=True)"
)


class _Copies:
    """The copies of signals of one resource, one row each: when sent, when it arrives or is lost, to whom."""

    def __init__(self, result: Result, resource: int, first: float, last: float) -> None:
        assert result.log is not None  # noqa: S101 - panels look before
        time, entry, _ = result.log.columns()
        kind, agent, number = entry[:, 0], entry[:, 2], entry[:, 3]
        own = entry[:, 1] == resource
        sent = own & (kind == Entry.SIGNAL)
        broadcasts = dict(zip(number[sent].tolist(), time[sent].tolist(), strict=True))
        ends = np.flatnonzero(own & ((kind == Entry.DELIVER) | (kind == Entry.LOST)))
        begun = np.array([broadcasts[one] for one in number[ends].tolist()])
        seen = (time[ends] >= first) & (begun <= last)
        self.sent: FloatArray = begun[seen]
        self.end: FloatArray = time[ends][seen]
        self.agent = agent[ends][seen]
        self.lost: BoolArray = kind[ends][seen] == Entry.LOST
        answers = own & (kind == Entry.RESPOND)
        answered = set(zip(agent[answers].tolist(), number[answers].tolist(), strict=True))
        pairs = zip(self.agent.tolist(), number[ends][seen].tolist(), strict=True)
        self.answered = np.array([pair in answered for pair in pairs], dtype=np.bool_) & ~self.lost
        self.broadcasts = np.array([at for at in broadcasts.values() if first <= at <= last])


@panel
def score(
    axes: Axes,
    result: Result,
    resource: str | int,
    *,
    start: float = 0.0,
    end: float | None = None,
    agents: npt.ArrayLike | None = None,
) -> Axes:
    """Draw each copy of the signals of a resource on its way, a row for each agent.

    A copy is a line from the signal to its arrival, where a filled dot is a response and an empty one is
    none; a cross is a copy that is lost.

    Parameters
    ----------
    result : Result
        The run, with its log kept: ``Recording(events=True)``.

    Raises
    ------
    InputError
        If the window is empty or lies outside the run, or there is no such resource or agent.
    """
    first, last = signals.window(result, start, end)
    problem = result.problem
    resource = resource_index(problem, resource)
    rows = signals.rows_of(problem, agents)
    axes.set_ylabel("agent")
    if result.log is None:
        return style.note(axes, signals.NO_LOG)
    copies = _Copies(result, resource, first, last)
    place = np.full(problem.n_agents, -1)
    place[rows] = np.arange(len(rows))
    shown = place[copies.agent] >= 0
    if not shown.any():
        name = problem.resources[resource].name
        return style.note(axes, f"No copy of a signal of {name} was under way here.")
    own, up = style.colour(resource), place[copies.agent]
    axes.vlines(copies.broadcasts, -0.8, len(rows) - 0.2, color="0.75", linewidth=0.8, label="signal")
    ways = shown & (copies.end > copies.sent)
    lines = [
        ((sent, row), (arrived, row))
        for sent, arrived, row in zip(copies.sent[ways], copies.end[ways], up[ways], strict=True)
    ]
    axes.add_collection(LineCollection(lines, colors=own, linewidths=1.6, alpha=0.55, label="on its way"))
    size = float(np.clip(500.0 / len(rows), 8.0, 34.0))
    lost = signals.lost_colour(own)
    for those, face, word in (
        (copies.answered, own, "arrives, responds"),
        (~copies.answered & ~copies.lost, "white", "arrives, holds"),
    ):
        here = shown & those
        axes.scatter(
            copies.end[here],
            up[here],
            size,
            c=face,
            edgecolors=own,
            linewidths=1.1,
            zorder=3,
            label=word,
        )
    gone = shown & copies.lost
    axes.scatter(copies.end[gone], up[gone], size, c=lost, marker="x", linewidths=1.3, zorder=3, label="lost")
    signals.finish_rows(axes, result, rows, first, last)
    return axes


@panel
def agent_timeline(
    axes: Axes,
    result: Result,
    agent: str | int,
    resource: str | int,
    *,
    start: float = 0.0,
    end: float | None = None,
) -> Axes:
    """Draw what one agent demands of a resource, with the signals that reach it and those that do not.

    A copy is an arrow from the signal, below, to its arrival; a cross is a copy that is lost.

    Parameters
    ----------
    result : Result
        The run, with its log and dense samples of agents: ``Recording(allocations=0.05, events=True)``.
    agent : str or int
        Its name, or i, counted from 0.

    Raises
    ------
    InputError
        If the window is empty or lies outside the run, or there is no such resource or agent.
    """
    first, last = signals.window(result, start, end)
    problem, seen = result.problem, result.observations
    resource = resource_index(problem, resource)
    agent = agent_index(problem, agent)
    shared = problem.resources[resource]
    axes.set_ylabel(style.axis_label(f"demand of agent {problem.agent_names[agent]}", shared.unit))
    if result.log is None:
        return style.note(axes, signals.NO_LOG)
    shown = np.flatnonzero((seen.allocation_times >= first) & (seen.allocation_times <= last))
    if len(shown) < 2:
        return style.note(axes, _NO_LOOKS)
    times, own = seen.allocation_times[shown], style.colour(resource)
    demand = seen.demand[shown, resource, agent]
    steps = "steps-post" if result.dynamics == "discrete" else "default"
    axes.plot(times, demand, color=own, linewidth=1.6, drawstyle=steps, label="demand")
    average = seen.average[shown, resource, agent]
    axes.plot(times, average, "--", color=style.REFERENCE, linewidth=1.2, label="average")
    top = float(demand.max()) or 1.0
    low = -0.22 * top
    copies = _Copies(result, resource, first, last)
    mine = copies.agent == agent
    lost = mine & copies.lost
    colour = signals.lost_colour(own)
    axes.plot(copies.sent[mine], np.full(mine.sum(), low), "|", color="0.3", markersize=8, label="signal")
    axes.plot(
        copies.sent[lost], np.full(lost.sum(), 0.5 * low), "x", color=colour, markersize=7, label="copy lost"
    )
    for sent, arrived in zip(copies.sent[mine & ~copies.lost], copies.end[mine & ~copies.lost], strict=True):
        look = {"arrowstyle": "-|>", "color": "0.35", "linewidth": 0.9}
        axes.annotate("", (arrived, 0.0), (sent, low), arrowprops=look)
    axes.plot([], [], "->", color="0.35", linewidth=0.9, markersize=0.0, label="copy arrives")
    axes.set_xlim(first, last)
    axes.set_ylim(1.15 * low, 1.08 * top)
    style.number_axis(axes.yaxis)
    style.time_axis(axes, result)
    return axes
