"""Runs in which some cameras see something unusual, and what theory has to say about them."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from aimd_des import Problem, Recording, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import UnusualActivity
from aimd_des.lowlevel import FloatArray
from scenarios.common.measure import quietly, sensed
from scenarios.common.systems import alike, elasticity, memory_alone

WEIGHT, _HOLD_OFF = 0.2, 0.5
ONE, STEEP, THREE = "quadratic costs", "costs of power 6", "three cameras"
AVERAGINGS: dict[str, Averaging] = {
    "all of the past": Cumulative(),
    "forgetting, 100": Forgetting(100.0),
    "forgetting, 300": Forgetting(300.0),
    "forgetting, 30": Forgetting(30.0),
    "window, 200": Window(200.0),
}


class Case(NamedTuple):
    """Who sees the event, how all average, when it begins and ends, the end, and how often it is looked."""

    group: str
    averaging: str
    begin: float
    end: float
    until: float
    every: float

    @property
    def times(self) -> FloatArray:
        """When allocations are kept."""
        return np.asarray(np.arange(self.begin - 100.0, self.until + 0.5 * self.every, self.every))

    @property
    def since(self) -> FloatArray:
        """The same, from the beginning of the event on."""
        return self.times - self.begin


class Seen(NamedTuple):
    """What is seen of one run."""

    # (q,): Of the cameras with the event, in the mean over them, in units of the resource.
    demand: FloatArray
    average: FloatArray
    before: FloatArray  # (n,): averages of all cameras as the event begins


@lru_cache
def problem_of(draw: int) -> Problem:
    """Draw the costs of memory alone."""
    return memory_alone(draw=draw)


@lru_cache
def groups(draw: int) -> dict[str, tuple[int, ...]]:
    """Choose who sees the event: cameras of medium share, with quadratic and with the steepest costs.

    By their costs; the last group is three cameras with quadratic costs.
    """
    problem = problem_of(draw)
    x = solve_optimum(problem).allocation[:, 0]
    square, sixth = (sorted(alike(problem, steepness), key=x.__getitem__) for steepness in (1.0, 5.0))
    middle = len(square) // 2
    return {
        ONE: (square[middle],),
        STEEP: (sixth[len(sixth) // 2],),
        THREE: tuple(square[middle - 1 : middle + 2]),
    }


def measure(case: Case, draw: int, seed: int) -> Seen:
    """Run with an event at cameras of a draw of the costs, all of which average in a way."""
    own = list(groups(draw)[case.group])
    simulation = sensed(
        problem_of(draw),
        _HOLD_OFF,
        averaging=AVERAGINGS[case.averaging],
        interventions=[UnusualActivity(own, case.begin, case.end, WEIGHT)],
        seed=seed,
        recording=Recording(demand="end", allocations=case.times, overshoot=False),
    )
    seen = quietly(simulation, case.until).observations
    start = int(np.searchsorted(seen.allocation_times, case.begin))
    return Seen(
        seen.demand[:, 0, own].mean(axis=1), seen.average[:, 0, own].mean(axis=1), seen.average[start, 0]
    )


@lru_cache
def _expected(draw: int) -> theory.Prediction:
    return theory.predict(problem_of(draw), "continuous")


def _level(draw: int) -> float:
    return float(_expected(draw).utilisation[0] * problem_of(draw).capacity[0])


@lru_cache
def shares(group: str, draw: int) -> tuple[float, float]:
    """Compute the mean of these cameras in the optimum for what is used, before and during the event."""
    problem, own = problem_of(draw), list(groups(draw)[group])
    weights = np.ones(problem.n_agents)
    weights[own] = WEIGHT
    old, new = (
        solve_optimum(problem, capacity=[_level(draw)]),
        theory.reweighted_optimum(problem, weights, capacity=[_level(draw)]),
    )
    before, after = (float(best.allocation[own, 0].mean()) for best in (old, new))
    return before, after


def progress(group: str, draw: int, values: FloatArray) -> FloatArray:
    """Compute how much of the way from the old to the new share has been made."""
    old, new = shares(group, draw)
    return np.asarray((values - old) / (new - old))


@lru_cache
def fluid(case: Case, draw: int) -> FloatArray:
    """Compute what demand and average, (2, q), of these cameras make of the way in the fluid."""
    own = groups(draw)[case.group]
    event = theory.Spell(case.begin, case.end, own, WEIGHT)
    path = theory.flow(
        problem_of(draw), _level(draw), case.until, AVERAGINGS[case.averaging], [event], step=0.5
    )
    at = np.searchsorted(path.time, case.times)
    both = [part[at][:, list(own)].mean(axis=1) for part in (path.demand, path.average)]
    return progress(case.group, draw, np.array(both))


def scatter(case: Case, draw: int, runs: Sequence[Seen]) -> float:
    """Measure how averages of cameras with costs as steep scatter over runs, as a mean of squares.

    That of the coefficient of variation; of the square of the mean, too, the error is taken off.
    """
    before = np.array([run.before for run in runs])[:, kin(case.group, draw)]
    variance = before.var(axis=0, ddof=1)
    return float((variance / (before.mean(axis=0) ** 2 - variance / len(runs))).mean())


@lru_cache
def kin(group: str, draw: int) -> list[int]:
    """List the cameras with costs as steep as those of a group: so many that scatter can be measured."""
    problem = problem_of(draw)
    return alike(problem, float(elasticity(problem)[groups(draw)[group][0]]))


def expected_scatter(case: Case, draw: int) -> float:
    """Predict the scatter of averages just before the event, for cameras with costs as steep as each other.

    As a mean of squares; NaN where there is no formula, which is for steep costs with an average that does
    not forget.
    """
    agents, problem = kin(case.group, draw), problem_of(draw)
    averaging, expected, steep = AVERAGINGS[case.averaging], _expected(draw), elasticity(problem)[agents]
    memory: dict[str, Any] = {"window": case.begin}
    young = 1.0
    if isinstance(averaging, Forgetting):
        memory = {"time_constant": averaging.time_constant}
        # In a run that is not much older than its memory, fewer moments share all the weight.
        old = np.exp(-steep.mean() * case.begin / averaging.time_constant)
        young = float(np.sqrt((1.0 + old) / (1.0 - old)))
    elif isinstance(averaging, Window):
        memory = {"window": averaging.length * (1.0 - 0.5 / averaging.parts)}
    if "window" in memory and steep.max() > 1.5:
        return np.nan
    spread = theory.averaging_spread(
        expected.allocation[agents, 0],
        problem.increase[agents, 0],
        problem.decrease[agents, 0],
        probability=expected.probability[agents, 0],
        elasticity=np.maximum(steep, 1.0) if "time_constant" in memory else 1.0,
        **memory,
    )
    return float(young**2 * np.mean(spread**2))
