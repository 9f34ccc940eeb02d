"""The study: what is run, and what is made of it."""

from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import brentq

from aimd_des import theory
from aimd_des.plots import colour, shared_legend
from scenarios.burst_loss.runs import Bursts, Outcome, measure, run_one, share_of_smallest
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, run_all, table_of
from scenarios.common.systems import memory_alone, rate
from scenarios.common.tables import number, pick, shown

_PROBLEM = memory_alone()
_LOSS = 0.2
_HOLD_OFF = 0.25
_LINKS = ("each link for itself", "all links together")
_BURSTS = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 20.0, 40.0, 80.0, 160.0)
# Theory of bursts that all have together is for those much longer than the hold-off.
_LONG = 1.0
_SHOWN = 20.0
# Of longer bursts there are few in a run.
_MANY = 40.0
_MEASURES = tuple(name for name in Outcome._fields if name != "average")
_PLAIN = "from plain optimum"
_PRINTED = ("signals", "peak", "time_above", "excess", "run_away_peak", "excursion", "smallest")
# Where links without a burst are drawn on a logarithmic axis.
_NONE = 0.04


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with bursts of loss of many lengths, on each link and on all."""
    replications, until = (2, 400.0) if quick else (20, 6000.0)
    bursts = (0.0, 1.0, 20.0) if quick else _BURSTS
    cases = [
        Bursts(_PROBLEM, links == _LINKS[1], _LOSS, burst, _HOLD_OFF, until, until / 3)
        for links in _LINKS
        for burst in bursts
    ]
    pairs = run_all(measure, cases, replications, seed, quick, runs)
    table = pd.concat([_rows(case, found) for case, found in pairs], ignore_index=True)
    chosen = table["measure"].isin([*_PRINTED, _PLAIN])
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = shown(table[chosen], ["links", "burst", "measure"])
    drawn = {"burst_loss": partial(_figure, table, seed)}
    return Finding("burst_loss", settings, table, printed, _findings(table), drawn)


def _rows(run: Bursts, found: list[Outcome]) -> pd.DataFrame:
    labels: dict[str, Any] = {"links": _LINKS[int(run.common)], "burst": run.burst}
    return table_of(labels, _PROBLEM, found, _MEASURES, {_PLAIN: None}, _expected(run))


def _expected(run: Bursts) -> dict[str, float]:
    """Predict what there is a formula for."""
    if run.common and run.burst < _LONG:
        return {}
    if run.common:
        span = run.until - run.start
        known = theory.burst_runaway(_PROBLEM, run.loss, run.burst, hold_off=run.hold_off, span=span)
        if known is None:
            return {}
        found = known._asdict()
        allocation, away = found.pop("allocation"), 0.0  # what is used is shared as ever
    else:
        allocation, signals = theory.burst_shares(_PROBLEM, run.loss, run.burst)
        if not signals * run.hold_off < 1.0:  # also where it is not a number
            return {}
        found, away = {"signals": signals}, float(distance(_PROBLEM, allocation)[0])
    return {**found, "smallest": share_of_smallest(_PROBLEM, allocation), _PLAIN: away}


_PANELS = (
    ("peak", "highest total demand over capacity", "(b) Only bursts in common run away"),
    (
        "time_above",
        "share of time above capacity",
        "(c) In common: above for p of the time, and a little more",
    ),
    ("smallest", "share of memory held by the 20 smallest", "(d) Long bursts level the shares"),
)


def _figure(table: pd.DataFrame, seed: int) -> Figure:
    figure, panels = figures.panels(2, 2, (13.0, 8.4))
    _draw_demand(panels[0], seed)
    for axes, (name, label, title) in zip(panels[1:], _PANELS, strict=True):
        _draw(axes, pick(table, measure=name), name, title, label)
    shared_legend(figure)
    return figure


def _draw_demand(axes: Axes, seed: int) -> None:
    """Draw total demand of one run each, with the same luck."""
    for place, links in enumerate(_LINKS):
        run = Bursts(_PROBLEM, links == _LINKS[1], _LOSS, _SHOWN, _HOLD_OFF, 1200.0, 200.0)
        demand = run_one(run, seed, np.arange(200.0, 1200.0, 0.5)).demand
        axes.plot(demand["time"], demand["total"] / _PROBLEM.capacity[0], color=colour(place), linewidth=1.0)
    figures.level(axes, 1.0)
    title = f"(a) One run with bursts of {_SHOWN:g} in the mean"
    figures.dress(axes, title, "time (control periods)", "total demand over capacity", numbers="x")


def _draw(axes: Axes, table: pd.DataFrame, measure: str, title: str, label: str) -> None:
    for place, links in enumerate(_LINKS):
        rows = pick(table, links=links)
        burst = np.maximum(rows["burst"], _NONE)
        figures.theory(axes, burst, rows, place)
        figures.points(axes, burst, rows, place, links)
    figures.named(axes, "theory")
    axes.axvline(_longest(), color=colour(0), linewidth=1.0, linestyle="--")
    figures.named(axes, "longest burst that is held", "--", color=colour(0), linewidth=1.0)
    limits: dict[str, Any] = {"peak": {"yscale": "log"}, "time_above": {"ylim": (-0.02, 1.0)}}
    across = "mean length of a burst (control periods)"
    figures.dress(axes, title, across, label, numbers="y", xscale="log", **limits.get(measure, {}))
    axes.set_xticks([_NONE, 0.1, 1.0, 10.0, 100.0], ["no bursts", "0.1", "1", "10", "100"])


def _hopeless() -> float:
    """Compute the mean burst with which links that are bad hold all of the capacity."""
    return float(_PROBLEM.capacity[0] / (_PROBLEM.increase.sum() * _LOSS))


@lru_cache
def _longest() -> float:
    """Find the mean burst, each link for itself, from which on signals do not suffice."""

    def idle(burst: float) -> float:
        return 1.0 - theory.burst_shares(_PROBLEM, _LOSS, burst)[1] * _HOLD_OFF

    return float(brentq(idle, 1.0, 0.95 * _hopeless(), xtol=0.01))


def _findings(table: pd.DataFrame) -> list[str]:
    own, common = _LINKS

    def at(links: str, measure: str, burst: float, column: str = "mean") -> float:
        return number(table, column, links=links, measure=measure, burst=burst)

    bursts = sorted(table["burst"].unique())
    held = [burst for burst in bursts if burst <= _SHOWN]
    peak = max(at(own, "peak", burst) for burst in held)
    small = {burst: 100 * at(own, "smallest", burst) for burst in (0.0, held[-1], bursts[-1])}
    away = {links: 100 * at(links, _PLAIN, _SHOWN) for links in _LINKS}
    turn, turn_theory, excursion = (
        at(common, *wanted)
        for wanted in (("run_away_peak", _SHOWN), ("run_away_peak", _SHOWN, "theory"), ("excursion", _SHOWN))
    )
    gaps = [
        abs(at(common, "excess", burst) / at(common, "excess", burst, "theory") - 1.0)
        for burst in bursts
        if _LONG <= burst <= _MANY
    ]
    return sentences(f"""
        - Each link for itself: with bursts of up to {held[-1]:g} the highest peak is {100 * (peak - 1):.1f} %
          above the capacity. The twenty smallest hold {small[0.0]:.1f} % without, {small[held[-1]]:.1f} % at
          {held[-1]:g} and {small[bursts[-1]]:.1f} % at {bursts[-1]:g}, with
          {100 * at(own, "time_above", bursts[-1]):.0f} % of the time above the capacity. Theory puts the
          longest burst that is held at {_longest():.0f}, and at {_hopeless():.0f} for any hold-off.
        - All links together: bursts of {_SHOWN:g} end {turn:.2f} of the capacity above it in the mean (theory
          {turn_theory:.2f}, n alpha B / C {_SHOWN / _LOSS / _hopeless():.2f}), an excursion lasts
          {excursion:.1f}, {100 * at(common, "time_above", _SHOWN):.0f} % of the time is above, and the
          highest peak is {at(common, "peak", _SHOWN):.1f} of the capacity.
        - The mean excess is within {100 * max(gaps):.0f} % of theory for bursts from {_LONG:g} to
          {min(_MANY, bursts[-1]):g}; at {_SHOWN:g} it is {at(common, "excess", _SHOWN):.3f} of the capacity,
          and {_first_order(_SHOWN):.3f} by the formula of first order.
        - Shares at {_SHOWN:g} are {away[own]:.1f} % from the optimum with bursts of each link (theory
          {100 * at(own, "from plain optimum", _SHOWN, "theory"):.1f}) and {away[common]:.1f} % with bursts of
          all.
    """)


def _first_order(burst: float) -> float:
    """Compute n alpha B p (1 - p) / (1 - p - rho r) over the capacity."""
    lift = _PROBLEM.increase.sum() * burst / _PROBLEM.capacity[0]
    return float(lift * _LOSS * (1.0 - _LOSS) / (1.0 - _LOSS - rate(_PROBLEM) * _HOLD_OFF))


main = command("burst_loss", study, "Does it matter whether losses come in bursts?")
