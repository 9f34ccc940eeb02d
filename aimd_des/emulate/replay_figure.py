"""An emulation and its simulation in one figure: total demand of both, and averages agent by agent."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from aimd_des.emulate.replay import Replay
from aimd_des.plots import REFERENCE, frame, number_axis
from aimd_des.plots.style import plain
from aimd_des.utils.colours import COLOURS

_PANEL = (4.3, 3.7)  # inches

# Of the run, from its end: enough to see the sawtooth, few enough to tell its periods apart.
_SHOWN = 0.25


def replay_figure(found: Replay) -> Figure:
    """Draw total demand of the first resource towards the end, and the averages of all agents at the end."""
    figure = Figure(figsize=(2 * _PANEL[0], _PANEL[1]), layout=ConstrainedLayoutEngine(w_pad=0.1))
    totals, averages = figure.subplots(1, 2)
    _totals(totals, found)
    _averages(averages, found)
    for place, (axes, title) in enumerate(((totals, "Total demand"), (averages, "Averages at the end"))):
        axes.set_title(f"({chr(ord('a') + place)}) {title}", loc="left", fontsize="medium")
    return figure


def _totals(axes: Axes, found: Replay) -> None:
    resource = found.real.problem.resources[0]
    for run, label, style in ((found.plain, "simulated", "-"), (found.real, "over sockets", "--")):
        seen = run.observations
        late = seen.demand_times >= (1.0 - _SHOWN) * run.until
        colour = REFERENCE if run is found.plain else COLOURS[0]
        axes.plot(seen.demand_times[late], seen.total_demand[late, 0], style, color=colour, label=label)
    axes.axhline(resource.capacity, color="black", linewidth=0.8, linestyle=":", label="capacity")
    axes.set_xlabel("time")
    axes.set_ylabel(plain(f"{resource.name} ({resource.unit})" if resource.unit else resource.name))
    axes.legend(fontsize="small", frameon=False, loc="lower left")
    frame(axes)


def _averages(axes: Axes, found: Replay) -> None:
    # Each resource over its largest average, so that all share the axes.
    ours, theirs = found.real.average_at_end, found.plain.average_at_end
    largest = ours.max(axis=0)
    for j, name in enumerate(found.real.problem.resource_names):
        colour = COLOURS[j % len(COLOURS)]
        axes.plot(theirs[:, j] / largest[j], ours[:, j] / largest[j], ".", color=colour, label=plain(name))
    axes.axline((0.0, 0.0), slope=1.0, color=REFERENCE, linewidth=0.8)
    axes.set_xlabel("simulated, over the largest")
    axes.set_ylabel("over sockets, over the largest")
    axes.set(xlim=(0.0, 1.05), ylim=(0.0, 1.05))
    for axis in (axes.xaxis, axes.yaxis):
        number_axis(axis)
    axes.legend(fontsize="small", frameon=False, loc="upper left")
    frame(axes)
