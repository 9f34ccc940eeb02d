"""What does latency do, and what does a longer hold-off do about it?

Every peak rises by n alpha d, the growth over the latency d, and no hold-off changes that. What a
hold-off must not do is starve the agents: it must stay below 1 / rho (1.6 periods here) whatever
the latency. One that is as long as the latency lets demand run away from latency 2 on. A short one
repeats signals that are still on their way, which costs bits and little else.
"""  # noqa: D400 - a question

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import Crossing, theory
from aimd_des.plots import shared_legend
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import Run, measure_all
from scenarios.common.systems import held, memory_alone, rate
from scenarios.common.tables import pick, shown

_PROBLEM = memory_alone()
_MATCHED = "hold-off = latency"
_HOLD_OFFS = {f"hold-off {value:g}": value for value in (0.5, 1.0, 5.0)}

_PANELS = (
    ("peak", "highest total demand over capacity", "(a) Every period of latency lifts the peak"),
    ("utilisation", "mean total demand over capacity", "(b) A long hold-off lets demand run away"),
    ("signals", "signals per control period", "(c) Signals"),
)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with latencies from 0 to 20 periods, for several hold-offs."""
    replications, until = (2, 240.0) if quick else (12, 1500.0)
    latencies = (0.0, 1.0, 5.0, 20.0) if quick else (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0)
    cases: list[tuple[dict[str, Any], Run]] = []
    for latency in latencies:
        matched = {_MATCHED: latency} if latency > 0.0 else {}
        for name, hold_off in {**_HOLD_OFFS, **matched}.items():
            labels = {"setting": name, "latency": latency, "hold_off": hold_off}
            unit = Crossing(hold_off)
            cases.append((labels, Run(_PROBLEM, until, until // 3, "continuous", unit, latency)))
    table, _ = measure_all(cases, replications, seed, quick, runs)
    table["theory"] = [_expected(row) for row in table.to_dict("records")]
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = shown(
        table[table["measure"].isin([name for name, *_ in _PANELS])], ["setting", "latency", "measure"]
    )
    return Finding("delay", settings, table, printed, _findings(table), {"delay": partial(_figure, table)})


def _lift(latency: float) -> float:
    lift = theory.peak_lift(_PROBLEM.n_agents, _PROBLEM.increase[0], latency)
    return float(lift[0] / _PROBLEM.capacity[0])


def _expected(row: dict[Any, Any]) -> float:
    """Predict one number of the table; NaN where theory assumes what does not hold."""
    latency, hold_off, measure = row["latency"], row["hold_off"], row["measure"]
    if measure == "peak":
        return 1.0 + _lift(latency)
    suffices = rate(_PROBLEM) * hold_off < 1.0
    if measure not in ("signals", "utilisation") or (suffices and hold_off < latency):
        return np.nan  # more than one signal is on its way for one excess
    return held(_PROBLEM, hold_off=hold_off, latency=latency)[int(measure == "utilisation")]


def _figure(table: pd.DataFrame) -> Figure:
    figure, panels = figures.panels(1, 3, (13.0, 4.6))
    for axes, (measure, label, title) in zip(panels, _PANELS, strict=True):
        _draw(axes, pick(table, measure=measure), measure)
        figures.dress(axes, title, "latency (control periods)", label, numbers="y")
    shared_legend(figure)
    return figure


def _draw(axes: Axes, table: pd.DataFrame, measure: str) -> None:
    for place, name in enumerate([*_HOLD_OFFS, _MATCHED]):
        rows = pick(table, setting=name)
        look: dict[str, Any] = {"linestyle": ":", "linewidth": 0.8, "markersize": 8.0 - 1.2 * place}
        figures.points(axes, rows["latency"], rows, place, name, **look)
        if measure != "peak":
            figures.theory(axes, rows["latency"], rows, place)
    if measure == "peak":
        axes.plot([0.0, 20.0], [1.0 + _lift(0.0), 1.0 + _lift(20.0)], color=figures.REFERENCE, linewidth=1.5)
    figures.named(axes, "theory")


def _findings(table: pd.DataFrame) -> list[str]:
    peaks = pick(table, setting="hold-off 0.5", measure="peak")
    gap = float((peaks["mean"] - peaks["theory"]).abs().max())
    longest = float(table["latency"].max())
    short, unit = (
        pick(table, setting=name, measure="utilisation")["mean"] for name in ("hold-off 0.5", "hold-off 1")
    )
    signals = pick(table, setting="hold-off 0.5", measure="signals")
    long = pick(table, setting="hold-off 5", measure="utilisation")["mean"]
    matched = pick(table, setting=_MATCHED, measure="utilisation")
    rho = rate(_PROBLEM)
    away = matched.loc[matched["hold_off"] * rho >= 1.0]
    return sentences(f"""
        - With hold-off 0.5 the highest peak is 1 + n alpha d / C to within {100 * gap:.1f} points of the
          capacity, up to {peaks["mean"].max():.2f} of it at latency {longest:g}.
        - What the hold-off must not do is starve the agents: {rho:.2f} signals per unit of time are needed,
          so it must stay below {1.0 / rho:.2f}, whatever the latency. With hold-off 5 the mean demand is
          {long.mean():.2f} of the capacity; a hold-off as long as the latency runs away from latency
          {away["latency"].min():g} on, to {away["mean"].max():.1f} of the capacity.
        - A hold-off shorter than the latency repeats signals that are still on their way: with hold-off 0.5
          up to {signals["mean"].max():.2f} signals per unit of time instead of {signals["mean"].iloc[0]:.2f},
          and the mean demand lies between {short.min():.2f} and {short.max():.2f} of the capacity (hold-off
          1: {unit.min():.2f} to {unit.max():.2f}).
    """)


main = command("delay", study, "What does latency do, and what does a longer hold-off do about it?")

if __name__ == "__main__":
    main()
