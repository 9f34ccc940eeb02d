"""The study: what is run, and what is made of it."""

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from aimd_des.study import jackknife
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_draws
from scenarios.common.tables import estimate, number, over_draws, pick, reached, shown
from scenarios.unusual_activity.runs import (
    AVERAGINGS,
    ONE,
    STEEP,
    THREE,
    WEIGHT,
    Case,
    Seen,
    expected_scatter,
    fluid,
    measure,
    progress,
    scatter,
    shares,
)

_WINDOW = "window, 200"
_LEFT_OUT = ("forgetting, 300", "forgetting, 30")
# How long after the event begins the demand is looked at, and after its end what is left of the average.
_SOON, _AFTERWARDS = (50.0, 100.0), 200.0
# Where the axis of time ends in the figure.
_NEVER = 320.0


_MEMORIES = tuple(AVERAGINGS)[:2]


class _Found(NamedTuple):
    """What is found of a case: how much of the way demand and average make, (draws, 2, q), and squares.

    These are mean squares of the scatter before the event, (draws,).
    """

    ways: FloatArray
    scatter: FloatArray


class _Size(NamedTuple):
    draws: int
    replications: int  # runs of each draw
    begin: float
    end: float
    until: float
    every: float


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Scale the costs of a camera by 0.2 for a while, for several ways of averaging."""
    size = _Size(2, 2, 150.0, 300.0, 520.0, 10.0) if quick else _Size(20, 4, 600.0, 1100.0, 1500.0, 5.0)
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


def _found(case: Case, outcomes: Sequence[Sequence[Seen]], seed: int) -> _Found:
    ways = [
        progress(case.group, draw, np.mean([[run.demand, run.average] for run in seen], axis=0))
        for draw, seen in enumerate(outcomes, seed)
    ]
    return _Found(
        np.array(ways), np.array([scatter(case, draw, seen) for draw, seen in enumerate(outcomes, seed)])
    )


def _theory(case: Case, draws: Iterable[int]) -> _Found:
    parts = [(fluid(case, draw), expected_scatter(case, draw)) for draw in draws]
    return _Found(np.array([way for way, _ in parts]), np.array([square for _, square in parts]))


_MEASURES = ("demand soon", "average at the end", "half-way after", "90 % after", "left afterwards")


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
    value, error = np.append(value, scattered), np.append(error, wrong)
    known = np.append(_numbers(case, expected.ways.mean(axis=0)), np.sqrt(expected.scatter.mean()))
    labels, count = {"camera": case.group, "averaging": case.averaging, "age": case.begin}, len(found.ways)
    return [
        {**estimate(labels, name, pair, count, wanted), "draws": count, "spread": np.sqrt(count) * pair[1]}
        for name, pair, wanted in zip(
            [*_MEASURES, "scatter before"], zip(value, error, strict=True), known.tolist(), strict=True
        )
    ]


def _figure(found: dict[Case, _Found], theories: dict[Case, _Found], table: pd.DataFrame) -> Figure:
    widths = {"width_ratios": [1.15, 1.15, 1.0]}
    figure, (left, middle, right) = figures.panels(1, 3, (13.5, 4.8), gridspec_kw=widths)
    for axes, group, title in (
        (left, ONE, "(a) Quadratic costs: the average lags"),
        (middle, STEEP, "(b) Power 6: demand overdoes it, to pull the average"),
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


def _row_of(table: pd.DataFrame, group: str, name: str, measured: str) -> dict[str, float]:
    wanted = {"camera": group, "averaging": name, "measure": measured}
    return {key: number(table, key, **wanted) for key in ("mean", "standard_error", "theory")}


def _draw_price(axes: Axes, table: pd.DataFrame) -> None:
    for group, name in product((ONE, STEEP), table["averaging"].unique()):
        half, scatter = (_row_of(table, group, name, part) for part in ("half-way after", "scatter before"))
        shade, marker = colour(_place(name)), "os"[group == STEEP]
        if np.isnan(half["mean"]):
            axes.plot(_NEVER, 100 * scatter["mean"], ">", color=shade, markersize=9.0, clip_on=False)
            place = (_NEVER, 100 * scatter["mean"])
            away: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "fontsize": "small"}
            axes.annotate("not within the event", place, (-10, -13), **away)
            continue
        axes.errorbar(
            half["mean"],
            100 * scatter["mean"],
            200 * scatter["standard_error"],
            2 * half["standard_error"],
            fmt=marker,
            color=shade,
            markersize=6.5,
            capsize=2.5,
        )
        axes.plot(half["theory"], 100 * scatter["theory"], "+", color="black", markersize=9.0, zorder=5)
    for name in AVERAGINGS:
        figures.named(axes, name, "D", color=colour(_place(name)))
    for group, marker in zip((ONE, STEEP), "os", strict=True):
        figures.named(axes, group, marker)
    figures.named(axes, "theory", "+", color="black", markersize=9.0)
    axes.legend(frameon=False, fontsize="small")
    x, y = "half of the way made after (periods)", "scatter of the average before (%)"
    figures.dress(axes, "(c) The price of a short memory", x, y, xlim=(0.0, _NEVER), ylim=(0.0, None))


def _findings(table: pd.DataFrame, case: Case, seed: int) -> list[str]:
    whole, short = _MEMORIES
    lasts, first = case.end - case.begin, case.begin

    def say(
        group: str, name: str, measured: str, scale: float = 100.0, digits: int = 0, age: float = first
    ) -> str:
        wanted = {"camera": group, "averaging": name, "measure": measured, "age": age}
        known = number(table, "theory", **wanted)
        beside = "" if np.isnan(known) else f", theory {scale * known:.{digits}f}"
        return over_draws(table, scale, digits, **wanted) + beside

    def half(group: str, name: str) -> str:
        return say(group, name, "half-way after", 1.0)

    draws = range(seed, seed + int(table["draws"].iloc[0]))
    (old, new), (_, shared) = (np.mean([shares(group, k) for k in draws], axis=0) for group in (ONE, THREE))
    names = table["averaging"].unique()
    halves = pick(table, camera=ONE, measure="half-way after", age=first).dropna(subset="mean")
    there = halves["averaging"].tolist()
    scattered = "; ".join(f"{say(ONE, name, 'scatter before', digits=1)}, with {name}" for name in names)
    soon = f"From period {_SOON[0]:g} to {_SOON[1]:g}"
    return sentences(f"""
        - The optimum of a camera with quadratic costs rises from {old:.2f} to {new:.2f} GB (of each of three:
          {shared:.2f}). {soon} its demand has made {say(ONE, whole, "demand soon")} % of the way over all of
          the past, {say(ONE, short, "demand soon")} with {short}. The average over all of the past has made
          {say(ONE, whole, "average at the end")} % after {lasts:g} periods (of three:
          {say(THREE, whole, "average at the end")} %), and at twice the age
          {say(ONE, whole, "average at the end", age=2.0 * first)} %; with {short} it is half-way after
          {half(ONE, short)}.
        - With costs of power 6 demand answers to the average, and overdoes it. {soon} it has made
          {say(STEEP, whole, "demand soon", 1.0, 1)} times the way; so the average over all of the past is
          half-way after {half(STEEP, whole)} periods, with {short} after {half(STEEP, short)}.
          {_AFTERWARDS:g} periods after the end it keeps {say(STEEP, whole, "left afterwards")} % of the rise.
        - With a window and power 6 {say(STEEP, _WINDOW, "average at the end")} % of the way are made at the
          end, and {say(STEEP, _WINDOW, "left afterwards")} % are left {_AFTERWARDS:g} periods later.
        - Half-way with quadratic costs: {"; ".join(f"{half(ONE, name)}, with {name}" for name in there)}.
        - The price is scatter of the averages before, in %: with quadratic costs {scattered}; with costs of
          power 6 {say(STEEP, whole, "scatter before", digits=1)}, with {whole},
          {say(STEEP, short, "scatter before", digits=1)}, with {short}.
    """)


main = command(
    "unusual_activity",
    study,
    "A camera sees something unusual: how fast does it get more, and what does a short memory cost?",
)
