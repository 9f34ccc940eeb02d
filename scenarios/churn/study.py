"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import theory
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from aimd_des.study import jackknife, mean_and_error, replicate
from scenarios.churn.runs import (
    ALPHA,
    CAPACITY,
    CRITICAL_STAY,
    FORGOT,
    KEPT,
    LATENCY,
    PROBLEM,
    WAYS,
    N,
    Seen,
    Size,
    Together,
    fluid,
    kinds,
    leave_together,
    measure,
    optimum,
    steady,
)
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance
from scenarios.common.tables import estimate, number, pick, said, shown, summarise

_FULL = Size(
    (24.0, 32.0, 48.0, 80.0, 160.0, 400.0, 1000.0, np.inf), 8, 300.0, 800.0, 32, 400.0, 500.0, 800.0, 5.0
)
_QUICK = Size((48.0, 160.0, np.inf), 2, 100.0, 200.0, 4, 100.0, 140.0, 240.0, 10.0)
# Shares are measured where a run holds at least so many mean stays of a camera: else most is luck.
_STAYS = 4.0
# When the demand of those who have come back is looked at, in periods since then.
_WINDOW = (50.0, 100.0)

_Runs = dict[tuple[str, float], list[Seen]]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Let cameras come and go, ever faster, and let a quarter of them leave and come back together."""
    size = _QUICK if quick else _FULL
    how: dict[str, Any] = {"workers": 1 if quick else None, "out": runs}
    cases = [(way, stay) for stay in size.stays for way in WAYS]
    jobs = [partial(measure, way, stay, size) for way, stay in cases]
    seen = dict(zip(cases, replicate(jobs, size.replications, seed, **how), strict=True))
    groups = [partial(leave_together, name, size) for name in FORGOT]
    together = dict(zip(FORGOT, replicate(groups, size.groups, seed, **how), strict=True))
    table = pd.concat([_sweep(seen), _shares(seen, size), _returned(together, size)], ignore_index=True)
    settings = {"seed": seed, "replications": size.replications, "until": size.until, "groups": size.groups}
    printed = shown(table, ["way", "stay", "measure"], ".3f")
    drawn = {"churn": partial(_figure, table, together, size)}
    return Finding("churn", settings, table, printed, _findings(table), drawn)


def _sweep(runs: _Runs) -> pd.DataFrame:
    names = ("signals", "utilisation", "peak", "above", "tracking")
    rows = [
        {"way": way, "stay": stay, **{name: getattr(seen, name) for name in names}}
        for (way, stay), found in runs.items()
        for seen in found
    ]
    table = summarise(rows, ["way", "stay"])
    table["theory"] = [_expected(row["measure"], row["stay"]) for row in table.to_dict("records")]
    return table


def _expected(name: str, stay: float) -> float:
    """Predict one number of the sweep; NaN where there is no formula."""
    if name == "peak":  # all who can be there grow over the latency
        return 1.0 + float(theory.peak_lift(N, ALPHA, LATENCY)) / CAPACITY
    return float(getattr(steady(stay), name)) if name in ("signals", "utilisation") else np.nan


def _shares(runs: _Runs, size: Size) -> pd.DataFrame:
    """Measure how far averages are from the plain optimum, and from the one that churn makes of it."""
    rows = []
    for stay in size.stays:
        if stay > size.until / _STAYS:
            continue
        averages, share = [seen.average for seen in runs[KEPT, stay]], steady(stay).share[:, None]
        for name, apart, expected in (
            ("from plain optimum", partial(distance, PROBLEM), float(distance(PROBLEM, share)[0])),
            ("from churned optimum", partial(_gap, share), 0.0),
        ):
            labels = {"way": KEPT, "stay": stay}
            rows.append(estimate(labels, name, jackknife(averages, apart), len(averages), expected))
    return pd.DataFrame(rows)


def _gap(expected: FloatArray, average: FloatArray) -> FloatArray:
    return np.asarray(np.abs(average / average.sum() - expected / expected.sum()).sum(axis=0))


def _returned(together: dict[str, list[Together]], size: Size) -> pd.DataFrame:
    """Measure what everybody holds a while after the return, over its share of the optimum."""
    rows, since = [], size.times - size.back
    window = (since >= _WINDOW[0]) & (since <= _WINDOW[1])
    for name, found in together.items():
        labels: dict[str, Any] = {"way": name, "stay": np.nan}
        for kind, agents in kinds().items():
            share = optimum()[agents].sum()
            held = [run.demand[window][:, agents].sum(axis=1).mean() / share for run in found]
            flowing = float(fluid(name, size)[0][window][:, agents].sum(axis=1).mean() / share)
            rows.append(estimate(labels, kind, mean_and_error(held), len(found), flowing))
        again = mean_and_error([run.again for run in found])
        released = float(np.mean([run.released for run in found]))
        rows.append(estimate(labels, "reused after", again, len(found), released))
    return pd.DataFrame(rows)


def _figure(table: pd.DataFrame, together: dict[str, list[Together]], size: Size) -> Figure:
    """Draw what churn does, and what those do who come back together, in four panels."""
    figure, panels = figures.panels(2, 2, (12.5, 8.6))
    _draw_use(panels[0], table)
    _draw_tracking(panels[1], table)
    _draw_shares(panels[2], table)
    _draw_return(panels[3], together, size)
    for axes in panels:
        axes.legend(frameon=False, fontsize="small")
    return figure


def _still(table: pd.DataFrame, way: str, name: str) -> float:
    """Look up the mean of a measure without churn."""
    return number(table, way=way, measure=name, stay=np.inf)


def _moving(table: pd.DataFrame, way: str, name: str) -> pd.DataFrame:
    return pick(table[np.isfinite(table["stay"])], way=way, measure=name)


def _dress(axes: Axes, title: str, label: str) -> None:
    x: dict[str, Any] = {"x": "mean stay of a camera (periods)", "xscale": "log"}
    figures.dress(axes, title, y=label, ylim=(0.0, None), **x)


def _draw_use(axes: Axes, table: pd.DataFrame) -> None:
    stays = _moving(table, KEPT, "signals")["stay"]
    grid = np.geomspace(stays.min(), stays.max(), 24)
    words = {"utilisation": "mean total demand over capacity", "signals": "signals per period"}
    for place, (name, label) in enumerate(words.items(), start=2):
        figures.points(axes, stays, _moving(table, KEPT, name), place, label)
        axes.plot(grid, [getattr(steady(stay), name) for stay in grid], color=colour(place), linewidth=1.4)
    axes.axvline(CRITICAL_STAY, color=figures.REFERENCE, linewidth=1.0, linestyle="--")
    label, ink = "critical stay\nC / (n alpha)", figures.REFERENCE
    axes.text(CRITICAL_STAY * 1.04, 0.5, label, fontsize="small", color=ink)
    figures.named(axes, "theory")
    _dress(axes, "(a) Use gives way late, signals long before", "share of capacity; signals")


def _draw_tracking(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(WAYS):
        rows, look = _moving(table, way, "tracking"), {"linestyle": ":", "linewidth": 0.9}
        figures.points(
            axes, rows["stay"], rows, place, f"average: {way}", scale=100.0, fmt="os^D"[place], **look
        )
        calm = 100.0 * _still(table, way, "tracking")
        axes.axhline(calm, color=colour(place), linewidth=0.8, linestyle="--")
    figures.named(axes, "the same without churn", "--", linewidth=0.8)
    _dress(axes, "(b) Averages against the optimum of those present", "tracking error (%)")


def _draw_shares(axes: Axes, table: pd.DataFrame) -> None:
    for face, name in (("full", "from plain optimum"), ("none", "from churned optimum")):
        rows = _moving(table, KEPT, name)
        figures.points(axes, rows["stay"], rows, 0, name, scale=100.0, fillstyle=face)
        figures.theory(axes, rows["stay"], rows, 0, scale=100.0)
    _dress(axes, "(c) Churn evens out the shares", "distance of the averages (%)")


def _draw_return(axes: Axes, together: dict[str, list[Together]], size: Size) -> None:
    agents, times = kinds()["returning, costs of power 6"], size.times - size.back
    for place, (name, found) in enumerate(together.items()):
        shade = colour(4 + place)
        courses = [[part[:, agents].mean(axis=1) for part in (run.demand, run.average)] for run in found]
        flowing = [part[:, agents].mean(axis=1) for part in fluid(name, size)]
        figures.course(axes, times, courses, flowing, shade)
        axes.plot([], [], color=shade, linewidth=2.2, label=f"{name} (thin: demand)")
    figures.level(axes, optimum()[agents].mean(), "--")
    figures.named(axes, "theory (fluid)", ":", color="black", linewidth=0.9)
    x, y = "time since a quarter is back (periods)", "memory of a camera with costs of power 6 (GB)"
    figures.dress(axes, "(d) Who has forgotten takes too much", x, y, ylim=(0.0, None))


def _findings(table: pd.DataFrame) -> list[str]:
    stays = sorted(stay for stay in table["stay"].unique() if np.isfinite(stay))

    def say(way: str, stay: float, name: str, scale: float = 1.0, digits: int = 2) -> str:
        return said(table, scale, digits, way=way, stay=stay, measure=name)

    fast, middle = stays[0], stays[len(stays) // 2]
    tracking = ", ".join(
        f"{say(way, middle, 'tracking', 100, 0)} ({100 * _still(table, way, 'tracking'):.0f}) over {way}"
        for way in WAYS
    )
    held = {name: ", ".join(f"{kind} {say(name, np.nan, kind)}" for kind in kinds()) for name in FORGOT}
    kept, forgotten = FORGOT
    highest = table.loc[table["measure"] == "peak", "mean"].max()
    return sentences(f"""
        - Churn costs use late and signals early. With a mean stay of {middle:g} periods
          {say(KEPT, middle, "utilisation")} of the capacity are used at {say(KEPT, middle, "signals")}
          signals a period, with {fast:g} {say(KEPT, fast, "utilisation")} at {say(KEPT, fast, "signals")};
          without churn {_still(table, KEPT, "utilisation"):.2f} at {_still(table, KEPT, "signals"):.2f}.
          Below a stay of {CRITICAL_STAY:.0f} periods cameras go before they can fill the capacity. The
          highest peak is {highest:.3f} of it, and without churn {_still(table, KEPT, "peak"):.3f}.
        - Tracking error in %, at a mean stay of {middle:g} (and without churn): {tracking}.
        - Churn evens out the shares: with a mean stay of {fast:g} averages are
          {say(KEPT, fast, "from plain optimum", 100, 0)} % from the plain optimum and
          {say(KEPT, fast, "from churned optimum", 100, 0)} % from that of costs to which it adds a square.
        - What a quarter releases is in use again after {say(kept, np.nan, "reused after", 1.0, 1)} periods.
          Demand over the optimum, {_WINDOW[0]:g} to {_WINDOW[1]:g} periods after it is back: {kept}:
          {held[kept]}; {forgotten}: {held[forgotten]}.
    """)


main = command(
    "churn",
    study,
    "How much coming and going does the system bear, and what does a camera do that has forgotten?",
)
