"""The study: what is run, and what is made of it."""

from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from aimd_des.study import jackknife, replicate
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.systems import alike, elasticity
from scenarios.common.tables import estimate, number, reached, said, shown
from scenarios.unusual_activity.runs import (
    AVERAGINGS,
    PROBLEM,
    WEIGHT,
    Seen,
    Size,
    expected_scatter,
    fluid,
    groups,
    measure,
    shares,
)

_LEFT_OUT = ("forgetting, 300", "forgetting, 30")
# How long after the event begins the demand is looked at, and after its end what is left of the average.
_SOON, _AFTERWARDS = (50.0, 100.0), 200.0
# Where the axis of time ends in the figure.
_NEVER = 320.0


_Found = dict[tuple[str, str], list[Seen]]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Scale the costs of a camera by 0.2 for a while, for several ways of averaging."""
    size = Size(4, 150.0, 300.0, 520.0, 10.0) if quick else Size(60, 600.0, 1100.0, 1500.0, 5.0)
    one, steep, three = groups()
    names = [name for name in AVERAGINGS if not (quick and name in _LEFT_OUT)]
    cases = [(group, name) for group in (one, steep) for name in names]
    cases += [(three, name) for name in names[:2]]
    jobs = [partial(measure, groups()[group], name, size) for group, name in cases]
    outcomes = replicate(jobs, size.replications, seed, workers=1 if quick else None, out=runs)
    found = dict(zip(cases, outcomes, strict=True))
    table = pd.DataFrame([row for case, runs in found.items() for row in _rows(*case, size, runs)])
    settings = {"seed": seed, **size._asdict(), "weight": WEIGHT}
    printed = shown(table, ["camera", "averaging", "measure"], ".3g")
    drawn = {"unusual_activity": partial(_figure, found, table, size)}
    return Finding("unusual_activity", settings, table, printed, _findings(table, size), drawn)


def _progress(cameras: tuple[int, ...], values: FloatArray) -> FloatArray:
    """Compute how much of the way from the old to the new share has been made."""
    old, new = shares(cameras)
    return np.asarray((values - old) / (new - old))


_MEASURES = ("demand soon", "average at the end", "half-way after", "90 % after", "left afterwards")


def _numbers(cameras: tuple[int, ...], size: Size, both: FloatArray) -> FloatArray:
    """Reduce demand and average, (2, q), to the measures."""
    times, (demand, average) = size.times - size.begin, _progress(cameras, both)
    during = (times >= 0.0) & (times <= size.end - size.begin)
    soon = (times >= _SOON[0]) & (times <= _SOON[1])
    ends, afterwards = np.searchsorted(times, [size.end - size.begin, size.end - size.begin + _AFTERWARDS])
    half, most = (reached(times[during], average[during], part) for part in (0.5, 0.9))
    return np.array([demand[soon].mean(), average[ends], half, most, average[afterwards]])


def _rows(group: str, name: str, size: Size, runs: Sequence[Seen]) -> list[dict[str, Any]]:
    cameras = groups()[group]
    both = [np.array([run.demand, run.average]) for run in runs]
    value, error = jackknife(both, partial(_numbers, cameras, size))
    expected = _numbers(cameras, size, np.array(fluid(cameras, name, size)))
    kin = alike(PROBLEM, float(elasticity(PROBLEM)[cameras[0]]))  # so many that scatter can be measured
    moments = [np.array([run.before, run.before**2])[:, kin] for run in runs]
    scatter, wrong = jackknife(moments, _scatter)
    value, error = np.append(value, scatter), np.append(error, wrong)
    expected = np.append(expected, expected_scatter(kin, name, size))
    labels, names = {"camera": group, "averaging": name}, [*_MEASURES, "scatter before"]
    found = zip(names, zip(value, error, strict=True), expected.tolist(), strict=True)
    return [estimate(labels, measure, pair, len(runs), wanted) for measure, pair, wanted in found]


def _scatter(moments: FloatArray) -> FloatArray:
    """Compute the coefficient of variation of averages over replications, the root of a mean of squares."""
    mean, square = moments
    return np.asarray(np.sqrt(np.mean(square / mean**2 - 1.0)))


def _figure(found: _Found, table: pd.DataFrame, size: Size) -> Figure:
    widths = {"width_ratios": [1.15, 1.15, 1.0]}
    figure, (left, middle, right) = figures.panels(1, 3, (13.5, 4.8), gridspec_kw=widths)
    one, steep, _ = groups()
    _draw_course(left, found, one, size, "(a) Quadratic costs: the average lags")
    _draw_course(middle, found, steep, size, "(b) Power 6: demand overdoes it, to pull the average")
    middle.legend(frameon=False, fontsize="small")
    _draw_price(right, table)
    return figure


def _place(name: str) -> int:
    return list(AVERAGINGS).index(name)


def _draw_course(axes: Axes, found: _Found, group: str, size: Size, title: str) -> None:
    cameras, times = groups()[group], size.times - size.begin
    for name in list(AVERAGINGS)[:2]:
        courses = [[run.demand, run.average] for run in found[group, name]]
        figures.course(axes, times, courses, fluid(cameras, name, size), colour(_place(name)))
    old, new = shares(cameras)
    end = size.end - size.begin
    steps = [times[0], 0.0, 0.0, end, end, times[-1]], [old, old, new, new, old, old]
    axes.plot(*steps, "--", color=figures.REFERENCE, linewidth=1.2, label="optimum")
    for name in list(AVERAGINGS)[:2]:
        figures.named(axes, f"{name} (thin: demand)", color=colour(_place(name)), linewidth=2.2)
    figures.named(axes, "theory (fluid)", ":", color="black", linewidth=0.9)
    x, y = "time since the event began (periods)", "memory of the camera (GB)"
    figures.dress(axes, title, x, y, ylim=(0.0, None))


def _row_of(table: pd.DataFrame, group: str, name: str, measured: str) -> dict[str, float]:
    wanted = {"camera": group, "averaging": name, "measure": measured}
    return {key: number(table, key, **wanted) for key in ("mean", "standard_error", "theory")}


def _draw_price(axes: Axes, table: pd.DataFrame) -> None:
    for group, name in product(list(groups())[:2], table["averaging"].unique()):
        half, scatter = (_row_of(table, group, name, part) for part in ("half-way after", "scatter before"))
        shade, marker = colour(_place(name)), "os"[list(groups()).index(group)]
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
    for group, marker in zip(list(groups())[:2], "os", strict=True):
        figures.named(axes, group, marker)
    figures.named(axes, "theory", "+", color="black", markersize=9.0)
    axes.legend(frameon=False, fontsize="small")
    x, y = "half of the way made after (periods)", "scatter of the average before (%)"
    figures.dress(axes, "(c) The price of a short memory", x, y, xlim=(0.0, _NEVER), ylim=(0.0, None))


def _findings(table: pd.DataFrame, size: Size) -> list[str]:
    (one, steep, three), (whole, short) = groups(), list(AVERAGINGS)[:2]

    def say(group: str, name: str, measured: str, scale: float = 100.0, digits: int = 0) -> str:
        return said(table, scale, digits, camera=group, averaging=name, measure=measured)

    def half(group: str, name: str) -> str:
        return say(group, name, "half-way after", 1.0)

    (old, new), (_, shared) = shares(groups()[one]), shares(groups()[three])
    names = table["averaging"].unique()
    scatter = ", ".join(f"{say(one, name, 'scatter before', digits=1)} with {name}" for name in names)
    soon = f"From period {_SOON[0]:g} to {_SOON[1]:g}"
    return sentences(f"""
        - The optimum of a camera with quadratic costs rises from {old:.2f} to {new:.2f} GB (of each of three:
          {shared:.2f}). {soon} its demand has made {say(one, whole, "demand soon")} % of the way, whatever
          the memory. The average over all of the past has made {say(one, whole, "average at the end")} %
          after {size.end - size.begin:g} periods (of three: {say(three, whole, "average at the end")} %);
          with {short} it is half-way after {half(one, short)}.
        - With costs of power 6 demand answers to the average, and overdoes it. {soon} it has made
          {say(steep, whole, "demand soon", 1.0, 1)} times the way; so the average over all of the past is
          half-way after {half(steep, whole)} periods, with {short} after {half(steep, short)}.
          {_AFTERWARDS:g} periods after the end it keeps {say(steep, whole, "left afterwards")} % of the rise.
        - The price is scatter of the averages before, in %: with quadratic costs {scatter}; with costs of
          power 6 {say(steep, whole, "scatter before", digits=1)} with {whole},
          {say(steep, short, "scatter before", digits=1)} with {short}.
    """)


main = command(
    "unusual_activity",
    study,
    "A camera sees something unusual: how fast does it get more, and what does a short memory cost?",
)
