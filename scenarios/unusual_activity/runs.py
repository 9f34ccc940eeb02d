"""Runs in which some cameras see something unusual, and what theory has to say about them."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from aimd_des import Recording, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import UnusualActivity
from aimd_des.lowlevel import FloatArray
from scenarios.common.measure import quietly, sensed
from scenarios.common.systems import alike, elasticity, memory_alone

PROBLEM = memory_alone()
WEIGHT, _HOLD_OFF = 0.2, 0.5
AVERAGINGS: dict[str, Averaging] = {
    "all of the past": Cumulative(),
    "forgetting, 100": Forgetting(100.0),
    "forgetting, 300": Forgetting(300.0),
    "forgetting, 30": Forgetting(30.0),
    "window, 200": Window(200.0),
}


class Size(NamedTuple):
    """How much is run."""

    replications: int  # runs of each case
    # When the event begins and is over, the end of a run, and how often allocations are kept.
    begin: float
    end: float
    until: float
    every: float

    @property
    def times(self) -> FloatArray:
        """When allocations are kept."""
        return np.asarray(np.arange(self.begin - 100.0, self.until + 0.5 * self.every, self.every))


class Seen(NamedTuple):
    """What is seen of one run."""

    # (q,): Of the cameras with the event, in the mean over them, in units of the resource.
    demand: FloatArray
    average: FloatArray
    before: FloatArray  # (n,): averages of all cameras as the event begins


@lru_cache
def groups() -> dict[str, tuple[int, ...]]:
    """Choose who sees the event: cameras of medium share, with quadratic and with the steepest costs.

    By their costs; the last group is three cameras with quadratic costs.
    """
    x = solve_optimum(PROBLEM).allocation[:, 0]
    square, sixth = (sorted(alike(PROBLEM, steepness), key=x.__getitem__) for steepness in (1.0, 5.0))
    middle = len(square) // 2
    return {
        "quadratic costs": (square[middle],),
        "costs of power 6": (sixth[len(sixth) // 2],),
        "three cameras": tuple(square[middle - 1 : middle + 2]),
    }


def measure(cameras: tuple[int, ...], averaging: str, size: Size, seed: int) -> Seen:
    """Run with an event at these cameras, all of which average in a way."""
    simulation = sensed(
        PROBLEM,
        _HOLD_OFF,
        averaging=AVERAGINGS[averaging],
        interventions=[UnusualActivity(list(cameras), size.begin, size.end, WEIGHT)],
        seed=seed,
        recording=Recording(demand="end", allocations=size.times, overshoot=False),
    )
    result = quietly(simulation, size.until)
    seen, own = result.observations, list(cameras)
    start = int(np.searchsorted(seen.allocation_times, size.begin))
    return Seen(
        seen.demand[:, 0, own].mean(axis=1), seen.average[:, 0, own].mean(axis=1), seen.average[start, 0]
    )


@lru_cache
def _expected() -> theory.Prediction:
    return theory.predict(PROBLEM, "continuous")


def _level() -> float:
    return float(_expected().utilisation[0] * PROBLEM.capacity[0])


@lru_cache
def shares(cameras: tuple[int, ...]) -> tuple[float, float]:
    """Compute the mean of these cameras in the optimum for what is used, before and during the event."""
    weights = np.ones(PROBLEM.n_agents)
    weights[list(cameras)] = WEIGHT
    old, new = (
        solve_optimum(PROBLEM, capacity=[_level()]),
        theory.reweighted_optimum(PROBLEM, weights, capacity=[_level()]),
    )
    before, after = (float(best.allocation[list(cameras), 0].mean()) for best in (old, new))
    return before, after


@lru_cache
def fluid(cameras: tuple[int, ...], averaging: str, size: Size) -> tuple[FloatArray, FloatArray]:
    """Compute demand and average, (q,), of these cameras in the fluid, in the mean over them."""
    event = theory.Spell(size.begin, size.end, cameras, WEIGHT)
    path = theory.flow(PROBLEM, _level(), size.until, AVERAGINGS[averaging], [event], step=0.5)
    at = np.searchsorted(path.time, size.times)
    own = list(cameras)
    return path.demand[at][:, own].mean(axis=1), path.average[at][:, own].mean(axis=1)


def expected_scatter(agents: list[int], name: str, size: Size) -> float:
    """Predict the scatter of averages just before the event, for cameras with costs as steep as each other.

    A coefficient of variation, as the root of a mean of squares; NaN where there is no formula, which is for
    steep costs with an average that does not forget.
    """
    averaging, expected, steep = AVERAGINGS[name], _expected(), elasticity(PROBLEM)[agents]
    memory: dict[str, Any] = {"window": size.begin}
    young = 1.0
    if isinstance(averaging, Forgetting):
        memory = {"time_constant": averaging.time_constant}
        # In a run that is not much older than its memory, fewer moments share all the weight.
        old = np.exp(-steep.mean() * size.begin / averaging.time_constant)
        young = float(np.sqrt((1.0 + old) / (1.0 - old)))
    elif isinstance(averaging, Window):
        memory = {"window": averaging.length * (1.0 - 0.5 / averaging.parts)}
    if "window" in memory and steep.max() > 1.5:
        return np.nan
    spread = theory.averaging_spread(
        expected.allocation[agents, 0],
        PROBLEM.increase[agents, 0],
        PROBLEM.decrease[agents, 0],
        probability=expected.probability[agents, 0],
        elasticity=np.maximum(steep, 1.0) if "time_constant" in memory else 1.0,
        **memory,
    )
    return float(young * np.sqrt(np.mean(spread**2)))
