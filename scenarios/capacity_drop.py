"""How fast do averages follow when 40 % of a capacity is lost, and what does a shorter memory cost?

The paper's average over the whole run takes eight times its age at the drop until it is within 5 % of the new
optimum. A window of 400 periods takes 0.9 of its length. Forgetting with half of that as its time constant
has the same noise: after a drop of 20 % it takes a sixth less, after 40 % a quarter more. A ramp is much like
a step at its middle. Formulas are within 3 % once they know how much of the capacity is used. The price is
noise: with short memories an agent's average scatters by 12 %, and no single run comes within 5 %.
"""  # noqa: D400 - a question

from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import ndtr

from aimd_des import PolynomialCosts, Problem, Recording, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import CapacityRamp, CapacityStep
from aimd_des.lowlevel import FloatArray
from aimd_des.metrics import relative_error
from aimd_des.plots import colour, shared_legend
from aimd_des.study import jackknife, mean_and_error
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_draws, sensed
from scenarios.common.systems import memory_alone, optimum, predicted, used
from scenarios.common.tables import beside_theory, number, pick, shown, table_of, theory_of

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

    def problem(self, share: float = 1.0) -> Problem:
        """Make what is shared, with a share of the capacity."""
        return _problem(self.costs, self.draw, share)

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
    time: float  # in which the level recovers
    recovery: float  # the same, as the result measures it


class Found(NamedTuple):
    """What runs of one draw of the costs come to: in the mean, and beside it what theory has."""

    level: FloatArray  # (q,)
    alone: FloatArray  # (r,): relative error of single runs
    together: FloatArray  # (r,): relative error of the averages over all runs
    numbers: dict[str, float]  # by measure; theory of X is called that


@lru_cache
def _problem(costs: str, draw: int, share: float) -> Problem:
    """Make memory alone, or costs c_i x**2 with the same optimum, with a share of the capacity."""
    problem = memory_alone(normalization=1 / 180, draw=draw)
    if costs == QUADRATIC:
        best = solve_optimum(problem)
        factors = best.multipliers[0] / (2.0 * best.allocation[:, 0])
        problem = Problem(problem.resources, PolynomialCosts([2], factors[:, None, None]))
    memory = replace(problem.resources[0], capacity=share * float(problem.capacity[0]))
    return Problem([memory], problem.costs)


@lru_cache
def closed_form(case: Drop, *, plain: bool = False) -> float:
    """Predict the time from the start of the change until the level is within 5 % of the new capacity.

    Plain: as if all of the capacity were used from the first instant on.
    """
    problem = case.problem()
    before, after, within = float(problem.capacity[0]), case.left * float(problem.capacity[0]), WITHIN
    if not plain:
        full, left = (used(case.problem(share)) for share in (1.0, case.left))
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
    known = partial(theory.convergence, dynamics="continuous", averaging=case.averaging)
    before, after = (known(case.problem(share)) for share in (1.0, case.left))
    return float(theory.recovery(before, after, case.age).time("level", within=WITHIN)[0])


def mean_field(case: Drop) -> FloatArray:
    """Follow the means alone, (r, n) each grain: demand is shared as averages ask for, averages follow."""
    problem, steps = case.problem(), round(case.until / GRAIN)
    start = predicted(problem).allocation[:, 0]
    history = [start] * (round(case.age / GRAIN) + 1)
    average = start * (1.0 - filling(problem) / case.age) if case.way == "cumulative" else start.copy()
    kept = [average] * len(history)
    for step in range(len(history), steps + 1):
        part = min((step * GRAIN - case.age) / case.ramp, 1.0) if case.ramp else 1.0
        full, left = (used(case.problem(share)) for share in (1.0, case.left))
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
    capacity, end = case.left * float(case.problem().capacity[0]), case.age + case.ramp
    step = CapacityStep("memory", case.age, capacity)
    ramp = CapacityRamp("memory", case.age, end, capacity, steps=round(case.ramp)) if case.ramp else None
    simulation = sensed(
        case.problem(),
        0.0,
        averaging=case.averaging,
        interventions=[ramp or step],
        seed=seed,
        recording=Recording(demand=1.0, allocations=GRAIN, overshoot=False),
    )
    result = simulation.run(case.until)
    seen, error = result.observations, result.tracking["relative_error"].to_numpy()
    level = seen.total_average[:, 0] / capacity
    recovery = float(result.recovery(within=WITHIN)["recovery_time"].to_numpy()[-1])
    return Run(level, seen.average[:, 0, :], error, _last_outside(level - 1.0, case.age, 1.0), recovery)


def recover(drop: Drop, draw: int, seed: int) -> dict[str, float]:
    """Measure how long the level takes with a draw of the costs, and what theory has for it."""
    case = drop._replace(draw=draw)
    return {LEVEL: run(case, seed).time, theory_of(LEVEL): closed_form(case)}


def _last_outside(values: FloatArray, start: float, grain: float) -> float:
    """Time from the start of the change to the last record outside; to the end if it is."""
    after = np.asarray(values)[round(start / grain) :]
    outside = np.flatnonzero(np.abs(after) > WITHIN)
    return float(grain * (outside[-1] + 0.5)) if len(outside) else 0.0


def error_of(case: Drop, averages: FloatArray) -> FloatArray:
    """Compute the relative error against the new optimum at each record, (r,)."""
    best = optimum(case.problem(case.left))[:, None]
    return np.array([relative_error(row[:, None], best)[0] for row in averages])


def _of_shares(case: Drop, averages: FloatArray) -> float:
    return _last_outside(error_of(case, averages), case.age, GRAIN)


def _with_noise(case: Drop, errors: FloatArray) -> FloatArray:
    """Expect the relative error of the mean field plus normal noise with these standard errors, (r,)."""
    best = optimum(case.problem(case.left))
    away, noise = mean_field(case) - best, np.maximum(errors, 1e-12)
    inside = away / noise
    size = noise * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * inside**2) + away * (2.0 * ndtr(inside) - 1.0)
    return np.asarray(size.sum(axis=1) / best.sum())


def _spread(case: Drop) -> float:
    """Predict the scatter of agents' averages at the drop; NaN where no closed form is known."""
    problem = case.problem()
    expected = predicted(problem)
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
    numbers = {
        LEVEL: float(np.mean([one.time for one in seen])),
        theory_of(LEVEL): closed_form(case),
        SHARES: float(jackknife(averages, partial(_of_shares, case))[0]),
        theory_of(SHARES): _last_outside(_with_noise(case, noise), case.age, GRAIN),
        SCATTER: float(np.sqrt((at_drop.var(axis=0, ddof=1) / at_drop.mean(axis=0) ** 2).mean())),
        theory_of(SCATTER): _spread(case),
        ERROR: float(np.mean([one.error[-1] for one in seen])),
    }
    if case.way != "window" and not case.ramp:  # whose past is not followed there, and a ramp is no step
        numbers[DYNAMICS] = float(np.mean([one.recovery for one in seen]))
        numbers[theory_of(DYNAMICS)] = by_mean_dynamics(case)
    level, alone = (np.mean([getattr(one, name) for one in seen], axis=0) for name in ("level", "error"))
    return Found(level, alone, error_of(case, mean), numbers)


_LABELS = ["costs", "way", "ramp", "left", "age"]
# Recorded times that the figure shows, over the age at the drop.
_SHOWN = 1.6


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Take 40 % of the capacity away, at once and in a ramp, from agents with three ways of averaging."""
    draws, each, age, window = (2, 2, 60.0, 80.0) if quick else (12, 16, 600.0, 400.0)
    job = partial(run_draws, draws=draws, replications=1, seed=seed, quick=quick, runs=runs)
    steps = [Drop(costs, way, 0.0, age, window) for costs in (QUADRATIC, PAPER) for way in WAYS]
    pairs = job(partial(measure, each), steps)
    others = [Drop(QUADRATIC, way, window / 2, age, window) for way in WAYS]
    lefts = (0.5,) if quick else (0.85, 0.8, 0.7, 0.5)
    others += [Drop(PAPER, way, 0.0, age, window, left) for left in lefts for way in WAYS]
    others += [Drop(PAPER, way, 0.0, 2.0 * age, window) for way in WAYS]
    numbers = [(case, [[one.numbers] for (one,) in found]) for case, found in pairs]
    table = table_of([*numbers, *job(recover, others)], _LABELS, seed)
    settings = {"seed": seed, "draws": draws, "runs of each": each, "age": age, "window": window}
    # As if all of the capacity were used, in the mean over the draws.
    cases = [[case._replace(draw=seed + k) for k in range(draws)] for case in steps[: len(WAYS)]]
    plain = [float(np.mean([closed_form(case, plain=True) for case in part])) for part in cases]
    printed = shown(table, [*_LABELS, "measure"], ".4g")
    courses = {case.way: [one for (one,) in found] for case, found in pairs[: len(WAYS)]}
    drawn = {"capacity_drop": partial(_figure, table, courses, age)}
    return Finding("capacity_drop", settings, table, printed, _findings(table, age, plain), drawn)


def _usual(table: pd.DataFrame) -> pd.DataFrame:
    """Take the rows of drops of the usual size, at the usual age."""
    return pick(table, left=LEFT, age=table["age"].min())


def _figure(table: pd.DataFrame, courses: dict[str, list[Found]], age: float) -> Figure:
    figure, (left, middle, right, sizes) = figures.panels(2, 2, (12.5, 8.8))
    _draw_levels(left, table, courses, age)
    _draw_times(middle, _usual(table), age)
    _draw_errors(right, courses, age)
    rows = pick(table, measure=LEVEL, age=age, costs=PAPER).sort_values("left", kind="stable")
    # In the order of (a), which has the ways in the legend.
    figures.curves(sizes, "lost", "way", rows.assign(lost=100 * (1.0 - rows["left"])), "", scale=1.0 / age)
    x, y = "part of the capacity that is lost (%)", "recovery of the level over the age"
    figures.dress(sizes, "(d) A window recovers sooner after large drops only", x, y, yscale="log")
    shared_legend(figure)
    return figure


def _mean(found: list[Found], name: str) -> FloatArray:
    """Average a course over draws, up to where the first of them ends."""
    courses = [getattr(one, name) for one in found]
    return np.asarray(np.mean([course[: min(map(len, courses))] for course in courses], axis=0))


def _draw_levels(axes: Axes, table: pd.DataFrame, courses: dict[str, list[Found]], age: float) -> None:
    band = "within 5 % of the new optimum"
    axes.axhspan(1.0 - WITHIN, 1.0 + WITHIN, color="0.9", linewidth=0.0, label=band)
    known = pick(_usual(table), measure=LEVEL, costs=QUADRATIC, ramp=0.0)
    for place, (way, found) in enumerate(courses.items()):
        level = _mean(found, "level")
        axes.plot(np.arange(len(level)) - age, level, color=colour(place), linewidth=1.8, label=way)
        recovery = number(known, "theory", way=way)
        axes.plot([recovery], [1.0 + WITHIN], "v", color=colour(place), markersize=8.0)
    figures.named(axes, "recovery by theory", "v", markersize=8.0)
    x = "time since the drop (control periods)"
    y, limits = "sum of the averages over the new capacity", (-0.5 * age, _SHOWN * age)
    figures.dress(axes, "(a) Averages reach the new capacity", x, y, xlim=limits, ylim=(0.9, 1.75))


def _draw_times(axes: Axes, table: pd.DataFrame, age: float) -> None:
    """Recovery over the age at the drop, by theory and simulated, on the diagonal where they agree."""
    marks = {(QUADRATIC, False): "o", (QUADRATIC, True): "s", (PAPER, False): "^"}
    for (costs, ramp), marker in marks.items():
        here = table[(table["costs"] == costs) & ((table["ramp"] > 0.0) == ramp)]
        for what, size, order in ((LEVEL, 5.0, 3), (SHARES, 9.0, 2)):
            for way, known, mean in pick(here, measure=what)[["way", "theory", "mean"]].to_numpy():
                shade = colour(WAYS.index(way))
                look: dict[str, Any] = {"color": shade, "markersize": size, "zorder": order}
                face = shade if what == LEVEL else "white"
                axes.plot([known / age], [mean / age], marker, markerfacecolor=face, **look)
        figures.named(axes, f"{costs}, {'ramp' if ramp else 'step'}", marker)
    figures.named(axes, "of the shares", "o", markerfacecolor="white", markersize=9.0)
    ends = (0.5, 12.0)
    axes.plot(ends, ends, color=figures.REFERENCE, linewidth=1.0, zorder=1)
    limits: dict[str, Any] = {"xscale": "log", "yscale": "log", "xlim": ends, "ylim": ends}
    across, up = (f"recovery {how} over the age at the drop" for how in ("by theory", "simulated"))
    figures.dress(axes, "(b) Theory against runs", across, up, **limits)


def _draw_errors(axes: Axes, courses: dict[str, list[Found]], age: float) -> None:
    start = round(age / GRAIN)
    for place, found in enumerate(courses.values()):
        alone, together = (_mean(found, name)[start:] for name in ("alone", "together"))
        time = GRAIN * np.arange(len(alone))
        axes.plot(time, 100 * alone, color=colour(place), linewidth=1.8)
        axes.plot(time, 100 * together, color=colour(place), linewidth=1.2, linestyle="--")
    figures.named(axes, "a single run", linewidth=1.8)
    figures.named(axes, "averages over all runs", "--", linewidth=1.2)
    figures.level(axes, 100 * WITHIN)
    x, y = "time since the drop (control periods)", "distance from the new optimum (%)"
    limits, title = (0.0, _SHOWN * age), "(c) A short memory keeps a random error"
    figures.dress(axes, title, x, y, xlim=limits, ylim=(0.0, 70.0))


def _findings(table: pd.DataFrame, age: float, plain: list[float]) -> list[str]:
    rows, usual = pick(table, measure=LEVEL), _usual(table)
    off = float((rows["mean"] / rows["theory"] - 1.0).abs().max())
    sums = pick(usual, measure=LEVEL, costs=QUADRATIC, ramp=0.0)
    long = [value / number(sums, way=way) - 1.0 for way, value in zip(WAYS, plain, strict=True)]

    def each(what: str, costs: str = QUADRATIC, scale: float = 1.0, digits: int = 0, **ramp: float) -> str:
        """List a measure for all ways that have it."""
        there = pick(usual, measure=what, costs=costs, **({"ramp": 0.0} | ramp))
        return "; ".join(f"{way} {beside_theory(there, scale, digits, way=way)}" for way in there["way"])

    say = partial(beside_theory, digits=0)
    drawn = pick(table, measure=LEVEL, age=age, costs=PAPER)
    sizes = "; ".join(
        f"{100 * (1 - share):.0f} % lost: "
        + " and ".join(f"{way} {say(drawn, way=way, left=share)}" for way in WAYS[1:])
        for share in np.unique(drawn["left"])[::-1]
    )
    late = pick(table, measure=LEVEL, age=2.0 * age)
    older = "; ".join(f"{way} {say(late, way=way)}" for way in WAYS)
    return sentences(f"""
        - Quadratic costs, drop at age {age:g}: the sum of the averages is within 5 % of the new capacity
          after {each(LEVEL)} periods. Theory is within {100 * off:.1f} % of all sums, of ramps and of the
          paper's memory, given what is used by prediction; as if all of the capacity were used it is
          {100 * min(long):.0f} to {100 * max(long):.0f} % too long.
        - The mean dynamics, `theory.recovery`, know nothing of this but the problems; `Result.recovery` has
          {each(DYNAMICS)} periods for quadratic costs, and {each(DYNAMICS, PAPER)} for the paper's memory.
        - A ramp takes {each(LEVEL, ramp=usual["ramp"].max())} periods from its start.
        - Shares of quadratic costs recover in {each(SHARES)} periods, those of the paper's memory in
          {each(SHARES, PAPER)}, its sum in {each(LEVEL, PAPER)}: the optimum is not only scaled there.
        - The price: at the drop an agent's average scatters by {each(SCATTER, QUADRATIC, 100.0, 1)} %, and
          when the sum has recovered a single run is {each(ERROR, QUADRATIC, 100.0, 1)} % from the optimum.
          Steeper costs damp the scatter: {each(SCATTER, PAPER, 100.0, 1)} % for the paper's memory.
        - Which short memory is sooner depends on the drop. The paper's memory: {sizes}.
        - At twice the age, and a drop of {100 * (1 - LEFT):.0f} %, it is {older}.
    """)


main = command("capacity_drop", study, __doc__)

if __name__ == "__main__":
    main()
