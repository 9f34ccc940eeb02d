"""The study: what is run, and what is made of it."""

from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from aimd_des import theory
from aimd_des.checks import FloatArray
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
from scenarios.common.command import Study, command
from scenarios.common.measure import distance
from scenarios.common.replicate import jackknife, mean_and_error, replicate, summarise

__all__ = ["main", "study"]

_FULL = Size(
    (24.0, 32.0, 48.0, 80.0, 160.0, 400.0, 1000.0, np.inf), 8, 300.0, 800.0, 32, 400.0, 500.0, 800.0, 5.0
)
_QUICK = Size((48.0, 160.0, np.inf), 2, 100.0, 200.0, 4, 100.0, 140.0, 240.0, 10.0)
# Shares are measured where a run holds at least so many mean stays of a camera: else most is luck.
_STAYS = 4.0
# When the demand of those who have come back is looked at, in periods since then.
_WINDOW = (50.0, 100.0)

_Runs = dict[tuple[str, float], list[Seen]]


def study(quick: bool = False, seed: int = 0) -> Study:
    """Let cameras come and go, ever faster, and let a quarter of them leave and come back together.

    Parameters
    ----------
    quick : bool
        Whether to run the small size.
    seed : int
        Of the first replication.

    Returns
    -------
    Study
        A pure function of the arguments.
    """
    size, workers = (_QUICK, 1) if quick else (_FULL, None)
    cases = [(way, stay) for stay in size.stays for way in WAYS]
    jobs = [partial(measure, way, stay, size) for way, stay in cases]
    runs = dict(zip(cases, replicate(jobs, size.replications, seed, workers=workers), strict=True))
    groups = [partial(leave_together, name, size) for name in FORGOT]
    together = dict(zip(FORGOT, replicate(groups, size.groups, seed, workers=workers), strict=True))
    table = pd.concat([_sweep(runs), _shares(runs, size), _returned(together, size)], ignore_index=True)
    return Study(
        "churn",
        {"seed": seed, "replications": size.replications, "until": size.until, "groups": size.groups},
        table,
        _shown(table),
        _findings(table),
        {"churn": figure_of(table, together, size)},
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
        plain, churned = (
            jackknife(averages, partial(distance, PROBLEM)),
            jackknife(averages, partial(_gap, share)),
        )
        rows += [
            _row(KEPT, stay, "from plain optimum", plain, len(averages), float(distance(PROBLEM, share)[0])),
            _row(KEPT, stay, "from churned optimum", churned, len(averages), 0.0),
        ]
    return pd.DataFrame(rows)


def _row(
    way: str, stay: float, name: str, found: tuple[FloatArray, FloatArray], count: int, expected: float
) -> dict[str, Any]:
    value, error = (float(np.ravel(part)[0]) for part in found)
    return {
        "way": way,
        "stay": stay,
        "measure": name,
        "mean": value,
        "standard_error": error,
        "replications": count,
        "theory": expected,
    }


def _gap(expected: FloatArray, average: FloatArray) -> FloatArray:
    return np.asarray(np.abs(average / average.sum() - expected / expected.sum()).sum(axis=0))


def _returned(together: dict[str, list[Together]], size: Size) -> pd.DataFrame:
    """Measure what everybody holds a while after the return, over its share of the optimum."""
    rows, since = [], size.times - size.back
    window = (since >= _WINDOW[0]) & (since <= _WINDOW[1])
    for name, found in together.items():
        for kind, agents in kinds().items():
            share = optimum()[agents].sum()
            held = [run.demand[window][:, agents].sum(axis=1).mean() / share for run in found]
            flowing = fluid(name, size)[0][window][:, agents].sum(axis=1).mean() / share
            rows.append(_row(name, np.nan, kind, mean_and_error(held), len(found), float(flowing)))
        again, released = ([getattr(run, part) for run in found] for part in ("again", "released"))
        rows.append(
            _row(name, np.nan, "reused after", mean_and_error(again), len(found), float(np.mean(released)))
        )
    return pd.DataFrame(rows)


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "way": row["way"],
                "mean stay": "" if np.isnan(row["stay"]) else f"{row['stay']:g}",
                "measure": row["measure"],
                "theory": "" if np.isnan(row["theory"]) else f"{row['theory']:.3f}",
                "simulation": f"{row['mean']:.3f} ± {row['standard_error']:.3f}",
            }
            for row in table.to_dict("records")
        ]
    )


def _findings(table: pd.DataFrame) -> list[str]:
    stays = sorted(stay for stay in table["stay"].unique() if np.isfinite(stay))

    def say(way: str, stay: float, name: str, scale: float = 1.0, digits: int = 2) -> str:
        here = table["stay"].isna() if np.isnan(stay) else table["stay"] == stay
        row = table[here & (table["way"] == way) & (table["measure"] == name)].iloc[0]
        expected = "" if np.isnan(row["theory"]) else f" (theory {scale * row['theory']:.{digits}f})"
        return f"{scale * row['mean']:.{digits}f}{expected}"

    fast, middle = stays[0], stays[len(stays) // 2]
    tracking = ", ".join(
        f"{say(way, middle, 'tracking', 100, 0)} ({100 * still(table, way, 'tracking'):.0f}) over {way}"
        for way in WAYS
    )
    held = {name: ", ".join(f"{kind} {say(name, np.nan, kind)}" for kind in kinds()) for name in FORGOT}
    kept, forgotten = FORGOT
    highest = table.loc[table["measure"] == "peak", "mean"].max()
    use = (
        f"Churn costs use late and signals early. With a mean stay of {middle:g} periods "
        f"{say(KEPT, middle, 'utilisation')} of the capacity are used at {say(KEPT, middle, 'signals')} "
        f"signals a period, with {fast:g} {say(KEPT, fast, 'utilisation')} at {say(KEPT, fast, 'signals')}; "
        f"without churn {still(table, KEPT, 'utilisation'):.2f} at {still(table, KEPT, 'signals'):.2f}. "
        f"Below a stay of {CRITICAL_STAY:.0f} periods cameras go before they can fill the capacity. "
        f"The highest peak is {highest:.3f} of it, and without churn {still(table, KEPT, 'peak'):.3f}."
    )
    shares = (
        f"Churn evens out the shares: with a mean stay of {fast:g} averages are "
        f"{say(KEPT, fast, 'from plain optimum', 100, 0)} % from the plain optimum and "
        f"{say(KEPT, fast, 'from churned optimum', 100, 0)} % from that of costs to which it adds a square."
    )
    back = (
        f"What a quarter releases is in use again after {say(kept, np.nan, 'reused after', 1.0, 1)} periods. "
        f"Demand over the optimum, {_WINDOW[0]:g} to {_WINDOW[1]:g} periods after it is back: {kept}: "
        f"{held[kept]}; {forgotten}: {held[forgotten]}."
    )
    error = f"Tracking error in %, at a mean stay of {middle:g} (and without churn): {tracking}."
    return [use, error, shares, back]


main = command(
    "churn",
    study,
    "How much coming and going does the system bear, and what does a camera do that has forgotten?",
)
