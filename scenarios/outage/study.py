"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import colour, shared_legend
from aimd_des.study import mean_and_error
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_all
from scenarios.common.tables import pick, shown
from scenarios.outage.runs import (
    AFTER,
    ALL,
    BEFORE,
    COARSE,
    FAILOVER,
    FAULTS,
    GRAIN,
    HALF,
    HOLD_OFF,
    OTHER,
    PACE,
    PART,
    Found,
    Outage,
    expected,
    measure,
)

# What the figure shows in detail.
_SHOWN_DURATION, _SHOWN_LATENCY = 20.0, 0.5
# Over how many of the last periods it is measured how halves end.
_LATE = 30


def _gap(run: Found, case: Outage) -> float:
    """Share of the gap between the halves that is left a time x / alpha after healing."""
    heal = round((BEFORE + case.duration + case.latency) / (GRAIN * COARSE))
    gaps = run.holdings[:, 0] - run.holdings[:, 1]
    return float(gaps[heal + round(PACE)] / gaps[heal])


def _rows(case: Outage, found: list[Found]) -> list[dict[str, Any]]:
    runaway, back = expected(case)
    everybody = case.fault != PART
    fall = 0.5 * runaway * (back - case.latency)
    measured = {
        "run-away": ([run.runaway for run in found], runaway),
        "room below the bound": ([case.bound - run.runaway for run in found], np.nan),
        "time to come back": ([run.back for run in found], back),
        "overload": ([run.excess for run in found], 0.5 * runaway**2 * PACE + fall if everybody else np.nan),
        "extra of the even half": ([float(run.extra[HALF].mean()) for run in found], np.nan),
        "extra of the odd half": ([float(run.extra[OTHER].mean()) for run in found], np.nan),
    }
    if not everybody and case.duration >= _SHOWN_DURATION:
        measured["gap left after x / alpha"] = ([_gap(run, case) for run in found], float(np.exp(-1.0)))
        for side, name in enumerate(("even", "odd")):
            ends = [float(run.holdings[-_LATE:, side].mean()) for run in found]
            measured[f"{name} half at the end"] = (ends, np.nan)
    labels = {"fault": case.fault, "latency": case.latency, "duration": case.duration}
    rows = []
    for name, (values, wanted) in measured.items():
        mean, error = mean_and_error(values)
        numbers = {"mean": float(mean), "standard_error": float(error), "least": min(values)}
        rows.append({**labels, "measure": name, **numbers, "theory": wanted, "replications": len(found)})
    return rows


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Silence memory of the paper's system for up to 40 periods, in three ways and behind three latencies."""
    replications, settled = (2, 60.0) if quick else (16, 200.0)
    durations = (5.0, 20.0) if quick else (2.0, 5.0, 10.0, 20.0, 40.0)
    latencies = (0.5,) if quick else (0.0, 0.5, 1.0)
    cases = [
        Outage(fault, duration, latency, settled)
        for fault in FAULTS
        for latency in latencies
        for duration in durations
    ]
    pairs = run_all(measure, cases, replications, seed, quick, runs)
    table = pd.DataFrame([row for case, found in pairs for row in _rows(case, found)])
    watched = {case.fault: found for case, found in pairs if case[1:3] == (_SHOWN_DURATION, _SHOWN_LATENCY)}
    settings = {"seed": seed, "replications": replications, "settled": settled, "hold-off": HOLD_OFF}
    printed = shown(
        table[table["measure"].isin(["run-away", "time to come back", "overload"])],
        ["fault", "latency", "duration", "measure"],
        ".3f",
    )
    drawn = {"outage": partial(_figure, table, watched)}
    return Finding("outage", settings, table, printed, _findings(table), drawn)


def _figure(table: pd.DataFrame, watched: dict[str, list[Found]]) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (13.0, 4.6))
    _draw_totals(left, watched)
    _draw_runaways(middle, pick(table, measure="run-away", latency=_SHOWN_LATENCY))
    _draw_halves(right, watched[PART])
    shared_legend(figure)
    return figure


def _draw_totals(axes: Axes, watched: dict[str, list[Found]]) -> None:
    axes.axvspan(0.0, _SHOWN_DURATION, color="0.93", linewidth=0.0)
    for place, (fault, found) in enumerate(watched.items()):
        total = np.mean([run.total for run in found], axis=0)
        time = GRAIN * np.arange(len(total)) - BEFORE
        style = "--" if fault == FAILOVER else "-"
        axes.plot(time, total, style, color=colour(place), linewidth=1.8, label=fault)
    end = _SHOWN_DURATION + _SHOWN_LATENCY
    ink = figures.REFERENCE
    axes.plot([0.0, end], [1.0, 1.0 + end / PACE], color=ink, linewidth=1.2, linestyle=":")
    line = {"arrowstyle": "-"}
    axes.annotate("bound", (12.0, 1.0 + 12.0 / PACE), (2.0, 1.75), color=ink, arrowprops=line)
    low = axes.get_xaxis_transform()
    axes.text(0.5 * _SHOWN_DURATION, 0.03, "outage", ha="center", color=ink, transform=low)
    x, y = "time since the outage began (periods)", "total demand over capacity"
    figures.dress(axes, "(a) Up with everybody's growth, down at once", x, y, xlim=(-BEFORE, 50.0))


def _draw_runaways(axes: Axes, table: pd.DataFrame) -> None:
    for place, fault in enumerate(FAULTS):
        rows, size = pick(table, fault=fault), 8.0 - 2.0 * (place == 1)
        figures.points(axes, rows["duration"], rows, place, scale=100.0, markersize=size)
        figures.theory(axes, rows["duration"], rows, place, scale=100.0)
    ends = np.array([0.0, 41.0])
    bound = 100 * (ends + _SHOWN_LATENCY) / PACE
    words = "bound n alpha (duration + latency)"
    axes.plot(ends, bound, ":", color=figures.REFERENCE, linewidth=1.2, label=words)
    figures.named(axes, "theory of the means")
    x, y = "duration of the outage (periods)", "run-away (% of the capacity)"
    figures.dress(axes, "(b) Run-away, half a saw tooth below its bound", x, y)


def _draw_halves(axes: Axes, found: list[Found]) -> None:
    holdings = np.mean([run.holdings for run in found], axis=0)
    time = GRAIN * COARSE * np.arange(len(holdings)) - BEFORE
    axes.axvspan(0.0, _SHOWN_DURATION, color="0.93", linewidth=0.0)
    for side, (name, place) in enumerate((("the half that is cut off", 3), ("the half that hears", 4))):
        axes.plot(time, holdings[:, side], color=colour(place), linewidth=1.8, label=name)
    heal = round((BEFORE + _SHOWN_DURATION + _SHOWN_LATENCY + 1.0) / (GRAIN * COARSE))
    middle, since = holdings[-40:].mean(), time[heal:] - time[heal]
    gap = 0.5 * (holdings[heal, 0] - holdings[heal, 1]) * np.exp(-since / PACE)
    for sign in (1.0, -1.0):
        axes.plot(time[heal:], middle + sign * gap, color=figures.REFERENCE, linewidth=1.0, linestyle="--")
    figures.named(axes, "gap that closes at rate alpha / x", "--", linewidth=1.0)
    x, y = "time since the outage began (periods)", "demand over that at the optimum"
    limits: dict[str, Any] = {"xlim": (-BEFORE, _SHOWN_DURATION + AFTER), "ylim": (0.0, None)}
    figures.dress(axes, "(c) Half are cut off: who hears pays", x, y, **limits)


def _findings(table: pd.DataFrame) -> list[str]:
    everybody = table[table["fault"] != PART]
    away = everybody[everybody["measure"] == "run-away"]
    gap = 100 * (away["mean"] - away["theory"]).abs().max()
    room = 100 * table.loc[table["measure"] == "room below the bound", "least"].min()

    def at(fault: str, what: str) -> "pd.Series[float]":
        rows = pick(table, fault=fault, measure=what, latency=_SHOWN_LATENCY, duration=_SHOWN_DURATION)
        return rows.iloc[0][["mean", "theory"]].astype(float)

    last, back, over = (at(ALL, what) for what in ("run-away", "time to come back", "overload"))
    deaf, hearing = (at(PART, f"extra of the {name} half")["mean"] for name in ("even", "odd"))
    deaf_end, hearing_end = (at(PART, f"{name} half at the end")["mean"] for name in ("even", "odd"))
    part, left = at(PART, "run-away")["mean"], at(PART, "gap left after x / alpha")
    return sentences(f"""
        - {"No run exceeds" if room >= 0.0 else "Runs exceed"} n alpha (duration + latency), with the hold-off
          added for a channel that heals; the nearest stays {room:.2f} % of the capacity below. The mean
          run-away is half a saw tooth less, to within {gap:.1f} points: {100 * last["mean"]:.0f} % of the
          capacity after {_SHOWN_DURATION:g} periods of silence.
        - It is back {back["mean"]:.1f} periods after those {_SHOWN_DURATION:g} (theory {back["theory"]:.1f}),
          as every hold-off brings a signal. The demand in excess of the capacity adds up to
          {over["mean"]:.1f} periods of all of it (theory {over["theory"]:.1f}).
        - Half of the agents cut off for {_SHOWN_DURATION:g} periods run away by {100 * part:.0f} % only, as
          the others give way: those get {-hearing:.1f} periods of their share less than without the outage,
          and the half that is cut off {deaf:.1f} more. A time x / alpha = {PACE:.0f} periods after healing
          {left["mean"]:.2f} of the gap is left ({left["theory"]:.2f} at the rate alpha / x alone), and in the
          last {_LATE} periods the halves hold {deaf_end:.2f} and {hearing_end:.2f} of their optimum: averages
          remember.
    """)


main = command("outage", study, "How far does total demand run away in an outage, and who pays for it?")
