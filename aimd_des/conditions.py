"""The conditions of a run that interventions change, and who wants to know when they do."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.checks import FloatArray
from aimd_des.costs import Costs
from aimd_des.problem import Problem

__all__ = ["Conditions", "Piece", "growth_of"]

BoolArray = npt.NDArray[np.bool_]


class Piece(NamedTuple):
    """The problem that is in force from one intervention to the next.

    Attributes
    ----------
    start : float
        Since when, in units of time.
    capacity : ndarray, shape (m,)
        C, in units of the resources.
    present : ndarray of bool, shape (n,)
        Which agents take part.
    costs : Costs
        The private costs of all agents.
    """

    start: float
    capacity: FloatArray
    present: BoolArray
    costs: Costs


@dataclass(eq=False)
class Conditions:
    """What holds at the moment; the arrays are shared with whoever works on them.

    Attributes
    ----------
    away : ndarray of bool, shape (n,)
        Agents that are not here: they hold nothing, do not grow, and hear nothing.
    cut : ndarray of bool, shape (n,)
        Agents to which no signal gets through that is sent now.
    failed : ndarray of bool, shape (1,)
        Whether the control unit is down.
    growth : ndarray, shape (m,)
        Growth of total demand, in units of the resource per unit of time (or per tick of all).
    base_costs, costs : Costs
        The private costs, without and with the weights.
    weights : ndarray, shape (n,)
        What the costs of each agent are multiplied by.
    pieces : list of Piece
        The problems that have been in force, the present one included.
    on_tightening : list of callable
        Called with (time, resource) when the threshold may be reached sooner than it looked.
    on_recovery : list of callable
        Called with the time when a control unit takes over.
    on_costs : list of callable
        Called with the costs when they have changed.
    on_piece : list of callable
        Called just before the problem changes.
    """

    away: BoolArray
    cut: BoolArray
    failed: BoolArray
    growth: FloatArray
    base_costs: Costs
    costs: Costs
    weights: FloatArray
    pieces: list[Piece]
    on_tightening: list[Callable[[float, int], None]] = field(default_factory=list)
    on_recovery: list[Callable[[float], None]] = field(default_factory=list)
    on_costs: list[Callable[[Costs], None]] = field(default_factory=list)
    on_piece: list[Callable[[], None]] = field(default_factory=list)

    @classmethod
    def at_start(cls, problem: Problem) -> "Conditions":
        """Give the conditions before anything has happened: all are here and hear.

        Parameters
        ----------
        problem : Problem
            What is shared, by how many.

        Returns
        -------
        Conditions
            Of one run.
        """
        n = problem.n_agents
        nobody = np.zeros(n, dtype=np.bool_)
        return cls(
            away=nobody,
            cut=nobody.copy(),
            failed=np.zeros(1, dtype=np.bool_),
            growth=growth_of(problem.increase.T),
            base_costs=problem.costs,
            costs=problem.costs,
            weights=np.ones(n),
            pieces=[Piece(0.0, problem.capacity, ~nobody, problem.costs)],
        )


def growth_of(increase: FloatArray) -> FloatArray:
    """Sum up what all agents add.

    Parameters
    ----------
    increase : ndarray, shape (m, n)
        alpha.

    Returns
    -------
    ndarray, shape (m,)
        Added up in the order of the agents, as totals are.
    """
    return np.cumsum(increase, axis=1)[:, -1].copy()
