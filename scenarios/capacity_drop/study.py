"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import colour, shared_legend
from scenarios.capacity_drop.runs import (
    GRAIN,
    LEFT,
    PAPER,
    QUADRATIC,
    WAYS,
    WITHIN,
    Drop,
    Found,
    closed_form,
    error_of,
    measure,
    recover,
    rows_of,
)
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_all, run_draws
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws

_LEVEL, _DRAWN, _SHARES, _SCATTER = (
    "recovery of the level",
    "recovery of the level, over draws",
    "recovery of the shares",
    "scatter of an average",
)
_DYNAMICS = "recovery by mean dynamics"
# Recorded times that the figure shows, over the age at the drop.
_SHOWN = 1.6


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Take 40 % of the capacity away, at once and in a ramp, from agents with three ways of averaging."""
    replications, age, window = (2, 60.0, 80.0) if quick else (16, 600.0, 400.0)
    changes = [(QUADRATIC, 0.0), (QUADRATIC, window / 2), (PAPER, 0.0)]
    cases = [Drop(costs, way, ramp, age, window) for costs, ramp in changes for way in WAYS]
    pairs = run_all(measure, cases, replications, seed, quick, runs)
    table = pd.DataFrame([row for case, found in pairs for row in rows_of(case, found)])
    lefts = (0.6, 0.5) if quick else (0.85, 0.8, 0.7, 0.6, 0.5)
    drops = [Drop(PAPER, way, 0.0, age, window, left) for left in lefts for way in WAYS]
    drops += [Drop(PAPER, way, 0.0, 2.0 * age, window) for way in WAYS]
    drawn_runs = run_draws(recover, drops, 2 if quick else 12, 1, seed, quick, runs)
    table = pd.concat([table, _drawn(drawn_runs, seed)], ignore_index=True)
    settings = {"seed": seed, "replications": replications, "age": age, "window": window}
    printed = shown(table, ["costs", "way", "ramp", "left", "age", "measure"], ".4g")
    drawn = {"capacity_drop": partial(_figure, table, pairs)}
    return Finding("capacity_drop", settings, table, printed, _findings(table, age), drawn)


def _drawn(pairs: list[tuple[Drop, list[list[float]]]], seed: int) -> pd.DataFrame:
    """Make rows of the recovery over draws of the costs; theory is the mean over the same draws."""
    labels = ["costs", "way", "ramp", "left", "age"]
    rows, known = [], []
    for case, found in pairs:
        here = {name: getattr(case, name) for name in labels}
        for draw, (time,) in enumerate(found, seed):
            rows.append({**here, "draw": draw, _DRAWN: time})
            known.append({**here, "draw": draw, _DRAWN: closed_form(case._replace(draw=draw))})
    expected = summarise_draws(known, labels)["mean"].to_numpy()
    return summarise_draws(rows, labels).assign(theory=expected)


def _pick(table: pd.DataFrame, what: str, costs: str = QUADRATIC, *, ramp: bool = False) -> pd.DataFrame:
    """Take a measure, a row for each way of averaging."""
    wanted = (table["measure"] == what) & (table["costs"] == costs) & ((table["ramp"] > 0.0) == ramp)
    return table[wanted].set_index("way").loc[list(WAYS)]


def _figure(table: pd.DataFrame, pairs: list[tuple[Drop, list[Found]]]) -> Figure:
    figure, (left, middle, right, sizes) = figures.panels(2, 2, (12.5, 8.8))
    steps = [(case, found) for case, found in pairs if case.costs == QUADRATIC and not case.ramp]
    _draw_levels(left, steps)
    _draw_times(middle, table, steps[0][0].age)
    _draw_errors(right, steps)
    _draw_sizes(sizes, pick(table, measure=_DRAWN, age=steps[0][0].age), steps[0][0].age)
    shared_legend(figure)
    return figure


def _draw_levels(axes: Axes, steps: list[tuple[Drop, list[Found]]]) -> None:
    axes.axhspan(
        1.0 - WITHIN, 1.0 + WITHIN, color="0.9", linewidth=0.0, label="within 5 % of the new optimum"
    )
    for place, (case, found) in enumerate(steps):
        level = np.mean([run.level for run in found], axis=0)
        time = np.arange(len(level)) - case.age
        axes.plot(time, level, color=colour(place), linewidth=1.8, label=case.way)
        axes.plot([closed_form(case)], [1.0 + WITHIN], "v", color=colour(place), markersize=8.0)
    figures.named(axes, "recovery by theory", "v", markersize=8.0)
    age, x = steps[0][0].age, "time since the drop (control periods)"
    y, limits = "sum of the averages over the new capacity", (-0.5 * age, _SHOWN * age)
    figures.dress(axes, "(a) What is remembered decides", x, y, xlim=limits, ylim=(0.9, 1.75))


def _draw_times(axes: Axes, table: pd.DataFrame, age: float) -> None:
    """Recovery over the age at the drop, by theory and simulated, on the diagonal where they agree."""
    kinds = ((QUADRATIC, False, "o"), (QUADRATIC, True, "s"), (PAPER, False, "^"))
    for costs, ramp, marker in kinds:
        for what, filled in ((_LEVEL, True), (_SHARES, False)):
            rows, size = _pick(table, what, costs, ramp=ramp), 5.0 if filled else 9.0
            for place in range(len(WAYS)):
                x, y = (float(rows[name].to_numpy()[place]) / age for name in ("theory", "mean"))
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
        alone = np.mean([run.error[start:] for run in found], axis=0)
        together = error_of(case, np.mean([run.average[start:] for run in found], axis=0))
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
        rows = pick(table, way=way)
        figures.points(axes, 100 * (1.0 - rows["left"]), rows, place, scale=1.0 / age)
        figures.theory(axes, 100 * (1.0 - rows["left"]), rows, place, scale=1.0 / age)
    x, y = "part of the capacity that is lost (%)", "recovery of the level over the age"
    title = "(d) The window is sooner after large drops only"
    figures.dress(axes, title, x, y, yscale="log")


def _numbers(
    table: pd.DataFrame, what: str, costs: str = QUADRATIC, column: str = "mean", *, ramp: bool = False
) -> dict[str, float]:
    rows = _pick(table, what, costs, ramp=ramp)
    return dict(zip(WAYS, rows[column].astype(float).tolist(), strict=True))


def _listed(values: dict[str, float], digits: int = 0) -> str:
    first, second, third = (f"{values[way]:.{digits}f}" for way in WAYS)
    return f"{first}, {second} and {third}"


def _followed(table: pd.DataFrame) -> str:
    """List what the mean dynamics give for steps."""
    rows = table[table["measure"] == _DYNAMICS].set_index(["costs", "way"])["theory"]
    pairs = (f"{rows[costs, WAYS[0]]:.0f} and {rows[costs, WAYS[2]]:.0f}" for costs in (QUADRATIC, PAPER))
    return "; ".join(pairs) + " periods"


def _findings(table: pd.DataFrame, age: float) -> list[str]:
    level, steep = _numbers(table, _LEVEL), _numbers(table, _LEVEL, PAPER)
    plain = _numbers(table, _LEVEL, column="plain_theory")
    long = [plain[way] / level[way] - 1.0 for way in WAYS]
    rows = table[table["measure"] == _LEVEL]
    off = float((rows["mean"] / rows["theory"] - 1.0).abs().max())
    scatter, expected = _numbers(table, _SCATTER), _numbers(table, _SCATTER, column="theory")
    bent = _numbers(table, _SCATTER, PAPER)["forgetting"]
    damped = _numbers(table, _SCATTER, PAPER, "theory")["forgetting"]
    drawn = pick(table, measure=_DRAWN, age=age)
    sizes = "; ".join(
        f"{100 * (1 - share):.0f} % lost: "
        + " and ".join(
            f"{way} {over_draws(drawn, 1.0, 0, way=way, left=share)}, theory "
            f"{number(drawn, 'theory', way=way, left=share):.0f}"
            for way in WAYS[1:]
        )
        for share in drawn["left"].unique()
    )
    late = pick(table, measure=_DRAWN, age=2.0 * age)
    older = "; ".join(f"{way} {over_draws(late, 1.0, 0, way=way)}" for way in WAYS)
    left = {way: 100 * value for way, value in _numbers(table, "error left in one run").items()}
    steps = table[table["measure"] == _DYNAMICS]
    apart = float((steps["mean"] / steps["theory"] - 1.0).abs().max())
    return sentences(f"""
        - Quadratic costs, drop at age {age:g}: the sum of the averages is within 5 % of the new capacity
          after {_listed(level)} periods (cumulative, window, forgetting). Theory is within {100 * off:.1f} %
          of this, of ramps and of the paper's memory, given what is used by prediction; as if all of the
          capacity were used it is {100 * min(long):.0f} to {100 * max(long):.0f} % too long.
        - The mean dynamics, `theory.recovery`, know nothing of this but the problems: they give
          {_followed(table)} (cumulative and forgetting; quadratic costs, then the paper's memory), within
          {100 * apart:.1f} % of what `Result.recovery` measures.
        - Shares of quadratic costs recover in {_listed(_numbers(table, _SHARES))} periods, those of the
          paper's memory in {_listed(_numbers(table, _SHARES, PAPER))}, its sum in {_listed(steep)}: the
          optimum is not only scaled there.
        - The price: at the drop an agent's average scatters by
          {_listed({way: 100 * value for way, value in scatter.items()}, 1)} % (theory
          {_listed({way: 100 * value for way, value in expected.items()}, 1)}), and when the sum has recovered
          a single run is {_listed(left)} % from the optimum. Steeper costs damp the scatter: {100 * bent:.1f}
          % (theory {100 * damped:.1f}) for the paper's memory with forgetting.
        - Which short memory is sooner depends on the drop. The paper's memory, over draws of the costs:
          {sizes}.
        - At twice the age, and a drop of {100 * (1 - LEFT):.0f} %, it is {older}.
    """)


main = command("capacity_drop", study, "How fast do averages follow when 40 % of a capacity is lost?")
