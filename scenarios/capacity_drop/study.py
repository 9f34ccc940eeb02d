"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from scenarios.capacity_drop.runs import (
    DYNAMICS,
    ERROR,
    GRAIN,
    LEFT,
    LEVEL,
    PAPER,
    QUADRATIC,
    SCATTER,
    SHARES,
    WAYS,
    WITHIN,
    Drop,
    Found,
    closed_form,
    measure,
    recover,
)
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_draws
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws, theory_of, with_theory

_LABELS = ["costs", "way", "ramp", "left", "age"]
# Recorded times that the figure shows, over the age at the drop.
_SHOWN = 1.6


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Take 40 % of the capacity away, at once and in a ramp, from agents with three ways of averaging."""
    draws, each, age, window = (2, 2, 60.0, 80.0) if quick else (12, 16, 600.0, 400.0)
    job = partial(run_draws, draws=draws, replications=1, seed=seed, quick=quick, runs=runs)
    steps = [Drop(costs, way, 0.0, age, window) for costs in (QUADRATIC, PAPER) for way in WAYS]
    pairs = [(case, [one for (one,) in found]) for case, found in job(partial(measure, each), steps)]
    others = [Drop(QUADRATIC, way, window / 2, age, window) for way in WAYS]
    lefts = (0.5,) if quick else (0.85, 0.8, 0.7, 0.5)
    others += [Drop(PAPER, way, 0.0, age, window, left) for left in lefts for way in WAYS]
    others += [Drop(PAPER, way, 0.0, 2.0 * age, window) for way in WAYS]
    rows = [
        {**_labels(case), "draw": draw, **one.numbers}
        for case, found in pairs
        for draw, one in enumerate(found, seed)
    ]
    rows += [
        {**_labels(case), "draw": draw, LEVEL: time, theory_of(LEVEL): closed_form(case._replace(draw=draw))}
        for case, found in job(recover, others)
        for draw, (time,) in enumerate(found, seed)
    ]
    table = with_theory(summarise_draws(rows, _LABELS), _LABELS)
    settings = {"seed": seed, "draws": draws, "runs of each": each, "age": age, "window": window}
    # As if all of the capacity were used, in the mean over the draws.
    plain = {
        case.way: float(
            np.mean([closed_form(case._replace(draw=seed + k), plain=True) for k in range(draws)])
        )
        for case in steps[: len(WAYS)]
    }
    printed = shown(table, [*_LABELS, "measure"], ".4g")
    drawn = {"capacity_drop": partial(_figure, table, pairs)}
    return Finding("capacity_drop", settings, table, printed, _findings(table, age, plain), drawn)


def _labels(case: Drop) -> dict[str, Any]:
    return {name: getattr(case, name) for name in _LABELS}


def _pick(table: pd.DataFrame, what: str, costs: str = QUADRATIC, *, ramp: bool = False) -> pd.DataFrame:
    """Take a measure of the drop that is usual, a row for each way of averaging that has it."""
    usual = (table["left"] == LEFT) & (table["age"] == table["age"].min())
    wanted = usual & (table["measure"] == what) & (table["costs"] == costs) & ((table["ramp"] > 0.0) == ramp)
    rows: pd.DataFrame = table[wanted]
    return rows


def _figure(table: pd.DataFrame, pairs: list[tuple[Drop, list[Found]]]) -> Figure:
    figure, (left, middle, right, sizes) = figures.panels(2, 2, (12.5, 8.8))
    steps, age = pairs[: len(WAYS)], pairs[0][0].age
    _draw_levels(left, steps)
    _draw_times(middle, table, age)
    _draw_errors(right, steps)
    _draw_sizes(sizes, pick(table, measure=LEVEL, age=age, costs=PAPER), age)
    shared_legend(figure)
    return figure


def _mean(found: list[Found], name: str) -> FloatArray:
    """Average a course over draws, up to where the first of them ends."""
    courses = [getattr(one, name) for one in found]
    return np.asarray(np.mean([course[: min(map(len, courses))] for course in courses], axis=0))


def _draw_levels(axes: Axes, steps: list[tuple[Drop, list[Found]]]) -> None:
    axes.axhspan(
        1.0 - WITHIN, 1.0 + WITHIN, color="0.9", linewidth=0.0, label="within 5 % of the new optimum"
    )
    for place, (case, found) in enumerate(steps):
        level = _mean(found, "level")
        time = np.arange(len(level)) - case.age
        axes.plot(time, level, color=colour(place), linewidth=1.8, label=case.way)
        recovery = np.mean([one.numbers[theory_of(LEVEL)] for one in found])
        axes.plot([recovery], [1.0 + WITHIN], "v", color=colour(place), markersize=8.0)
    figures.named(axes, "recovery by theory", "v", markersize=8.0)
    age, x = steps[0][0].age, "time since the drop (control periods)"
    y, limits = "sum of the averages over the new capacity", (-0.5 * age, _SHOWN * age)
    figures.dress(axes, "(a) What is remembered decides", x, y, xlim=limits, ylim=(0.9, 1.75))


def _draw_times(axes: Axes, table: pd.DataFrame, age: float) -> None:
    """Recovery over the age at the drop, by theory and simulated, on the diagonal where they agree."""
    kinds = ((QUADRATIC, False, "o"), (QUADRATIC, True, "s"), (PAPER, False, "^"))
    for costs, ramp, marker in kinds:
        for what, filled in ((LEVEL, True), (SHARES, False))[: 1 if ramp else 2]:
            rows, size = _pick(table, what, costs, ramp=ramp), 5.0 if filled else 9.0
            for place, way in enumerate(WAYS):
                x, y = (number(rows, name, way=way) / age for name in ("theory", "mean"))
                face, order = colour(place) if filled else "white", 3 if filled else 2
                look: dict[str, Any] = {"color": colour(place), "markerfacecolor": face, "zorder": order}
                axes.plot([x], [y], marker, markersize=size, **look)
        figures.named(axes, f"{costs}, {'ramp' if ramp else 'step'}", marker)
    figures.named(axes, "of the shares", "o", markerfacecolor="white", markersize=9.0)
    ends = (0.5, 12.0)
    axes.plot(ends, ends, color=figures.REFERENCE, linewidth=1.0, zorder=1)
    across, up = (f"recovery {how} over the age at the drop" for how in ("by theory", "simulated"))
    figures.dress(
        axes, "(b) Theory against runs", across, up, xscale="log", yscale="log", xlim=ends, ylim=ends
    )


def _draw_errors(axes: Axes, steps: list[tuple[Drop, list[Found]]]) -> None:
    for place, (case, found) in enumerate(steps):
        start = round(case.age / GRAIN)
        alone, together = (_mean(found, name)[start:] for name in ("alone", "together"))
        time = GRAIN * np.arange(len(alone))
        axes.plot(time, 100 * alone, color=colour(place), linewidth=1.8)
        axes.plot(time, 100 * together, color=colour(place), linewidth=1.2, linestyle="--")
    figures.named(axes, "a single run", linewidth=1.8)
    figures.named(axes, "averages over all runs", "--", linewidth=1.2)
    figures.level(axes, 100 * WITHIN)
    x, y = "time since the drop (control periods)", "distance from the new optimum (%)"
    limits, title = (0.0, _SHOWN * steps[0][0].age), "(c) A short memory never gets there: noise"
    figures.dress(axes, title, x, y, xlim=limits, ylim=(0.0, 70.0))


def _draw_sizes(axes: Axes, table: pd.DataFrame, age: float) -> None:
    for place, way in enumerate(WAYS):
        rows = pick(table, way=way).sort_values("left")
        figures.points(axes, 100 * (1.0 - rows["left"]), rows, place, scale=1.0 / age)
        figures.theory(axes, 100 * (1.0 - rows["left"]), rows, place, scale=1.0 / age)
    x, y = "part of the capacity that is lost (%)", "recovery of the level over the age"
    title = "(d) The window is sooner after large drops only"
    figures.dress(axes, title, x, y, yscale="log")


def _findings(table: pd.DataFrame, age: float, plain: dict[str, float]) -> list[str]:
    rows = table[table["measure"] == LEVEL]
    off = float((rows["mean"] / rows["theory"] - 1.0).abs().max())
    long = [plain[way] / number(_pick(table, LEVEL), way=way) - 1.0 for way in WAYS]

    def say(rows: pd.DataFrame, scale: float = 1.0, digits: int = 0, **wanted: Any) -> str:
        known = float(pick(rows, **wanted)["theory"].iloc[0])
        beside = "" if np.isnan(known) else f", theory {scale * known:.{digits}f}"
        return over_draws(rows, scale, digits, **wanted) + beside

    def each(what: str, costs: str = QUADRATIC, scale: float = 1.0, digits: int = 0, **how: Any) -> str:
        """List a measure for all ways that have it."""
        there = _pick(table, what, costs, **how)
        return "; ".join(f"{way} {say(there, scale, digits, way=way)}" for way in there["way"])

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
        - A ramp takes {each(LEVEL, ramp=True)} periods from its start.
        - Shares of quadratic costs recover in {each(SHARES)} periods, those of the paper's memory in
          {each(SHARES, PAPER)}, its sum in {each(LEVEL, PAPER)}: the optimum is not only scaled there.
        - The price: at the drop an agent's average scatters by {each(SCATTER, QUADRATIC, 100.0, 1)} %, and
          when the sum has recovered a single run is {each(ERROR, QUADRATIC, 100.0, 1)} % from the optimum.
          Steeper costs damp the scatter: {each(SCATTER, PAPER, 100.0, 1)} % for the paper's memory.
        - Which short memory is sooner depends on the drop. The paper's memory: {sizes}.
        - At twice the age, and a drop of {100 * (1 - LEFT):.0f} %, it is {older}.
    """)


main = command("capacity_drop", study, "How fast do averages follow when 40 % of a capacity is lost?")
