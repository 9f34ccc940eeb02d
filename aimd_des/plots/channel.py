"""What the channel makes of signals: how many copies of each agent arrive, and how late."""

import numpy as np
from matplotlib.axes import Axes

from aimd_des.plots import signals, style
from aimd_des.plots.panel import panel
from aimd_des.problem.lookup import resource_index
from aimd_des.results.event_log import Entry
from aimd_des.results.result import Result
from aimd_des.utils.validation import FloatArray

# Greys: colours are of resources, which stand beside these bars.
_DELIVERED, _IN_FLIGHT, _LOST = "0.87", "0.6", "0.2"


@panel
def copies(axes: Axes, result: Result, resource: str | int) -> Axes:
    """Draw what became of the copies of a resource's signals: delivered, in flight at the end or lost.

    Each agent has a bar, of a hundred agents spread evenly if there are more.

    Parameters
    ----------
    result : Result
        The run.

    Raises
    ------
    InputError
        If there is no such resource.
    """
    problem, account = result.problem, result.account
    resource = resource_index(problem, resource)
    rows = signals.rows_of(problem, None)
    parts = np.stack([of[resource, rows] for of in (account.delivered, account.in_flight, account.lost)])
    sent = parts.sum(axis=0)
    axes.set_xlabel("agent")
    axes.set_ylabel("copies (%)")
    if not sent.any():
        return style.note(axes, f"No signal of {problem.resources[resource].name} was sent.")
    shares = 100.0 * parts / np.maximum(sent, 1)
    below = np.zeros(len(rows))
    looks = (("delivered", _DELIVERED), ("in flight", _IN_FLIGHT), ("lost", _LOST))
    for share, (word, colour) in zip(shares, looks, strict=True):
        axes.bar(np.arange(len(rows)), share, 1.0, bottom=below, color=colour, label=word)
        below += share
    axes.set_xlim(-0.5, len(rows) - 0.5)
    axes.set_ylim(0.0, 100.0)
    style.number_axis(axes.yaxis)
    signals.name_columns(axes, result, rows)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


@panel
def latencies(axes: Axes, result: Result) -> Axes:
    """Draw how many of the copies that have arrived took longer than a time, on a logarithmic scale.

    Parameters
    ----------
    result : Result
        The run, with its log kept: ``Recording(events=True)``.
    """
    axes.set_xlabel("latency (units of time)")
    axes.set_ylabel("copies that take longer (%)")
    if result.log is None:
        return style.note(axes, signals.NO_LOG)
    found = [_latencies(result, j) for j in range(result.problem.n_resources)]
    if not any(one.size and one[-1] > 0.0 for one in found):
        return style.note(axes, "No copy of a signal has arrived, or none took time.")
    for j, name in enumerate(result.problem.resource_names):
        taken = found[j]
        longer = 100.0 * (1.0 - np.arange(len(taken)) / max(len(taken), 1))
        axes.plot(taken, longer, color=style.colour(j), linewidth=1.4, label=style.plain(name))
    axes.set_yscale("log")
    axes.set_xlim(left=0.0)
    style.number_axis(axes.xaxis)
    style.number_axis(axes.yaxis)
    style.frame(axes)
    return axes


def _latencies(result: Result, resource: int) -> FloatArray:
    """Return how long the copies of a resource have taken, ascending."""
    assert result.log is not None  # noqa: S101 - the panel looks before
    time, entry, _ = result.log.columns()
    own = entry[:, 1] == resource
    sent, arrived = own & (entry[:, 0] == Entry.SIGNAL), own & (entry[:, 0] == Entry.DELIVER)
    begun = np.full(int(entry[own, 3].max(initial=0)) + 1, np.nan)
    begun[entry[sent, 3]] = time[sent]
    return np.sort(time[arrived] - begun[entry[arrived, 3]])
