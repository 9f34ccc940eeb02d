"""Which delays and losses are usable: demand below the capacity, shares right?

Usable is what leaves demand above the capacity for at most 1 % of the time, and averages at most 5 % from the
optimum for what they use.  The first depends on the threshold: the growth over the latency must fit between
it and the capacity, with any hold-off.  The second depends on the hold-off: signals in flight may take about
one and a half times the capacity.  The limit cycle of theory predicts both.  Losses that are the same for all
cost no shares; the loss that leaves demand below the capacity is less than the critical one.
"""  # noqa: D400 - a question

from collections.abc import Callable
from functools import cache, partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import brentq

from aimd_des import BroadcastChannel, InputError, theory
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, late, run_draws, run_late
from scenarios.common.systems import lowered, memory_alone, usable
from scenarios.common.tables import beside_theory, number, over_draws, pick, shown, table_of

#: What is usable: at most this share of the time above the capacity, and this distance from the optimum.
MOST = {"above": 0.01, "misallocation": 0.05}
# Where an edge is looked for first, as a part of the range.
_FIRST = 0.125
_LONGEST = 32.0
# The threshold at which shares decide: with more draws of the costs, and runs that are three times as long.
_LONGER, _MANY = 0.9, 24
# The threshold at which runs with loss are also three times as long.
_AGED = 1.0
_LABELS = ["rises", "hold_off", "threshold", "other", "until"]


class Case(NamedTuple):
    """What rises, for memory of the paper's system by itself, with continuous cameras."""

    rises: Literal["latency", "loss"]
    most: float  # up to where it is looked for
    exact: float  # how exactly it is located
    hold_off: float
    threshold: float
    until: float  # length of a run, of which the first fifth is cut off
    draws: int = 10  # of the costs

    @property
    def other(self) -> float:
        """The loss where the latency rises, and the latency where the loss does."""
        return 0.0


def search(case: Case, draw: int, seed: int) -> dict[str, float]:
    """Locate how far each limit is kept, in runs that share their seed.

    That is 0 where it never is, and `most` where it always is.
    """
    measured = cache(partial(_measure, case, draw, seed))
    return _with_both({name: _edge(case, partial(_beyond, measured, name)) for name in MOST})


def _with_both(edges: dict[str, float]) -> dict[str, float]:
    return {**edges, "both": min(edges.values())}


def _beyond(measured: Callable[[float], dict[str, float]], name: str, value: float) -> float:
    return measured(value)[name] - MOST[name]


def _edge(case: Case, beyond: Callable[[float], float]) -> float:
    if beyond(0.0) > 0.0:
        return 0.0
    # What lies far beyond takes most signals, and so most time: it is looked at last.
    low, high = 0.0, _FIRST * case.most
    while beyond(high) <= 0.0:
        if high == case.most:
            return case.most
        low, high = high, min(2.0 * high, case.most)
    return float(brentq(beyond, low, high, xtol=case.exact))


def _measure(case: Case, draw: int, seed: int, value: float) -> dict[str, float]:
    problem = lowered(memory_alone(draw=draw), case.threshold)
    risen: dict[str, Any] = {case.rises: value}
    start, channel = 0.2 * case.until, BroadcastChannel(**risen)
    seen = late(run_late(problem, case.hold_off, channel, (start, case.until), seed, "end"), start)
    return {"above": seen.time_above, "misallocation": float(distance(problem, seen.average)[0])}


def _cases(quick: bool) -> list[Case]:
    """List hold-offs, thresholds and lengths of runs, for latencies and for losses."""
    if quick:
        return [
            *(Case("latency", 8.0, 0.05, hold_off, _LONGER, 1_500.0, 2) for hold_off in (0.1, 1.0)),
            *(Case("loss", 0.95, 0.02, hold_off, _AGED, 1_000.0, 2) for hold_off in (0.25, 1.0)),
        ]
    latency, loss = partial(Case, "latency", _LONGEST, 0.02), partial(Case, "loss", 0.95, 0.005)
    return [
        *(
            latency(hold_off, threshold, 3_000.0, _MANY if threshold == _LONGER else 10)
            for threshold in (1.0, 0.95, 0.9, 0.8)
            for hold_off in (0.1, 0.2, 0.4, 0.7, 1.0, 1.3)
        ),
        *(latency(hold_off, _LONGER, 9_000.0) for hold_off in (0.1, 0.4, 0.7, 1.3)),
        *(
            loss(hold_off, threshold, 3_000.0)
            for threshold in (1.0, 0.95, 0.9)
            for hold_off in (0.1, 0.25, 0.5, 0.75, 1.0, 1.25)
        ),
        *(loss(hold_off, _AGED, 9_000.0) for hold_off in (0.25, 1.0)),
    ]


@cache
def _cycle(hold_off: float, threshold: float, latency: float) -> dict[str, float]:
    """Predict the time above the capacity, and the misallocation without noise."""
    problem = lowered(memory_alone(), threshold)
    found = theory.limit_cycle(problem, hold_off, latency)
    growth = float(problem.increase.sum() / problem.capacity[0])
    beyond = threshold + growth * latency - 1.0
    return {
        "above": max(beyond, 0.0) / growth / float(found.period[0]),
        "misallocation": float(distance(problem, found.allocation)[0]),
    }


def usable_delay(case: Case) -> dict[str, float]:
    """Predict how far each limit is kept; NaN where signals do not suffice at the threshold."""

    def edge(name: str) -> float:
        beyond = partial(_beyond, partial(_cycle, case.hold_off, case.threshold), name)
        return float(brentq(beyond, 0.0, case.most, xtol=1e-3)) if beyond(case.most) > 0.0 else case.most

    try:
        return _with_both({name: edge(name) for name in MOST})
    except InputError:
        return _with_both(dict.fromkeys(MOST, np.nan))


def usable_loss(case: Case) -> dict[str, float]:
    """Predict how far demand stays below the capacity; of shares there is no prediction beyond."""
    above = usable(lowered(memory_alone(), case.threshold), case.hold_off)
    return _with_both({"above": above, "misallocation": np.nan})


def _critical(threshold: float, hold_off: float) -> float:
    problem = memory_alone()
    needed = theory.needed_rate(problem, capacity=threshold * problem.capacity)
    return float(theory.critical_loss(needed, hold_off=hold_off)[0])


def _criticals(rows: pd.DataFrame) -> list[float]:
    return [_critical(*at) for at in zip(rows["threshold"], rows["hold_off"], strict=True)]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Search how far latencies or losses may rise before a limit is passed, over draws of the costs."""
    cases, pairs = _cases(quick), []
    for count in sorted({case.draws for case in cases}):
        alike = [case for case in cases if case.draws == count]
        pairs += run_draws(search, alike, count, 1, seed, quick, runs)
    table = table_of(pairs, _LABELS)
    # With the costs of draw 0.
    known = {
        attrgetter(*_LABELS)(case): usable_delay(case) if case.rises == "latency" else usable_loss(case)
        for case in cases
    }
    table["theory"] = [known[row[: len(_LABELS)]][str(row.measure)] for row in table.itertuples(index=False)]
    settings = {"seed": seed, "draws": max(case.draws for case in cases)}
    findings = [*_about_delay(pick(table, rises="latency")), *_about_loss(pick(table, rises="loss"))]
    printed = shown(table, [*_LABELS, "measure"], ".2f")
    return Finding("usable", settings, table, printed, findings, {"usable": partial(_figure, table)})


_PANELS = (
    ("latency", "above", "(a) At most 1 % of the time above the capacity"),
    ("latency", "misallocation", "(b) Shares at most 5 % off"),
    ("loss", "above", "(c) At most 1 % of the time above the capacity"),
    ("loss", "misallocation", "(d) Shares at most 5 % off"),
)
_LATENCIES: dict[str, Any] = {"xscale": "log", "yscale": "log", "ylim": (0.01, 1.2 * _LONGEST)}


def _figure(table: pd.DataFrame) -> Figure:
    """Draw how far each limit is kept, over hold-offs: thresholds beside theory, and longer runs."""
    figure, panels = figures.panels(2, 2, (11.0, 9.2))
    for axes, (rises, measure, title) in zip(panels, _PANELS, strict=True):
        rows = pick(table, rises=rises, measure=measure).sort_values(
            "threshold", ascending=False, kind="stable"
        )
        short, longer = _lengths(rows)
        figures.curves(axes, "hold_off", "threshold", short, "threshold {:g}")
        label = f"{longer['threshold'].iloc[0]:g}, runs longer"
        axes.plot(longer["hold_off"], longer["mean"], "x", color="black", label=label)
        figures.named(axes, "theory")
        legend: dict[str, Any] = {"loc": (0.03, 0.12), "ncols": 2}
        if rises == "latency":
            figures.dress(
                axes, title, "hold-off (control periods)", "latency up to (control periods)", **_LATENCIES
            )
        else:
            _draw_critical(axes, short)
            limits: dict[str, Any] = {"xlim": (0.0, 1.3), "ylim": (-0.02, 1.0)}
            figures.dress(axes, title, "hold-off (control periods)", "loss up to", **limits)
            legend = {"loc": "lower left"}
        figures.legends([axes], **legend)
    return figure


def _lengths(rows: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Take the rows of the shorter runs and of the longer ones."""
    return pick(rows, until=rows["until"].min()), pick(rows, until=rows["until"].max())


def _draw_critical(axes: Axes, rows: pd.DataFrame) -> None:
    for place, (_, part) in enumerate(rows.groupby("threshold", sort=False)):
        axes.plot(part["hold_off"], _criticals(part), "--", color=colour(place), linewidth=1.0)
    figures.named(axes, "critical loss by theory", "--", linewidth=1.0)


def _about_delay(table: pd.DataFrame) -> list[str]:
    short, longer = _lengths(table)
    within = short[short["hold_off"] <= 0.7]
    hold_offs = np.unique(within["hold_off"])

    def shares(rows: pd.DataFrame) -> str:
        parts = pick(rows, measure="misallocation", threshold=_LONGER).groupby("hold_off")
        return "; ".join(f"{beside_theory(part)}, at hold-off {hold_off:g}" for hold_off, part in parts)

    levels = [
        f"{beside_theory(part)}, at threshold {threshold:g}"
        for threshold, part in pick(within, measure="above", hold_off=hold_offs[-1]).groupby("threshold")
    ]
    means = pick(within, measure="above").groupby("threshold")["mean"]
    apart = float((means.max() - means.min()).max())
    lift = float(memory_alone().capacity[0] / memory_alone().increase.sum())
    return sentences(f"""
        - At most 1 % of the time above the capacity, hold-off {hold_offs[-1]:g}: latencies up to
          {"; ".join(levels[::-1])}. That is what the threshold leaves for the growth over the latency,
          {lift:.1f} periods for all of the capacity; hold-offs from {hold_offs[0]:g} to {hold_offs[-1]:g}
          move it by at most {apart:.2f}.
        - Shares at most 5 % off, threshold {_LONGER:g}: latencies up to {shares(short)} (looked for up
          to {_LONGEST:g}). In runs of {longer["until"].max():,.0f} instead of {short["until"].min():,.0f},
          with less noise, it is {shares(longer)}.
    """)


def _about_loss(table: pd.DataFrame) -> list[str]:
    short, longer = _lengths(table)
    hold_offs, thresholds = np.unique(short["hold_off"]), np.unique(short["threshold"])[::-1]

    def say(rows: pd.DataFrame, threshold: float, hold_off: float) -> str:
        rows = pick(rows, measure="above", threshold=threshold, hold_off=hold_off)
        known, critical = number(rows, "theory"), _critical(threshold, hold_off)
        found = f"{over_draws(rows)} (theory {known:.2f}, critical {critical:.2f})"
        return f"{found} with hold-off {hold_off:g} and threshold {threshold:g}"

    levels = "; ".join(
        say(short, threshold, hold_off)
        for threshold in thresholds
        for hold_off in hold_offs
        if hold_off in {0.25, 0.5, 1.0}
    )
    shares = pick(short, measure="misallocation")
    beyond = (shares["mean"] - _criticals(shares)).min()
    slow = hold_offs[hold_offs <= 1.0][-1]
    aged = ""
    if longer["until"].max() > short["until"].min():
        aged = f"""In runs of {longer["until"].max():,.0f} instead of {short["until"].min():,.0f} it is
            {say(longer, _AGED, slow)}."""
    return sentences(f"""
        - At most 1 % of the time above the capacity: losses up to {levels}. {aged}
        - Losses that are the same for all cost no shares: the first hold-off and threshold at which these are
          more than 5 % off are so at {beyond:+.2f} from the critical loss.
    """)


main = command("usable", study, __doc__)

if __name__ == "__main__":
    main()
