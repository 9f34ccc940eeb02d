"""A camera sees something unusual: how fast does it get more, and what does a short memory cost?

Demand answers at once, over tens of periods, as the response probability does; the average follows as
fast as its memory allows. Over all of the past, a camera with quadratic costs has made 43 % of the way
after 500 periods. One with steep costs arrives by holding far more than its new share for a while, and
less than it afterwards. Forgetting with time constant 100 is half-way after 126 and 45 periods, and costs
a scatter of the averages of 13 and 8 % instead of 8 and 4 %.
"""  # noqa: D400 - a question

from collections.abc import Sequence
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import Recording, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import UnusualActivity
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from aimd_des.study import jackknife
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import quietly, run_draws, sensed
from scenarios.common.systems import alike, elasticity, memory_alone, optimum, predicted, used
from scenarios.common.tables import beside_theory, estimate, pick, reached, shown

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
    """Cameras that see the event, how all average, its begin and end, the end of the run, the sampling."""

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
    """What is seen of one run, in units of the resource."""

    course: FloatArray  # (2, q): demand and average of the cameras with the event, in the mean over them
    before: FloatArray  # (n,): averages of all cameras as the event begins


@lru_cache
def groups(draw: int) -> dict[str, tuple[int, ...]]:
    """Choose the cameras that see the event: of medium share, with quadratic and with the steepest costs.

    By their costs; the last group is three cameras with quadratic costs.
    """
    problem = memory_alone(draw=draw)
    x = optimum(problem)
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
        memory_alone(draw=draw),
        _HOLD_OFF,
        averaging=AVERAGINGS[case.averaging],
        interventions=[UnusualActivity(own, case.begin, case.end, WEIGHT)],
        seed=seed,
        recording=Recording(demand="end", allocations=case.times, overshoot=False),
    )
    seen = quietly(simulation, case.until).observations
    start = int(np.searchsorted(seen.allocation_times, case.begin))
    course = np.array([part[:, 0, own].mean(axis=1) for part in (seen.demand, seen.average)])
    return Seen(course, seen.average[start, 0])


@lru_cache
def shares(group: str, draw: int) -> tuple[float, float]:
    """Compute the mean of these cameras in the optimum for what is used, before and during the event."""
    problem, own = memory_alone(draw=draw), list(groups(draw)[group])
    weights, capacity = np.ones(problem.n_agents), [used(problem)]
    weights[own] = WEIGHT
    old = solve_optimum(problem, capacity=capacity)
    new = theory.reweighted_optimum(problem, weights, capacity=capacity)
    before, after = (float(best.allocation[own, 0].mean()) for best in (old, new))
    return before, after


def progress(group: str, draw: int, values: FloatArray) -> FloatArray:
    """Compute how much of the way from the old to the new share has been made."""
    old, new = shares(group, draw)
    return np.asarray((values - old) / (new - old))


@lru_cache
def fluid(case: Case, draw: int) -> FloatArray:
    """Compute what demand and average, (2, q), of these cameras make of the way in the fluid."""
    own, problem = groups(draw)[case.group], memory_alone(draw=draw)
    event = theory.Spell(case.begin, case.end, own, WEIGHT)
    averaging = AVERAGINGS[case.averaging]
    path = theory.flow(problem, used(problem), case.until, averaging, [event], step=0.5)
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
    problem = memory_alone(draw=draw)
    return alike(problem, float(elasticity(problem)[groups(draw)[group][0]]))


def expected_scatter(case: Case, draw: int) -> float:
    """Predict the scatter of averages just before the event, for cameras with costs as steep as each other.

    As a mean of squares; NaN where there is no formula, which is for steep costs with an average that does
    not forget.
    """
    agents, problem = kin(case.group, draw), memory_alone(draw=draw)
    averaging, expected, steep = AVERAGINGS[case.averaging], predicted(problem), elasticity(problem)[agents]
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


_WINDOW = "window, 200"
_LEFT_OUT = ("forgetting, 300", "forgetting, 30")
# How long after the event begins the demand is looked at, and after its end what is left of the average.
_SOON, _AFTERWARDS = (50.0, 100.0), 200.0
# Where the axis of time ends in the figure.
_NEVER = 320.0
_MEMORIES = tuple(AVERAGINGS)[:2]
_HALF, _SCATTER = "half-way after", "scatter before"
_MEASURES = ("demand soon", "average at the end", _HALF, "90 % after", "left afterwards", _SCATTER)


class _Found(NamedTuple):
    """What is found of a case: how much of the way demand and average make, (draws, 2, q), and squares.

    These are mean squares of the scatter before the event, (draws,).
    """

    ways: FloatArray
    scatter: FloatArray


class _Size(NamedTuple):
    """How much is run, by default at the full size."""

    draws: int = 20
    replications: int = 4  # runs of each draw
    begin: float = 600.0
    end: float = 1100.0
    until: float = 1500.0
    every: float = 5.0


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Scale the costs of a camera by 0.2 for a while, for several ways of averaging."""
    size = _Size(2, 2, 150.0, 300.0, 520.0, 10.0) if quick else _Size()
    names = [name for name in AVERAGINGS if not (quick and name in _LEFT_OUT)]
    kinds = [*product((ONE, STEEP), names), *product((THREE,), _MEMORIES)]
    cases = [Case(group, name, *size[2:]) for group, name in kinds]
    cases.append(_older(cases[0]))
    pairs = run_draws(measure, cases, size.draws, size.replications, seed, quick, runs)
    found = {case: _found(case, outcomes, seed) for case, outcomes in pairs}
    theories = {case: _theory(case, range(seed, seed + size.draws)) for case in cases}
    table = pd.DataFrame([row for case in cases for row in _rows(case, found[case], theories[case])])
    settings = {"seed": seed, **size._asdict(), "weight": WEIGHT}
    printed = shown(table, ["camera", "averaging", "age", "measure"], ".3g")
    drawn = {"unusual_activity": partial(_figure, found, theories, table)}
    return Finding("unusual_activity", settings, table, printed, _findings(table, cases[0], seed), drawn)


def _older(case: Case) -> Case:
    """Make the same event at twice the age."""
    begin, end, until = (time + case.begin for time in (case.begin, case.end, case.until))
    return case._replace(begin=begin, end=end, until=until)


def _found(case: Case, outcomes: Sequence[Sequence[Seen]], first: int) -> _Found:
    draws = list(enumerate(outcomes, first))
    ways = [progress(case.group, draw, np.mean([run.course for run in seen], axis=0)) for draw, seen in draws]
    return _Found(np.array(ways), np.array([scatter(case, draw, seen) for draw, seen in draws]))


def _theory(case: Case, draws: Sequence[int]) -> _Found:
    scattered = [expected_scatter(case, draw) for draw in draws]
    return _Found(np.array([fluid(case, draw) for draw in draws]), np.array(scattered))


def _numbers(case: Case, way: FloatArray) -> FloatArray:
    """Reduce what demand and average, (2, q), make of the way to the measures."""
    times, (demand, average) = case.since, way
    during = (times >= 0.0) & (times <= case.end - case.begin)
    soon = (times >= _SOON[0]) & (times <= _SOON[1])
    ends, afterwards = np.searchsorted(times, [case.end - case.begin, case.end - case.begin + _AFTERWARDS])
    half, most = (reached(times[during], average[during], part) for part in (0.5, 0.9))
    return np.array([demand[soon].mean(), average[ends], half, most, average[afterwards]])


def _rows(case: Case, found: _Found, expected: _Found) -> list[dict[str, Any]]:
    """Measure the mean over draws, as a draw may not get there at all; each beside what theory has."""
    value, error = jackknife(list(found.ways), partial(_numbers, case))
    scattered, wrong = jackknife(list(found.scatter), np.sqrt)
    known = np.append(_numbers(case, expected.ways.mean(axis=0)), np.sqrt(expected.scatter.mean()))
    labels, count = {"camera": case.group, "averaging": case.averaging, "age": case.begin}, len(found.ways)
    parts = (np.append(value, scattered), np.append(error, wrong), known)
    return [
        {
            **estimate(labels, name, (mean, away), count, float(wanted)),
            "draws": count,
            "spread": np.sqrt(count) * away,
        }
        for name, mean, away, wanted in zip(_MEASURES, *parts, strict=True)
    ]


def _figure(found: dict[Case, _Found], theories: dict[Case, _Found], table: pd.DataFrame) -> Figure:
    widths = {"width_ratios": [1.15, 1.15, 1.0]}
    figure, (left, middle, right) = figures.panels(1, 3, (13.5, 4.8), gridspec_kw=widths)
    for axes, group, title in (
        (left, ONE, "(a) Quadratic costs: the average lags"),
        (middle, STEEP, "(b) Power 6: demand overshoots and moves the average"),
    ):
        _draw_course(axes, group, found, theories, title)
    middle.legend(frameon=False, fontsize="small")
    _draw_price(right, pick(table, age=table["age"].min()))
    return figure


def _place(name: str) -> int:
    return list(AVERAGINGS).index(name)


def _draw_course(
    axes: Axes, group: str, found: dict[Case, _Found], theories: dict[Case, _Found], title: str
) -> None:
    for name in _MEMORIES:
        case = next(case for case in found if (case.group, case.averaging) == (group, name))
        expected = theories[case].ways.mean(axis=0)
        figures.course(axes, case.since, list(found[case].ways), expected, colour(_place(name)))
        figures.named(axes, f"{name} (thin: demand)", color=colour(_place(name)), linewidth=2.2)
    end = case.end - case.begin
    steps = [case.since[0], 0.0, 0.0, end, end, case.since[-1]], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]
    axes.plot(*steps, "--", color=figures.REFERENCE, linewidth=1.2, label="optimum")
    figures.named(axes, "theory (fluid)", ":", color="black", linewidth=0.9)
    x, y = "time since the event began (periods)", "part of the way to the new share"
    figures.dress(axes, title, x, y)


def _draw_price(axes: Axes, table: pd.DataFrame) -> None:
    for group, name in product((ONE, STEEP), table["averaging"].unique()):
        rows = pick(table, camera=group, averaging=name).set_index("measure")
        half, scatter = rows.loc[_HALF], 100 * rows.loc[_SCATTER, ["mean", "standard_error", "theory"]]
        shade, marker = colour(_place(name)), "os"[group == STEEP]
        if np.isnan(half["mean"]):
            axes.plot(_NEVER, scatter["mean"], ">", color=shade, markersize=9.0, clip_on=False)
            away: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "fontsize": "small"}
            axes.annotate("not within the event", (_NEVER, scatter["mean"]), (-10, -13), **away)
            continue
        errors = 2 * scatter["standard_error"], 2 * half["standard_error"]
        look: dict[str, Any] = {"fmt": marker, "color": shade, "markersize": 6.5, "capsize": 2.5}
        axes.errorbar(half["mean"], scatter["mean"], *errors, **look)
        axes.plot(half["theory"], scatter["theory"], "+", color="black", markersize=9.0, zorder=5)
    for name in AVERAGINGS:
        figures.named(axes, name, "D", color=colour(_place(name)))
    for group, marker in zip((ONE, STEEP), "os", strict=True):
        figures.named(axes, group, marker)
    figures.named(axes, "theory", "+", color="black", markersize=9.0)
    axes.legend(frameon=False, fontsize="small")
    x, y = "half of the way made after (periods)", "scatter of the average before (%)"
    figures.dress(axes, "(c) Random error of a short memory", x, y, xlim=(0.0, _NEVER), ylim=(0.0, None))


def _findings(table: pd.DataFrame, case: Case, seed: int) -> list[str]:
    whole, short = _MEMORIES
    lasts, first = case.end - case.begin, case.begin

    def say(
        group: str, name: str, measured: str, scale: float = 100.0, digits: int = 0, age: float = first
    ) -> str:
        wanted = {"camera": group, "averaging": name, "measure": measured, "age": age}
        return beside_theory(table, scale, digits, **wanted)

    def half(group: str, name: str) -> str:
        return say(group, name, _HALF, 1.0)

    draws = range(seed, seed + int(table["draws"].iloc[0]))
    (old, new), (_, shared) = (np.mean([shares(group, k) for k in draws], axis=0) for group in (ONE, THREE))
    names = table["averaging"].unique()
    halves = pick(table, camera=ONE, measure=_HALF, age=first).dropna(subset="mean")
    there = halves["averaging"].tolist()
    scattered = "; ".join(f"{say(ONE, name, _SCATTER, digits=1)}, with {name}" for name in names)
    soon = f"From period {_SOON[0]:g} to {_SOON[1]:g}"
    return sentences(f"""
        - The optimum of a camera with quadratic costs rises from {old:.2f} to {new:.2f} GB (of each of three:
          {shared:.2f}). {soon} its demand has made {say(ONE, whole, "demand soon")} % of the way over all of
          the past, {say(ONE, short, "demand soon")} with {short}. The average over all of the past has made
          {say(ONE, whole, "average at the end")} % after {lasts:g} periods (of three:
          {say(THREE, whole, "average at the end")} %), and at twice the age
          {say(ONE, whole, "average at the end", age=2.0 * first)} %; with {short} it is half-way after
          {half(ONE, short)}.
        - With costs of power 6 demand answers to the average, and overshoots. {soon} it has made
          {say(STEEP, whole, "demand soon", 1.0, 1)} times the way; so the average over all of the past is
          half-way after {half(STEEP, whole)} periods, with {short} after {half(STEEP, short)}.
          {_AFTERWARDS:g} periods after the end it keeps {say(STEEP, whole, "left afterwards")} % of the rise.
        - With a window and power 6 {say(STEEP, _WINDOW, "average at the end")} % of the way are made at the
          end, and {say(STEEP, _WINDOW, "left afterwards")} % are left {_AFTERWARDS:g} periods later.
        - Half-way with quadratic costs: {"; ".join(f"{half(ONE, name)}, with {name}" for name in there)}.
        - Scatter of the averages before, in %: with quadratic costs {scattered}; with costs of
          power 6 {say(STEEP, whole, _SCATTER, digits=1)}, with {whole},
          {say(STEEP, short, _SCATTER, digits=1)}, with {short}.
    """)


main = command("unusual_activity", study, __doc__)

if __name__ == "__main__":
    main()
