"""The synchronous algorithm once more, for every response and averaging: an independent way to its accuracy.

One step after the other in plain NumPy, with draws of NumPy's own generator.  Of the package it knows what a
problem consists of, and the gradient of its costs.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des import Problem

__all__ = ["AVERAGE", "EVENTS", "FULL", "PART", "RANDOM", "Way", "run_response"]

FloatArray = npt.NDArray[np.float64]

AVERAGE, EVENTS = "average", "events"  # what the slope is divided by
RANDOM, PART, FULL = "random", "part", "full"  # what becomes of demand


class Way(NamedTuple):
    """How signals are answered and demand is averaged."""

    divisor: str = AVERAGE
    cut: str = RANDOM
    gain: float = 1.0
    lag: int = 0


class _Agents:
    """Demands, and averages over steps and over what signals (with full cuts: own cuts) find."""

    def __init__(self, problem: Problem, way: Way, seed: int) -> None:
        self.problem, self.way, self.rng = problem, way, np.random.default_rng(seed)
        shape = problem.n_agents, problem.n_resources
        self.demand, self.average, self.found, self.met, self.summed = np.zeros((5, *shape))

    def average_step(self, step: int) -> None:
        """Fold in x(k): the average is over x(0) .. x(k)."""
        self.average += min(1.0, self.way.gain / (step + 1)) * (self.demand - self.average)

    def _count(self, which: npt.NDArray[np.bool_]) -> None:
        self.met[which] += 1.0
        weight = np.minimum(1.0, self.way.gain / self.met[which])
        self.found[which] += weight * (self.demand[which] - self.found[which])

    def answer(self, received: npt.NDArray[np.bool_]) -> None:
        """Let those who received a signal answer it, and the others grow."""
        problem, way = self.problem, self.way
        if way.divisor == EVENTS and way.cut != FULL:
            self._count(received)
        below = self.average
        if way.divisor == EVENTS:
            own = 0.5 * (1.0 + problem.decrease) if way.cut == FULL else 1.0
            below = np.where(self.met > 0.0, own * self.found, self.average)
        chance = problem.normalization * problem.costs.gradient(self.average) / below
        if way.cut == PART:
            factor = 1.0 - np.minimum((1.0 - problem.decrease) * chance, 1.0)
        elif way.cut == FULL:
            self.summed += np.where(received, np.minimum(chance, 1.0), 0.0)
            cut = received & (self.summed >= 1.0)
            self.summed -= cut
            self._count(cut)
            factor = np.where(cut, problem.decrease, 1.0)
        else:
            factor = np.where(self.rng.random(chance.shape) < chance, problem.decrease, 1.0)
        self.demand = np.where(received, factor * self.demand, self.demand + problem.increase)


def run_response(
    problem: Problem, at: Sequence[int], way: Way | None = None, *, seed: int = 0, loss: Any = 0.0
) -> FloatArray:
    """Run to the last of the steps `at`; averages at each of them, (q, n, m)."""
    way = way or Way()
    agents = _Agents(problem, way, seed)
    lost = np.broadcast_to(loss, problem.n_agents)[:, None]
    flags = np.zeros((way.lag + 1, problem.n_resources), dtype=np.bool_)
    kept = []
    for step in range(at[-1] + 1):
        agents.average_step(step)
        if step in at:
            kept.append(agents.average.copy())
        flags[step % (way.lag + 1)] = agents.demand.sum(axis=0) > problem.limit
        acts = flags[(step + 1) % (way.lag + 1)]
        if acts.any():
            agents.answer(acts & (agents.rng.random(agents.demand.shape) >= lost))
        else:
            agents.demand += problem.increase
    return np.stack(kept)
