"""What all panels take and return."""

from matplotlib.axes import Axes

from aimd_des.problem.optimum import Optimum
from aimd_des.results.result import Result
from aimd_des.utils.docstrings import described_like


def _any_panel(axes: Axes, result: Result, optimum: Optimum | None = None) -> Axes:  # noqa: ARG001 - its docstring is used
    """Draw a panel.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    optimum : Optimum, optional
        What stands for the optimum of the problem at the end; default: the one in force at each time.

    Returns
    -------
    Axes
        The same axes.
    """
    return axes


#: Describes what a panel has in common with all others.
panel = described_like(_any_panel)
