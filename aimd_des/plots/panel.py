"""What all panels take and return."""

import numpy.typing as npt
from matplotlib.axes import Axes

from aimd_des.problem.optimum import Optimum
from aimd_des.results.result import Result
from aimd_des.utils.docstrings import described_like


def _any_panel(
    axes: Axes,
    result: Result,
    resource: str | int,
    optimum: Optimum | None,
    start: float,
    end: float | None,
    agents: npt.ArrayLike | None,
) -> Axes:
    """Draw a panel.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    result : Result
        The run, with allocations recorded over time.
    resource : str or int
        Its name, or j, counted from 0.
    optimum : Optimum, optional
        What stands for the optimum of the problem at the end; default: the one in force at each time.
    start : float
        Where the window begins, in units of time.
    end : float, optional
        Where it ends; default: the end of the run.
    agents : array_like of str or int, shape (q,), optional
        Which agents, by name or index, from the bottom to the top; default: all, or a hundred spread evenly
        over more.

    Returns
    -------
    Axes
        The same axes.
    """
    raise NotImplementedError  # its docstring is used


#: Describes what a panel has in common with all others.
panel = described_like(_any_panel)
