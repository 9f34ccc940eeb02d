"""What does latency do, and which hold-off goes with it?

A hold-off has two bounds.  It must stay below 1 / rho, or signals do not suffice; and a short one sends d / r
signals before the first of them acts.  They take X = (d / r) n alpha / (rho C) of the capacity.  Up to
X = 0.7 shares are as right as without latency; beyond, demand falls far below the capacity again and again,
and cameras with small shares get too much.  The limit cycle of theory predicts this.  Peaks rise by
n alpha d, and by more where the hold-off is near 1 / rho.
"""  # noqa: D400 - a question

from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, InputError, Problem, solve_optimum, theory
from aimd_des.lowlevel import FloatArray
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, late, run_draws, run_late, totals
from scenarios.common.systems import held, memory_alone, rate
from scenarios.common.tables import beside_theory, number, over_draws, pick, shown, table_of

_START, _SHORT, _LONG = 1_000.0, 5_000.0, 20_000.0
# Up to this X shares are about as right as without latency.
_RIGHT = 0.7
# Looks at total demand a period, for the level that it exceeds for 1 % of the time.
_LOOKS = 2
# Measures, their scale, label and title; the first two are over X, the others over the latency.
_PANELS = (
    ("misallocation", 100.0, "distance from the optimum (%)", "(a) Signals on their way put shares wrong"),
    ("smallest", 100.0, "held by the smallest third (% of optimum)", "(b) Small shares get too large"),
    ("utilisation", 1.0, "mean total demand over capacity", "(c) Beyond 1 / rho demand runs away"),
    ("signals", 1.0, "signals per control period", "(d) Short hold-offs repeat signals"),
)


class Case(NamedTuple):
    """A point: latency and hold-off, in control periods."""

    latency: float
    hold_off: float
    span: float  # of the run, after its start


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system over latencies and hold-offs, with draws of the costs."""
    draws = 2 if quick else 10
    cases = _cases(quick)
    pairs = run_draws(measure, cases, draws, 1, seed, quick, runs)
    table = table_of(pairs, Case._fields, seed, expect)
    x = [taken(*where) for where in zip(table["latency"], table["hold_off"], strict=True)]
    table.insert(len(table.columns) - 1, "taken", x)
    settings = {"seed": seed, "draws": draws, "start": _START, "span": _SHORT, "longer": _LONG}
    printed = shown(table, ["latency", "hold_off", "span", "measure"])
    return Finding("delay", settings, table, printed, _findings(table), {"delay": partial(_figure, table)})


def _cases(quick: bool) -> list[Case]:
    if quick:
        return [Case(*where, 1_000.0) for where in product((0.0, 2.0, 10.0), (0.1, 0.5, 1.0, 2.0))]
    latencies, hold_offs = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0), (0.1, 0.25, 0.5, 1.0, 1.4, 2.0)
    cases = [Case(*where, _SHORT) for where in product(latencies, hold_offs)]
    return [*cases, *(Case(*where, _LONG) for where in product((0.0, 2.0, 10.0), (0.1, 1.0)))]


def taken(latency: float, hold_off: float) -> float:
    """Compute X, what signals on their way take of the capacity."""
    problem = memory_alone()
    return _lift(problem, latency) / (rate(problem) * hold_off)


def smallest(problem: Problem, average: FloatArray) -> float:
    """Compute what the third with the smallest shares holds, over their optimum for what is used."""
    best = solve_optimum(problem, capacity=average.sum(axis=0)).allocation[:, 0]
    third = np.argsort(best)[: len(best) // 3]
    return float(average[third].sum() / best[third].sum())


def measure(case: Case, draw: int, seed: int) -> dict[str, float]:
    """Run and measure one draw of the costs."""
    problem, until = memory_alone(draw=draw), _START + case.span
    looks = np.arange(_START, until, 1.0 / _LOOKS)
    channel = BroadcastChannel(latency=case.latency)
    result = run_late(problem, case.hold_off, channel, (_START, until), seed, looks)
    seen = late(result, _START)
    return {
        "signals": seen.signals,
        "utilisation": seen.utilisation,
        "misallocation": distance(problem, seen.average)[0],
        "smallest": smallest(problem, seen.average),
        # What total demand exceeds for 1 % of the time, over the line.
        "level": np.quantile(totals(result), 0.99) - 1.0 - _lift(problem, case.latency),
        "above": seen.time_above,
    }


def _lift(problem: Problem, latency: float) -> float:
    lift = theory.peak_lift(problem.n_agents, problem.increase[0], latency)
    return float(lift[0] / problem.capacity[0])


def expect(case: Case, draw: int) -> dict[str, float]:
    """Predict signals, use and shares: by the limit cycle, or where demand comes to rest beyond 1 / rho."""
    problem = memory_alone(draw=draw)
    try:
        found = theory.limit_cycle(problem, case.hold_off, case.latency)
    except InputError:
        rest = held(problem, hold_off=case.hold_off, latency=case.latency)
        return {"signals": rest.signals, "utilisation": rest.utilisation}
    return {
        "signals": float(found.signals[0]),
        "utilisation": float(found.utilisation[0]),
        "misallocation": float(distance(problem, found.allocation)[0]),
        "smallest": smallest(problem, found.allocation),
    }


def _figure(table: pd.DataFrame) -> Figure:
    figure, panels = figures.panels(2, 2, (11.0, 9.0))
    short = pick(table, span=table["span"].min())
    for place, (axes, (measure, scale, label, title)) in enumerate(zip(panels, _PANELS, strict=True)):
        rows = pick(short, measure=measure)
        if place < 2:
            rows = rows[(rows["latency"] > 0.5) & (rows["hold_off"] < 1.5)].sort_values("taken")
            by, x, named = "latency", "taken", r"X = (d / r) n$\alpha$ / ($\rho$ C)"
            axes.set(xscale="log", xlim=(0.02, 30.0))
        else:
            by, x, named = "hold_off", "latency", "latency (control periods)"
        figures.curves(axes, x, by, rows, f"{by.replace('_', '-')} {{:g}}", scale=scale)
        figures.named(axes, "theory, without noise")
        axes.set_yscale("log" if measure in ("misallocation", "signals") else "linear")
        figures.dress(axes, title, named, label, numbers="y")
    plain = number(short, measure="misallocation", latency=0.0, hold_off=1.0)
    figures.level(panels[0], 100.0 * plain)
    figures.named(panels[0], "without latency", ":", linewidth=1.0)
    figures.level(panels[1], 100.0)
    figures.level(panels[2], 1.0)
    figures.legends(panels, ncols=2)
    return figure


def _findings(table: pd.DataFrame) -> list[str]:
    short = pick(table, span=table["span"].min())
    least, last, two, ten = float(short["hold_off"].min()), float(short["latency"].max()), 2.0, 10.0

    def say(measure: str, latency: float, hold_off: float = least) -> str:
        scale, digits = (100.0, 1) if measure in ("misallocation", "smallest") else (1.0, 2)
        where: dict[str, Any] = {"measure": measure, "latency": latency, "hold_off": hold_off}
        return beside_theory(short, scale, digits, **where)

    wrong = pick(short, measure="misallocation")
    floor = number(wrong, latency=0.0, hold_off=1.0)
    late = wrong[(wrong["latency"] > 0.0) & (wrong["hold_off"] <= 1.0)]
    right = 100.0 * (late.loc[late["taken"] <= _RIGHT, "mean"] - floor)
    off = 100.0 * late.loc[late["taken"].between(1.2, 1.6), "mean"]
    return sentences(f"""
        - Hold-off {least:g}, latencies 0, {two:g} and {ten:g}: {say("signals", 0.0)};
          {say("signals", two)}; and {say("signals", ten)} signals a period. The mean demand is
          {say("utilisation", 0.0)}; {say("utilisation", two)}; and {say("utilisation", ten)} of the
          capacity. Shares are {say("misallocation", 0.0)}; {say("misallocation", two)}; and
          {say("misallocation", ten)} % off, where theory leaves out the noise.
        - X orders what is wrong with the shares: up to X = {_RIGHT:g}, at hold-offs up to 1 and latencies
          up to {last:g}, they are {right.min():+.1f} to {right.max():+.1f} points from what they are
          without latency; at X of 1.2 to 1.6 they are {off.min():.1f} to {off.max():.1f} % off.
        - The smallest third of the cameras holds {say("smallest", 0.0)} % of its optimum without latency,
          and {say("smallest", ten)} % at latency {ten:g} with hold-off {least:g}.
        - Beyond 1 / rho, {1.0 / rate(memory_alone()):.2f}, demand runs away at any latency: with
          hold-off 2 to {say("utilisation", 0.0, 2.0)} of the capacity without latency, and to
          {say("utilisation", ten, 2.0)} at latency {ten:g}.
        - The level that demand exceeds for 1 % of the time is the line 1 + n alpha d / C and, in points of
          the capacity, {_above(short, 0.0)} without latency and {_above(short, ten)} at latency {ten:g}.
        - Age: in runs of {table["span"].max():,.0f} instead of {short["span"].min():,.0f} shares are
          {_aged(table, 0.0, 1.0)} % off without latency, and {_aged(table, ten, least)} % at latency
          {ten:g} with hold-off {least:g}: noise wears off, and what is wrong stays.
    """)


def _above(short: pd.DataFrame, latency: float) -> str:
    rows = pick(short, measure="level", latency=latency)
    kept = rows[rows["hold_off"].isin((0.5, 1.0, 1.4))]
    return ", ".join(
        f"{over_draws(rows, 100.0, 1, hold_off=hold_off)} (hold-off {hold_off:g})"
        for hold_off in kept["hold_off"]
    )


def _aged(table: pd.DataFrame, latency: float, hold_off: float) -> str:
    where = {"measure": "misallocation", "latency": latency, "hold_off": hold_off}
    ends = (table["span"].max(), table["span"].min())
    return " instead of ".join(over_draws(table, 100.0, 1, span=span, **where) for span in ends)


main = command("delay", study, __doc__)

if __name__ == "__main__":
    main()
