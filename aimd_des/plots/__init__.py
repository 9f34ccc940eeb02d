"""Figures of a run: one function a panel, and the paper's four figures put together from them.

Each panel function takes axes and a result, draws, and returns the axes, so that panels can be
combined at will and drawn over afterwards.  A resource has the same colour everywhere.  Nothing
here touches pyplot or any other global state.
"""

from aimd_des.plots.allocations import average_allocations, derivatives, instantaneous_allocations
from aimd_des.plots.capacity import capacity_events, sum_of_averages, sum_of_demand
from aimd_des.plots.errors import absolute_error, cost_ratio, error_histogram, relative_error
from aimd_des.plots.figures import paper_figures
from aimd_des.plots.style import colour, shared_legend

__all__ = [
    "absolute_error",
    "average_allocations",
    "capacity_events",
    "colour",
    "cost_ratio",
    "derivatives",
    "error_histogram",
    "instantaneous_allocations",
    "paper_figures",
    "relative_error",
    "shared_legend",
    "sum_of_averages",
    "sum_of_demand",
]
