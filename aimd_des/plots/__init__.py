"""Figures of runs and studies: one function a panel, and the paper's four figures put together from them.

Each panel function takes axes and a result, draws, and returns the axes, so that panels can be
combined at will and drawn over afterwards.  A resource has the same colour everywhere.  Nothing
here touches pyplot or any other global state.
"""

from aimd_des.plots.allocations import average_allocations, derivatives, instantaneous_allocations
from aimd_des.plots.capacity import capacity_events, sum_of_averages, sum_of_demand
from aimd_des.plots.channel import copies, latencies
from aimd_des.plots.convergence import averages_against_optimum, consensus, error_decay
from aimd_des.plots.errors import absolute_error, cost_ratio, error_histogram, relative_error
from aimd_des.plots.maps import heat_map
from aimd_des.plots.network import network_map
from aimd_des.plots.overview import overview
from aimd_des.plots.paper import paper_figures
from aimd_des.plots.score import agent_timeline, score
from aimd_des.plots.signals import demand_and_signals, signal_raster
from aimd_des.plots.style import REFERENCE, colour, frame, number_axis, shared_legend
from aimd_des.plots.tracking import tracking_error, tracking_level

__all__ = [
    "REFERENCE",
    "absolute_error",
    "agent_timeline",
    "average_allocations",
    "averages_against_optimum",
    "capacity_events",
    "colour",
    "consensus",
    "copies",
    "cost_ratio",
    "demand_and_signals",
    "derivatives",
    "error_decay",
    "error_histogram",
    "frame",
    "heat_map",
    "instantaneous_allocations",
    "latencies",
    "network_map",
    "number_axis",
    "overview",
    "paper_figures",
    "relative_error",
    "score",
    "shared_legend",
    "signal_raster",
    "sum_of_averages",
    "sum_of_demand",
    "tracking_error",
    "tracking_level",
]
