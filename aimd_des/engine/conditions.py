"""The conditions of a run that interventions change, and the parts that are told of changes."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs import Costs
from aimd_des.problem.problem import Problem
from aimd_des.results.run_data import Piece
from aimd_des.utils.locked_arrays import locked, put, repeated
from aimd_des.utils.validation import FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


@dataclass(eq=False)
class Conditions:
    """What holds at the moment; the arrays are shared with all parts that use them, and written by `put`."""

    # Counts beside flags: what has begun twice, such as two partitions of one agent, ends when both have.
    away: BoolArray  # (n,): agents that are not here: they hold nothing, do not grow, and hear nothing
    cut: BoolArray  # (n,): agents to which no signal gets through that is sent now
    cuts: IntArray  # (n,): by how many partitions each agent is cut off
    failed: BoolArray  # (1,): whether the control unit is down
    threshold: FloatArray  # (m,): gamma, the share of the capacity
    increase: FloatArray  # (m, n): alpha of each agent while it is here; replaced, and never written to
    # (m,): growth of total demand, in units of the resource per unit of time (or per tick of all).
    growth: FloatArray
    # The private costs, without and with the weights.
    base_costs: Costs
    costs: Costs
    # (n,): what the costs of each agent are multiplied by: the product of all in `weighing`; replaced, and
    # never written to.
    weights: FloatArray
    pieces: list[Piece]  # the problems that have been in force, the present one included
    failures: int = 0  # by how many faults the control unit is down
    # The weights of each source, shape (n,), in the order in which sources began.
    weighing: dict[Hashable, FloatArray] = field(default_factory=dict)
    # All costs that have been in force but those of the problem, what has drawn them (the name of an
    # intervention and the number of the draw; nothing: they are the problem's; "": a function of the user's
    # own), and the weights on them.
    recipes: list[tuple[Costs, tuple[str, int] | str | None, FloatArray | None]] = field(default_factory=list)
    # Called with (time, resource) when the threshold may be reached sooner than it looked.
    on_tightening: list[Callable[[float, int], None]] = field(default_factory=list)
    # Called with the time when a control unit takes over.
    on_recovery: list[Callable[[float], None]] = field(default_factory=list)
    # Called with the shortest and the longest hold-off when they have changed; empty where there is none.
    on_hold_off: list[Callable[[float, float], None]] = field(default_factory=list)
    # Whether they have changed: then the control unit's own word on when it may signal is out of date.
    retimed: bool = False
    # Called when signals go over another channel from now on.
    on_channel: list[Callable[[], None]] = field(default_factory=list)
    # Called with the costs when they have changed.
    on_costs: list[Callable[[Costs], None]] = field(default_factory=list)
    # Called when parameters of the agents' rule have changed.
    on_parameters: list[Callable[[], None]] = field(default_factory=list)
    on_piece: list[Callable[[], None]] = field(default_factory=list)  # called just before the problem changes

    @classmethod
    def at_start(cls, problem: Problem) -> "Conditions":
        """Give the conditions before anything has happened: all are here and hear."""
        n, increase = problem.n_agents, problem.by_resource("increase")
        # Locked against writing: a change goes through `put`, which reports it; readers keep views of them.
        nobody = locked(np.zeros(n, dtype=np.bool_))
        return cls(
            away=nobody,
            cut=locked(nobody.copy()),
            cuts=locked(np.zeros(n, dtype=np.int64)),
            failed=locked(np.zeros(1, dtype=np.bool_)),
            # Copies: a problem serves many runs, and none of them may change it.
            threshold=locked(problem.threshold.copy()),
            increase=increase,
            growth=locked(growth_of(increase)),
            base_costs=problem.costs,
            costs=problem.costs,
            weights=repeated([1.0], n)[0],
            pieces=[Piece(0.0, problem.capacity, locked(~nobody), problem.costs)],
        )

    def state(self) -> dict[str, Any]:
        """Return what holds; what is never changed in place can be shared."""
        return {
            "arrays": self._arrays(),
            "increase": self.increase,
            "base_costs": self.base_costs,
            "costs": self.costs,
            "weights": self.weights,
            "pieces": tuple(self.pieces),
            "failures": self.failures,
            "retimed": self.retimed,
            "weighing": tuple(self.weighing.items()),
            "recipes": tuple(self.recipes),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        for array, kept in zip(self._arrays(), state["arrays"], strict=True):
            put(array, slice(None), kept)
        self.increase = state["increase"]
        repriced = state["costs"] is not self.costs
        self.base_costs, self.costs, self.weights = state["base_costs"], state["costs"], state["weights"]
        self.pieces[:] = state["pieces"]
        self.failures, self.recipes[:] = state["failures"], state["recipes"]
        self.retimed = state["retimed"]
        self.weighing = {by: weights.copy() for by, weights in state["weighing"]}
        if repriced:
            for tell in self.on_costs:
                tell(self.costs)

    def _arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.away, self.cut, self.cuts, self.failed, self.threshold, self.growth


def growth_of(increase: FloatArray) -> FloatArray:
    """Sum up what all agents add."""
    # Not `sum`, which adds in pairs and differently for other lengths: here, one after the other in the order
    # of agents, an agent that adds nothing leaves every bit as it is.
    return np.cumsum(increase, axis=1)[:, -1].copy()
