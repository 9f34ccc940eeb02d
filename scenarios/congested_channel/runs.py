"""One run in which loss depends on demand: on the load of the channel, or on what an agent holds."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des import BroadcastChannel, Problem, Recording, theory
from aimd_des.interventions import Partition
from aimd_des.loss import Bernoulli, Loss
from aimd_des.lowlevel import Draws, FloatArray, Purpose, System
from scenarios.common.measure import quietly, sensed
from scenarios.common.systems import memory_alone

# Loss depends on demand from here on, so that the start of a run is none of the causes; no agent hears from
# `OUTAGE` on for a while.
BEGIN, OUTAGE = 200.0, 300.0
# A level of demand is a mean over so much time.
_STRETCH = 50.0


@dataclass(frozen=True)
class Excess:
    """Loss that grows by the excess over the capacity; what it may not pass is kept for signals."""

    base: float
    limit: float = 1.0

    def __call__(self, load: float) -> float:
        """Return the probability of loss at a load."""
        return min(self.base + max(load - 1.0, 0.0), self.limit)


@dataclass(frozen=True)
class Overflow:
    """Loss of the share of all traffic that exceeds the capacity, and of a part of the rest."""

    base: float

    def __call__(self, load: float) -> float:
        """Return the probability of loss at a load."""
        return 1.0 - (1.0 - self.base) / max(load, 1.0)


@dataclass(frozen=True)
class Constant:
    """Loss that does not depend on the load: the run without the cause."""

    base: float

    def __call__(self, load: float) -> float:
        """Return the probability of loss at a load."""
        return self.base


Law = Excess | Overflow | Constant


@dataclass(frozen=True)
class LoadLoss:
    """Loss that is the same for all, and depends on the load by a law from a time on."""

    law: Law
    begin: float = 0.0

    def start(self, n_agents: int) -> "_ReadingLoss":
        """Begin a run."""
        return _ReadingLoss(self._chance)

    def _chance(self, system: System, draws: Draws) -> float:
        load = system.total(draws.resource) / float(system.problem.capacity[draws.resource])
        return self.law(load if draws.time >= self.begin else 1.0)


@dataclass(frozen=True)
class HoldingLoss:
    """Loss in proportion to what an agent holds, up to a limit; `share` at the capacity over n."""

    share: float
    limit: float

    def start(self, n_agents: int) -> "_ReadingLoss":
        """Begin a run."""
        return _ReadingLoss(self._chance)

    def _chance(self, system: System, draws: Draws) -> FloatArray:
        held, j = system.allocations()[0][draws.resource], draws.resource
        parts = held * (draws.n_agents / float(system.problem.capacity[j]))
        return np.asarray(np.minimum(self.share * parts, self.limit))


@dataclass(eq=False)
class _ReadingLoss:
    """Losses of one run, with a probability that is read off it."""

    chance: Callable[[System, Draws], float | FloatArray]

    def attach(self, system: System) -> None:
        """Take the run in progress."""
        self.system = system

    def draw(self, draws: Draws) -> npt.NDArray[np.bool_]:
        """Say of each agent's copy whether it is lost, shape (n,)."""
        return np.asarray(draws.uniforms(Purpose.LOSS) < self.chance(self.system, draws))


class Silence(NamedTuple):
    """A run in which no agent hears for a while; then signals are lost by a law."""

    law: Law
    hold_off: float
    silence: float  # how long no agent hears, in units of time
    threshold: float = 1.0
    after: float = 400.0  # how long it runs afterwards


class Load(NamedTuple):
    """Total demand over the capacity as the silence ends, and its mean over the last stretch."""

    lifted: float
    last: float


@lru_cache(maxsize=64)
def system_of(draw: int, threshold: float = 1.0) -> Problem:
    """Draw the costs of the paper's memory."""
    problem = memory_alone(draw=draw)
    return Problem([replace(problem.resources[0], threshold=threshold)], problem.costs)


def load(case: Silence, draw: int, seed: int) -> Load:
    """Run and measure total demand."""
    problem, back = system_of(draw, case.threshold), OUTAGE + case.silence
    until = back + case.after
    simulation = sensed(
        problem,
        case.hold_off,
        channel=BroadcastChannel(loss=LoadLoss(case.law, BEGIN)),
        interventions=[Partition(OUTAGE, case.silence)] if case.silence > 0.0 else [],
        seed=seed,
        recording=Recording(demand=[back, *np.arange(until - _STRETCH, until, 0.5)], overshoot=False),
    )
    total = quietly(simulation, until).observations.total_demand[:, 0] / problem.capacity[0]
    return Load(float(total[0]), float(total[1:].mean()))


class Stay(NamedTuple):
    """A run that only chance takes from the capacity, with loss by a law from the start on."""

    law: Law
    hold_off: float
    threshold: float
    until: float
    gone: float  # so far beyond the turning load no run is ever on its way back


def stay(case: Stay, draw: int, seed: int) -> FloatArray:
    """Run, and count escapes, 0 or 1, and the time until then; without the first stretch."""
    problem, begin = system_of(draw, case.threshold), 2.0 * _STRETCH
    looks = np.arange(begin, case.until)
    simulation = sensed(
        problem,
        case.hold_off,
        channel=BroadcastChannel(loss=LoadLoss(case.law, begin)),
        seed=seed,
        recording=Recording(demand=looks, overshoot=False),
    )
    total = quietly(simulation, case.until).observations.total_demand[:, 0] / problem.capacity[0]
    turning = theory.congestion(problem, case.law, hold_off=case.hold_off).turning
    away = np.flatnonzero(total > turning + case.gone)
    return np.array([len(away) > 0, looks[away[0]] - begin if len(away) else case.until - begin])


class Holding(NamedTuple):
    """A run with loss in proportion to what agents hold, or the same for all, with two lengths."""

    share: float
    own: bool  # whether it is in proportion
    hold_off: float = 0.25
    limit: float = 0.9
    ends: tuple[float, float] = (2000.0, 4000.0)

    @property
    def loss(self) -> Loss:
        """The model of loss."""
        return HoldingLoss(self.share, self.limit) if self.own else Bernoulli(self.share)


class Shares(NamedTuple):
    """Averages at both ends, (2, n), and the highest demand of one agent then, over the capacity over n."""

    average: FloatArray
    highest: float


def shares(case: Holding, draw: int, seed: int) -> Shares:
    """Run and measure how much each agent has."""
    simulation = sensed(
        system_of(draw),
        case.hold_off,
        channel=BroadcastChannel(loss=case.loss),
        seed=seed,
        recording=Recording(demand="end", allocations=list(case.ends[:1]), overshoot=False),
    )
    result = quietly(simulation, case.ends[1])
    seen, problem = result.observations, result.problem
    mean = float(problem.capacity[0]) / problem.n_agents
    return Shares(seen.average[-2:, 0], float(seen.demand[-2:, 0].max()) / mean)
