"""The conditions of a run that interventions change, and who wants to know when they do."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs import Costs
from aimd_des.problem.problem import Problem
from aimd_des.results.run_data import Piece
from aimd_des.utils.locked_arrays import locked
from aimd_des.utils.validation import FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


@dataclass(eq=False)
class Conditions:
    """What holds at the moment; the arrays are shared with whoever works on them, and written by `put`.

    Attributes
    ----------
    away : ndarray of bool, shape (n,)
        Agents that are not here: they hold nothing, do not grow, and hear nothing.
    cut : ndarray of bool, shape (n,)
        Agents to which no signal gets through that is sent now.
    cuts : ndarray of int, shape (n,)
        By how many partitions each agent is cut off.
    failed : ndarray of bool, shape (1,)
        Whether the control unit is down.
    failures : int
        By how many faults it is.
    threshold : ndarray, shape (m,)
        gamma, the share of the capacity.
    increase : ndarray, shape (m, n)
        alpha of each agent while it is here.
    growth : ndarray, shape (m,)
        Growth of total demand, in units of the resource per unit of time (or per tick of all).
    base_costs, costs : Costs
        The private costs, without and with the weights.
    weights : ndarray, shape (n,)
        What the costs of each agent are multiplied by: the product of all in `weighing`.
    weighing : dict
        The weights of each who weighs, shape (n,), in the order in which they began.
    pieces : list of Piece
        The problems that have been in force, the present one included.
    on_tightening : list of callable
        Called with (time, resource) when the threshold may be reached sooner than it looked.
    on_recovery : list of callable
        Called with the time when a control unit takes over.
    on_costs : list of callable
        Called with the costs when they have changed.
    on_parameters : list of callable
        Called when parameters of the agents' rule have changed.
    on_piece : list of callable
        Called just before the problem changes.
    """

    # Counts beside flags: what has begun twice, such as two partitions of one agent, ends when both have.
    away: BoolArray
    cut: BoolArray
    cuts: IntArray
    failed: BoolArray
    threshold: FloatArray
    increase: FloatArray
    growth: FloatArray
    base_costs: Costs
    costs: Costs
    weights: FloatArray
    pieces: list[Piece]
    failures: int = 0
    weighing: dict[Hashable, FloatArray] = field(default_factory=dict)
    on_tightening: list[Callable[[float, int], None]] = field(default_factory=list)
    on_recovery: list[Callable[[float], None]] = field(default_factory=list)
    on_costs: list[Callable[[Costs], None]] = field(default_factory=list)
    on_parameters: list[Callable[[], None]] = field(default_factory=list)
    on_piece: list[Callable[[], None]] = field(default_factory=list)

    @classmethod
    def at_start(cls, problem: Problem) -> "Conditions":
        """Give the conditions before anything has happened: all are here and hear."""
        n = problem.n_agents
        # Locked against writing: who changes one uses `put`, and so says so; readers keep views of them.
        nobody = locked(np.zeros(n, dtype=np.bool_))
        return cls(
            away=nobody,
            cut=locked(nobody.copy()),
            cuts=locked(np.zeros(n, dtype=np.int64)),
            failed=locked(np.zeros(1, dtype=np.bool_)),
            # Copies: a problem serves many runs, and none of them may change it.
            threshold=locked(problem.threshold.copy()),
            increase=locked(problem.increase.T.copy()),
            growth=locked(growth_of(problem.increase.T)),
            base_costs=problem.costs,
            costs=problem.costs,
            weights=locked(np.ones(n)),
            pieces=[Piece(0.0, problem.capacity, locked(~nobody), problem.costs)],
        )


def growth_of(increase: FloatArray) -> FloatArray:
    """Sum up what all agents add."""
    # Not `sum`, which adds in pairs and differently for other lengths: here, one after the other in the order
    # of agents, an agent that adds nothing leaves every bit as it is.
    return np.cumsum(increase, axis=1)[:, -1].copy()
