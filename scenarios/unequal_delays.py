"""Do agents that hear late get more or less, and does a mixture of latencies act like its mean?

Neither more nor less: a constant latency moves all signals that a camera hears by the same time, so that
the intervals between them, which its share depends on, are the same for all.  A mixture is milder than its
mean: demand stops growing as soon as the share rho r of the copies of a signal has arrived.  Where latencies
vary from signal to signal and exceed the hold-off by far, agents that hear at scattered times get less.
"""  # noqa: D400 - a question

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, solve_optimum, theory
from aimd_des.latency import Constant, ShiftedGamma
from aimd_des.lowlevel import FloatArray
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import late, rows_of, run_draws, run_late, totals
from scenarios.common.systems import memory_alone, rate
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws

IntArray = npt.NDArray[np.int64]

N = 60
ALL, HALF, EVEN, THREE, SCATTERED = (
    "all alike",
    "half late",
    "spread evenly",
    "three early",
    "half scattered",
)
MIXTURES = (ALL, HALF, EVEN, THREE, SCATTERED)
# Whose shares are drawn, by mixture and measure.
_SHARES = (
    ("half late: the early", HALF, "first"),
    ("half late: the late", HALF, "others"),
    ("three early, over the same when all are alike", THREE, "three_over_alike"),
)
_SCATTERED = {"first": "at scattered times", "others": "at a constant one"}
# Looks at the total, three of which fall into the shortest hold-off.
_LOOKS = 0.15
_LABELS = ("mixture", "latency", "hold_off", "until")


class Case(NamedTuple):
    """A mixture of latencies by its mean, and the hold-off; the end; all in units of time."""

    mixture: str
    latency: float
    hold_off: float
    until: float


def groups(draw: int) -> tuple[IntArray, IntArray, IntArray]:
    """Draw the first half of the agents, the others, and three of the first."""
    order = np.random.default_rng([2026, draw]).permutation(N)
    return order[: N // 2], order[N // 2 :], order[:3]


def latencies(mixture: str, mean: float, draw: int) -> FloatArray:
    """Give each camera its latency, (n,): its mean over cameras is `mean`."""
    first, _, three = groups(draw)
    found = np.full(N, mean)
    if mixture == HALF:
        found[:] = 2.0 * mean
        found[first] = 0.0
    elif mixture == EVEN:
        found[np.random.default_rng([2027, draw]).permutation(N)] = np.linspace(0.0, 2.0 * mean, N)
    elif mixture == THREE:
        found[:] = mean * N / (N - 3.0)
        found[three] = 0.0
    return found


def measure(case: Case, draw: int, seed: int) -> dict[str, float]:
    """Run, and measure after the first quarter, with a draw of the costs and of which agents are late.

    Shares are over those of the optimum for what is used.
    """
    problem, late_by = memory_alone(draw=draw), latencies(case.mixture, case.latency, draw)
    first, others, three = groups(draw)
    start = case.until / 4.0
    model: Any = Constant(late_by)
    if case.mixture == SCATTERED:
        scale = np.zeros(N)
        scale[first] = case.latency
        model = ShiftedGamma(1.0, scale, late_by - scale)
    looks, channel = np.arange(start, case.until, _LOOKS), BroadcastChannel(latency=model)
    result = run_late(problem, case.hold_off, channel, (start, case.until), seed, looks)
    found = late(result, start)
    used = found.average[:, 0]
    best = solve_optimum(problem, capacity=found.average.sum(axis=0)).allocation[:, 0]
    return {
        "signals": found.signals,  # per unit of time
        "utilisation": found.utilisation,
        # What total demand is below for 99 % of the time, over the capacity.
        "high": np.quantile(totals(result), 0.99),
        "above": found.time_above,  # share of the time above the capacity
        "misallocation": np.abs(used - best).sum() / used.sum(),
        "first": used[first].sum() / best[first].sum(),  # those that are early, or hear at scattered times
        "others": used[others].sum() / best[others].sum(),
        "three": used[three].sum() / best[three].sum(),
    }


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory alone with mixtures of latencies that have the same mean."""
    draws, until = (3, 400.0) if quick else (16, 16000.0)
    means = (2.5, 10.0) if quick else (1.0, 2.5, 5.0, 10.0)
    cases = [Case(mixture, mean, 0.5, until) for mixture in MIXTURES for mean in means]
    cases += [Case(mixture, means[-1], 1.0, until) for mixture in MIXTURES]
    # What depends on the age of a run is seen in a shorter one.
    cases += [Case(mixture, means[-1], 0.5, until / 4.0) for mixture in MIXTURES]
    rows = pd.DataFrame(rows_of(run_draws(measure, cases, draws, 1, seed, quick, runs)))
    # What the same three cameras hold where all are late alike, which comes first.
    alike = rows.groupby(["draw", *_LABELS[1:]])["three"].transform("first")
    table = summarise_draws(rows.assign(three_over_alike=rows["three"] / alike), _LABELS)
    table["theory"] = [_expected(row) for row in table.to_dict("records")]
    settings = {"seed": seed, "draws": draws, "until": until}
    printed = shown(table[table["until"] == until], _LABELS[:3], ".3f")
    drawn = {"unequal_delays": partial(_figure, table, until)}
    return Finding("unequal_delays", settings, table, printed, _findings(table, means[-1], until), drawn)


def _expected(row: Mapping[Any, Any]) -> float:
    """Predict one number, for the costs of draw 0; NaN where there is no formula."""
    if row["measure"] in ("first", "others", "three_over_alike") and row["mixture"] != SCATTERED:
        return 1.0
    if row["measure"] != "high" or row["mixture"] == SCATTERED:
        return np.nan
    problem = memory_alone()
    late_by = latencies(row["mixture"], row["latency"], 0)
    lift = theory.mixture_lift(problem.increase[:, 0], late_by, rate(problem), row["hold_off"])
    return 1.0 + float(lift) / float(problem.capacity[0])


def _figure(table: pd.DataFrame, until: float) -> Figure:
    figure, (shares, high, wrong, scattered) = figures.panels(2, 2, (12.5, 8.6))
    main = pick(table, hold_off=0.5, until=until)
    for place, (label, mixture, group) in enumerate(_SHARES):
        rows = pick(main, mixture=mixture, measure=group)
        figures.points(shares, rows["latency"] * (1.0 + 0.03 * (place - 1)), rows, place, label)
    figures.curves(high, "latency", "mixture", pick(main, measure="high"))
    figures.named(high, "theory")
    figures.curves(wrong, "latency", "mixture", pick(main, measure="misallocation"), scale=100.0)
    for place, (group, label) in enumerate(_SCATTERED.items()):
        rows = pick(main, mixture=SCATTERED, measure=group)
        figures.points(scattered, rows["latency"], rows, place, f"half scattered: those that hear {label}")
    for axes in (shares, scattered):
        figures.level(axes, 1.0)
    x, held = "mean latency of all cameras (control periods)", "share over the optimal share"
    limits: dict[str, Any] = {"ylim": (0.96, 1.04)}
    figures.dress(shares, "(a) Late agents get neither more nor less", x, held, **limits)
    figures.dress(high, "(b) A mixture is milder than its mean", x, "total over capacity, 99 % of the time")
    away = "distance from the optimum for what is used (%)"
    figures.dress(wrong, "(c) Shares are wrong where the total swings", x, away, ylim=(0.0, None))
    figures.dress(scattered, "(d) It ends where latencies scatter", x, held, **limits)
    figures.legends((shares, high, scattered))
    return figure


def _findings(table: pd.DataFrame, mean: float, until: float) -> list[str]:
    def say(mixture: str, name: str, scale: float = 1.0, digits: int = 3, **other: float) -> str:
        labels = {"latency": mean, "hold_off": 0.5, "until": until, **other}
        return over_draws(table, scale, digits, mixture=mixture, measure=name, **labels)

    draws = int(number(table, "draws", measure="first"))
    high = "; ".join(f"{mixture} {say(mixture, 'high', digits=2)}" for mixture in MIXTURES)
    wrong = "; ".join(f"{mixture} {say(mixture, 'misallocation', 100.0, 1)}" for mixture in MIXTURES)
    return sentences(f"""
        - Half late by {2 * mean:g} periods (hold-off 0.5, {draws} draws, {until:g} periods): the early hold
          {say(HALF, "first")} of their optimal shares, the late {say(HALF, "others")}; with hold-off 1
          {say(HALF, "first", hold_off=1.0)} and {say(HALF, "others", hold_off=1.0)}.
        - Three early among others late by {mean * N / (N - 3):.1f} hold {say(THREE, "three")} of theirs, but
          the same three hold {say(ALL, "three")} where all are late by {mean:g}: their being early changes it
          by the factor {say(THREE, "three_over_alike")}; with hold-off 1
          {say(THREE, "three_over_alike", hold_off=1.0)}.
        - At a mean latency of {mean:g} and hold-off 0.5 the total is, for 99 % of the time, below so many
          capacities: {high}.
        - Averages are so far from the optimum for what is used (in %): {wrong}; in runs of a quarter of the
          length {say(ALL, "misallocation", 100.0, 1, until=until / 4)} ({ALL}) and
          {say(HALF, "misallocation", 100.0, 1, until=until / 4)} ({HALF}).
        - Where half of the cameras have exponential latencies of mean {mean:g}, and the others the constant
          one, those at scattered times hold {say(SCATTERED, "first")}, the others {say(SCATTERED, "others")};
          with hold-off 1 {say(SCATTERED, "first", hold_off=1.0)} and
          {say(SCATTERED, "others", hold_off=1.0)}.
    """)


main = command("unequal_delays", study, __doc__)

if __name__ == "__main__":
    main()
