"""What changes when agents grow and answer in continuous time instead of on one clock?

Signals: rho per unit of time against rho / (1 + rho) per step, as on the clock agents that answer do not
grow.  That the clock uses more of the capacities is the sampling: continuous agents whose control unit
samples once a period use as much, with the same peaks.  What acts a step later costs the clock some of that
again, and lifts peaks; continuous agents gain by it.  Shares are farther off on the clock: fewer signals
leave more noise.
"""  # noqa: D400 - a question

from collections.abc import Iterable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import Crossing, Problem, Sampled, theory
from aimd_des.plots import shared_legend
from models.smart_cameras import smart_cameras
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import Measures, Run, measure, run_draws
from scenarios.common.tables import over_draws, pick, shown, summarise_draws


class _Way(NamedTuple):
    dynamics: Literal["discrete", "continuous"]
    unit: Sampled | Crossing
    latency: float = 0.0
    period: float = 0.0
    # Steps of growth that the highest total can have on top of the capacity.
    steps_above: float = 0.0


_CLOCK, _LATER = "clock", "clock, acts a step later"
_LOOKS, _LOOKS_LATER = "continuous, sampled", "continuous, sampled, latency 1"
_CROSSING, _CROSSING_LATER = "continuous, crossing", "continuous, crossing, latency 1"
WAYS = {
    _CLOCK: _Way("discrete", Sampled(), steps_above=1.0),
    _LATER: _Way("discrete", Sampled(), 1.0, steps_above=2.0),
    _LOOKS: _Way("continuous", Sampled(), period=1.0, steps_above=1.0),
    _LOOKS_LATER: _Way("continuous", Sampled(), 1.0, 1.0, steps_above=2.0),
    _CROSSING: _Way("continuous", Crossing(0.0)),
    _CROSSING_LATER: _Way("continuous", Crossing(1.0), 1.0, steps_above=1.0),
}
# What is told apart: the way with it, less the way without.
_CAUSES = {
    "sampling, continuous": (_LOOKS, _CROSSING),
    "the clock, sampled": (_CLOCK, _LOOKS),
    "a step later, clock": (_LATER, _CLOCK),
    "a step later, sampled": (_LOOKS_LATER, _LOOKS),
    "a step later, crossing": (_CROSSING_LATER, _CROSSING),
}
_START = 250.0
_MEASURES = ["signals", "utilisation", "peak", "misallocation"]
_PANELS = (
    ("signals", 1.0, "signals per unit of time", "(a) Signals: rho, rho / (1 + rho)"),
    ("utilisation", 100.0, "averages over capacity (%)", "(b) Use: what samples uses more"),
    ("peak", 100.0, "highest total over capacity (%)", "(c) Highest total"),
    ("misallocation", 100.0, "distance from the optimum (%)", "(d) Misallocation of single runs"),
)


class Case(NamedTuple):
    """A run: its way and its length."""

    way: str
    until: float


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run the paper's system in six ways, with draws of the costs, for two lengths."""
    draws, lengths = (2, (350.0,)) if quick else (10, (1_000.0, 4_000.0))
    cases = [Case(way, until) for until in lengths for way in WAYS]
    names = smart_cameras(0).resource_names
    ways = pd.DataFrame(
        [
            {**case._asdict(), "resource": names[j], "draw": draw}
            | {key: float(getattr(one, key)[j]) for key in _MEASURES}
            for case, found in run_draws(measured, cases, draws, 1, seed, quick, runs)
            for draw, (one,) in enumerate(found)
            for j in range(len(names))
        ]
    )
    causes = [_less(ways, cause, until) for until in lengths for cause in _CAUSES]
    table = summarise_draws(pd.concat([ways, *causes]), ["way", "until", "resource"])
    expected = {name: _expected(way, range(seed, seed + draws)) for name, way in WAYS.items()}
    table["theory"] = [
        expected.get(row["way"], {}).get(row["measure"], np.full(3, np.nan))[names.index(row["resource"])]
        for row in table.to_dict("records")
    ]
    settings = {"seed": seed, "draws": draws, "start": _START, "until": lengths[-1]}
    printed = shown(table, ["way", "until", "resource", "measure"])
    drawn = {"continuous_vs_discrete": partial(_figure, pick(table, until=lengths[-1]), names)}
    return Finding("continuous_vs_discrete", settings, table, printed, _findings(table, names), drawn)


def _less(runs: pd.DataFrame, cause: str, until: float) -> pd.DataFrame:
    """Subtract what one way has from what another has, draw by draw; signals are divided."""
    one, other = (
        pick(runs, way=way, until=until).set_index(["resource", "draw"])[_MEASURES] for way in _CAUSES[cause]
    )
    less = (one - other).assign(signals=one["signals"] / other["signals"])
    return less.assign(way=cause, until=until).reset_index()


def measured(case: Case, draw: int, seed: int) -> Measures:
    """Run one draw of the costs in one way."""
    way = WAYS[case.way]
    return measure(Run(_problem(draw), case.until, _START, way.dynamics, way.unit, way.latency), seed)


@lru_cache
def _problem(draw: int) -> Problem:
    return smart_cameras(draw)


def _expected(way: _Way, draws: Iterable[int]) -> dict[str, Any]:
    """Predict the means over these draws, and how high totals can be."""
    found = [
        theory.predict(_problem(draw), way.dynamics, latency=way.latency, period=way.period) for draw in draws
    ]
    growth = _problem(0).increase.sum(axis=0) / _problem(0).capacity
    return {
        "signals": np.mean([one.signals for one in found], axis=0),
        "utilisation": np.mean([one.utilisation for one in found], axis=0),
        "peak": 1.0 + way.steps_above * growth,
    }


def _figure(table: pd.DataFrame, resources: tuple[str, ...]) -> Figure:
    figure, panels = figures.panels(1, 4, (13.5, 4.6))
    for axes, (name, factor, label, title) in zip(panels, _PANELS, strict=True):
        _draw(axes, pick(table, measure=name), list(resources), factor)
        from_zero: dict[str, Any] = {"ylim": (0.0, None)} if name in ("signals", "misallocation") else {}
        figures.dress(axes, title, y=label, numbers="y", **from_zero)
        axes.grid(visible=False, axis="x")
        if not from_zero:
            figures.level(axes, 100.0)
    shared_legend(figure)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, resources: list[str], factor: float) -> None:
    for place, way in enumerate(WAYS):
        mine = pick(rows, way=way)
        beside = np.arange(len(resources)) + 0.13 * (place - 2.5)
        expected = factor * mine["theory"]
        axes.hlines(expected, beside - 0.06, beside + 0.06, color="black", linewidth=1.4, zorder=3)
        figures.points(axes, beside, mine, place, way, scale=factor, markersize=6.0)
    figures.named(axes, "theory", color="black")
    axes.set_xticks(range(len(resources)), resources)


def _findings(table: pd.DataFrame, names: tuple[str, ...]) -> list[str]:
    lengths = table["until"].max(), table["until"].min()

    def say(way: str, name: str, digits: int = 1, until: float = lengths[0]) -> str:
        scale = 1.0 if name == "signals" else 100.0
        rows = pick(table, way=way, measure=name, until=until)
        return " / ".join(over_draws(rows, scale, digits, resource=resource) for resource in names)

    def peak(way: str) -> str:
        values = 100.0 * (pick(table, way=way, measure="peak", until=lengths[0])["mean"] - 1.0)
        return f"{values.min():.1f} to {values.max():.1f} %"

    used = {cause: say(cause, "utilisation") for cause in _CAUSES}
    off = [say(way, "misallocation", until=until) for until in lengths for way in (_CLOCK, _CROSSING)]
    return sentences(f"""
        - Signals, {" / ".join(names)}: the clock has {say("the clock, sampled", "signals", 2)} of those of
          continuous agents that are sampled: 1 / (1 + rho).
        - Sampling makes continuous agents use {used["sampling, continuous"]} points more than ideal
          crossings, with totals up to {peak(_LOOKS)} above the capacity. The clock adds
          {used["the clock, sampled"]} points to that, with totals up to {peak(_CLOCK)}.
        - A signal that acts a step later changes the use of the clock by {used["a step later, clock"]}
          points, of continuous agents by {used["a step later, sampled"]} (sampled) and
          {used["a step later, crossing"]} (crossings). Totals go up to {peak(_LATER)}, {peak(_LOOKS_LATER)}
          and {peak(_CROSSING_LATER)} above the capacity.
        - Misallocation of a run of {lengths[0]:,.0f}, its start included, is {off[0]} % on the clock and
          {off[1]} % with crossings; of one of {lengths[1]:,.0f} it is {off[2]} and {off[3]} %.
    """)


main = command("continuous_vs_discrete", study, __doc__)

if __name__ == "__main__":
    main()
