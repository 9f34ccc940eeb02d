"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aimd_des import theory
from aimd_des.lowlevel import FloatArray
from aimd_des.study import jackknife, mean_and_error, replicate
from scenarios.churn.figure import figure_of, still
from scenarios.churn.runs import (
    ALPHA,
    CAPACITY,
    FORGOT,
    KEPT,
    LATENCY,
    PROBLEM,
    WAYS,
    N,
    Seen,
    Size,
    Together,
    leave_together,
    measure,
)
from scenarios.churn.theory import CRITICAL_STAY, fluid, kinds, optimum, steady
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance
from scenarios.common.tables import estimate, said, shown, summarise

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
    return Finding(
        "churn",
        {"seed": seed, "replications": size.replications, "until": size.until, "groups": size.groups},
        table,
        shown(table, ["way", "stay", "measure"], ".3f"),
        _findings(table),
        {"churn": partial(figure_of, table, together, size)},
    )


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


def _findings(table: pd.DataFrame) -> list[str]:
    stays = sorted(stay for stay in table["stay"].unique() if np.isfinite(stay))

    def say(way: str, stay: float, name: str, scale: float = 1.0, digits: int = 2) -> str:
        return said(table, scale, digits, way=way, stay=stay, measure=name)

    fast, middle = stays[0], stays[len(stays) // 2]
    tracking = ", ".join(
        f"{say(way, middle, 'tracking', 100, 0)} ({100 * still(table, way, 'tracking'):.0f}) over {way}"
        for way in WAYS
    )
    held = {name: ", ".join(f"{kind} {say(name, np.nan, kind)}" for kind in kinds()) for name in FORGOT}
    kept, forgotten = FORGOT
    highest = table.loc[table["measure"] == "peak", "mean"].max()
    return sentences(f"""
        - Churn costs use late and signals early. With a mean stay of {middle:g} periods
          {say(KEPT, middle, "utilisation")} of the capacity are used at {say(KEPT, middle, "signals")}
          signals a period, with {fast:g} {say(KEPT, fast, "utilisation")} at {say(KEPT, fast, "signals")};
          without churn {still(table, KEPT, "utilisation"):.2f} at {still(table, KEPT, "signals"):.2f}. Below
          a stay of {CRITICAL_STAY:.0f} periods cameras go before they can fill the capacity. The highest peak
          is {highest:.3f} of it, and without churn {still(table, KEPT, "peak"):.3f}.
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
