"""A drop of the capacity of the paper's memory, or one like it: what is measured, and what is expected."""

from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from aimd_des import PolynomialCosts, Problem, Recording, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import CapacityRamp, CapacityStep
from aimd_des.lowlevel import FloatArray
from aimd_des.metrics import relative_error
from aimd_des.study import jackknife, mean_and_error
from scenarios.common.measure import sensed
from scenarios.common.systems import memory_alone
from scenarios.common.tables import theory_of

WITHIN = 0.05
LEFT = 0.6  # of the capacity, unless it is said
GRAIN = 5.0  # time between two records of all agents; totals are kept every unit
# A window that slides by finer parts would make no difference here.
_PARTS = 200
PAPER, QUADRATIC = "paper's memory", "quadratic costs"
LEVEL, SHARES, SCATTER = "recovery of the level", "recovery of the shares", "scatter of an average"
ERROR, DYNAMICS = "error left in one run", "recovery by mean dynamics"
WAYS = ("cumulative", "window", "forgetting")


class Drop(NamedTuple):
    """Costs, averaging and change; `window` is the length of the window and twice the time constant.

    What is left of the capacity, and the draw of the costs.
    """

    costs: str
    way: str
    ramp: float
    age: float
    window: float
    left: float = LEFT
    draw: int = 0

    @property
    def memory(self) -> dict[str, float]:
        """As theory takes it."""
        known = {"window": {"window": self.window}, "forgetting": {"time_constant": self.window / 2}}
        return known.get(self.way, {})

    @property
    def averaging(self) -> Averaging:
        """As agents take it."""
        if self.way == "cumulative":
            return Cumulative()
        return Window(self.window, _PARTS) if self.way == "window" else Forgetting(self.window / 2)

    @property
    def until(self) -> float:
        """Some time after averages should have recovered, a multiple of the grain."""
        return float(GRAIN * np.ceil((self.age + 1.25 * closed_form(self) + self.ramp) / GRAIN))


class Run(NamedTuple):
    """Level (q,) each unit of time; averages (r, n) and the run's relative error (r,) each grain."""

    level: FloatArray
    average: FloatArray
    error: FloatArray
    recovery: float  # of the level, as the result measures it


class Found(NamedTuple):
    """What runs of one draw of the costs come to: in the mean, and beside it what theory has."""

    level: FloatArray  # (q,)
    alone: FloatArray  # (r,): relative error of single runs
    together: FloatArray  # (r,): relative error of the averages over all runs
    numbers: dict[str, float]  # by measure; theory of X is called that


@lru_cache
def _problem(costs: str, draw: int = 0, share: float = 1.0) -> Problem:
    """Make memory alone, or costs c_i x**2 with the same optimum, with a share of the capacity."""
    problem = memory_alone(normalization=1 / 180, draw=draw)
    if costs == QUADRATIC:
        best = solve_optimum(problem)
        factors = best.multipliers[0] / (2.0 * best.allocation[:, 0])
        problem = Problem(problem.resources, PolynomialCosts([2], factors[:, None, None]))
    memory = replace(problem.resources[0], capacity=share * float(problem.capacity[0]))
    return Problem([memory], problem.costs)


@lru_cache
def used(costs: str, draw: int, share: float) -> float:
    """Predict the mean total demand, in units of the resource."""
    problem = _problem(costs, draw, share)
    return float(theory.predict(problem, "continuous").utilisation[0] * problem.capacity[0])


@lru_cache
def closed_form(case: Drop, *, plain: bool = False) -> float:
    """Predict the time from the start of the change until the level is within 5 % of the new capacity.

    Plain: as if all of the capacity were used from the first instant on.
    """
    problem = _problem(case.costs, case.draw)
    before, after, within = float(problem.capacity[0]), case.left * float(problem.capacity[0]), WITHIN
    if not plain:
        full, left = (used(case.costs, case.draw, share) for share in (1.0, case.left))
        before, after, within = full, left, (1.0 + WITHIN) * after / left - 1.0
        if case.way == "cumulative":
            before *= 1.0 - filling(problem) / (case.age + (0.5 * (case.ramp + 1.0) if case.ramp else 0.0))
    steps = round(case.ramp) or None
    known = case.memory
    return theory.recovery_time(before, after, case.age, **known, within=within, ramp=case.ramp, steps=steps)


def filling(problem: Problem) -> float:
    """Compute half of the time in which demand, which begins at 0, first fills the capacity."""
    return 0.5 * float(problem.capacity[0] / problem.increase.sum())


@lru_cache
def by_mean_dynamics(case: Drop) -> float:
    """Predict the recovery of the level after a step from the balance of growth and cuts."""
    before, after = (
        theory.convergence(_problem(case.costs, case.draw, share), "continuous", averaging=case.averaging)
        for share in (1.0, case.left)
    )
    return float(theory.recovery(before, after, case.age).time("level", within=WITHIN)[0])


def mean_field(case: Drop) -> FloatArray:
    """Follow the means alone, (r, n) each grain: demand is shared as averages ask for, averages follow."""
    problem, steps = _problem(case.costs, case.draw), round(case.until / GRAIN)
    start = theory.predict(problem, "continuous").allocation[:, 0]
    history = [start] * (round(case.age / GRAIN) + 1)
    average = start * (1.0 - filling(problem) / case.age) if case.way == "cumulative" else start.copy()
    kept = [average] * len(history)
    for step in range(len(history), steps + 1):
        part = min((step * GRAIN - case.age) / case.ramp, 1.0) if case.ramp else 1.0
        full, left = (used(case.costs, case.draw, share) for share in (1.0, case.left))
        total = (1.0 - part) * full + part * left
        wanted = average / problem.costs.gradient(average[:, None])[:, 0]
        demand = wanted * total / wanted.sum()
        history.append(demand)
        if case.way == "window":
            average = average + (demand - history[step - round(case.window / GRAIN)]) * GRAIN / case.window
        else:
            span = step * GRAIN if case.way == "cumulative" else case.window / 2
            average = average + (demand - average) * GRAIN / span
        kept.append(average)
    return np.array(kept)


def run(case: Drop, seed: int) -> Run:
    """Run once, and keep what is looked at."""
    problem = _problem(case.costs, case.draw)
    capacity = case.left * float(problem.capacity[0])
    change = (
        CapacityRamp("memory", case.age, case.age + case.ramp, capacity, steps=round(case.ramp))
        if case.ramp
        else CapacityStep("memory", case.age, capacity)
    )
    result = sensed(
        problem,
        0.0,
        averaging=case.averaging,
        interventions=[change],
        seed=seed,
        recording=Recording(demand=1.0, allocations=GRAIN, overshoot=False),
    ).run(case.until)
    seen = result.observations
    tracked = result.tracking["relative_error"].to_numpy()
    recovery = float(result.recovery(within=WITHIN)["recovery_time"].to_numpy()[-1])
    return Run(seen.total_average[:, 0] / capacity, seen.average[:, 0, :], tracked, recovery)


def recover(case: Drop, draw: int, seed: int) -> float:
    """Measure how long the level takes with a draw of the costs."""
    return _of_level(case, run(case._replace(draw=draw), seed))


def _of_level(case: Drop, seen: Run) -> float:
    return _last_outside(seen.level - 1.0, case.age, 1.0)


def _last_outside(values: FloatArray, start: float, grain: float) -> float:
    """Time from the start of the change to the last record outside; to the end if it is."""
    after = np.asarray(values)[round(start / grain) :]
    outside = np.flatnonzero(np.abs(after) > WITHIN)
    return float(grain * (outside[-1] + 0.5)) if len(outside) else 0.0


def error_of(case: Drop, averages: FloatArray) -> FloatArray:
    """Compute the relative error against the new optimum at each record, (r,)."""
    best = solve_optimum(_problem(case.costs, case.draw, case.left)).allocation
    return np.array([relative_error(row[:, None], best)[0] for row in averages])


def _shares_recovery(case: Drop, averages: FloatArray) -> FloatArray:
    return np.array([_last_outside(error_of(case, averages), case.age, GRAIN)])


def _with_noise(case: Drop, errors: FloatArray) -> FloatArray:
    """Expect the relative error of the mean field plus normal noise with these standard errors, (r,)."""
    best = solve_optimum(_problem(case.costs, case.draw, case.left)).allocation[:, 0]
    away, noise = mean_field(case) - best, np.maximum(errors, 1e-12)
    inside = away / noise
    size = noise * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * inside**2) + away * (2.0 * ndtr(inside) - 1.0)
    return np.asarray(size.sum(axis=1) / best.sum())


def _spread(case: Drop) -> float:
    """Predict the scatter of agents' averages at the drop; NaN where no closed form is known."""
    problem = _problem(case.costs, case.draw)
    expected = theory.predict(problem, "continuous")
    x = expected.allocation
    bent = case.costs == PAPER
    if bent and case.way != "forgetting":
        return np.nan
    memory = case.memory or {"window": case.age}
    # Signals come nearly evenly, so that what is certain about an answer makes no noise.
    each = theory.averaging_spread(
        x,
        problem.increase,
        problem.decrease,
        elasticity=theory.elasticity(problem, x) if bent else 1.0,
        probability=expected.probability,
        **memory,
    )
    return float(np.sqrt((each**2).mean()))


def measure(runs: int, drop: Drop, draw: int, seed: int) -> Found:
    """Run a draw of the costs some times: recovery of level and shares, and the scatter over these runs."""
    case = drop._replace(draw=draw)
    # Averages over all of the past scatter little by the time that they recover, which is late.
    runs = max(runs // 4, 2) if case.way == "cumulative" else runs
    seen = [run(case, seed + number) for number in range(runs)]
    averages = [one.average for one in seen]
    at_drop = np.stack([one.average[round(case.age / GRAIN)] for one in seen])
    mean, noise = mean_and_error(averages)
    together = error_of(case, mean)
    alone = _last_outside(_with_noise(case, noise), case.age, GRAIN)
    numbers = {
        LEVEL: float(np.mean([_of_level(case, one) for one in seen])),
        theory_of(LEVEL): closed_form(case),
        SHARES: float(jackknife(averages, partial(_shares_recovery, case))[0][0]),
        theory_of(SHARES): alone,
        SCATTER: float(np.sqrt((at_drop.var(axis=0, ddof=1) / at_drop.mean(axis=0) ** 2).mean())),
        theory_of(SCATTER): _spread(case),
        ERROR: float(np.mean([one.error[-1] for one in seen])),
    }
    if case.way != "window" and not case.ramp:  # whose past is not followed there, and a ramp is no step
        numbers[DYNAMICS] = float(np.mean([one.recovery for one in seen]))
        numbers[theory_of(DYNAMICS)] = by_mean_dynamics(case)
    return Found(
        np.mean([one.level for one in seen], axis=0),
        np.mean([one.error for one in seen], axis=0),
        together,
        numbers,
    )
