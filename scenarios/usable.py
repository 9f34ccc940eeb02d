"""Which delays and losses are usable: demand below the capacity, shares right?

Usable is what leaves demand above the capacity for at most 1 % of the time, and averages at most 5 % from the
optimum for what they use.  The first depends on the threshold: the growth over the latency must fit between
it and the capacity, with any hold-off.  The second depends on the hold-off: signals in flight may take about
one and a half times the capacity.  The limit cycle of theory predicts both.  Losses that are the same for all
cost no shares; the loss that leaves demand below the capacity is less than the critical one.
"""  # noqa: D400 - a question

from collections.abc import Callable, Sequence
from functools import cache, partial
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
from scenarios.common.measure import distance, late, rows_of, run_draws, run_late
from scenarios.common.systems import lowered, memory_alone, usable
from scenarios.common.tables import beside_theory, number, over_draws, pick, shown, summarise_draws

#: What is usable: at most this share of the time above the capacity, and this distance from the optimum.
MOST = {"above": 0.01, "misallocation": 0.05}
# Where an edge is looked for first, as a part of the range.
_FIRST = 0.125
#: Rows of the table: how far each of the limits is kept, and both.
BOTH = "both"


class Setting(NamedTuple):
    """Memory of the paper's system by itself, with continuous cameras."""

    hold_off: float
    threshold: float = 1.0
    latency: float = 0.0
    loss: float = 0.0


class Case(NamedTuple):
    """What rises, and in which setting."""

    rises: Literal["latency", "loss"]
    most: float  # up to where it is looked for
    exact: float  # how exactly it is located
    setting: Setting
    until: float  # length of a run, of which the first fifth is cut off
    draws: int = 10  # of the costs


class Seen(NamedTuple):
    """How far each limit is kept: 0 where it never is, and `most` where it always is."""

    above: float
    misallocation: float

    @property
    def both(self) -> float:
        """How far both are kept."""
        return min(self)


def search(case: Case, draw: int, seed: int) -> Seen:
    """Locate where each limit is passed, in runs that share their seed."""
    measured = cache(partial(_measure, case, draw, seed))
    return Seen(*(_edge(case, partial(_beyond, measured, name)) for name in MOST))


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
    setting = case.setting._replace(**{case.rises: value})
    problem = lowered(memory_alone(draw=draw), setting.threshold)
    channel = BroadcastChannel(latency=setting.latency, loss=setting.loss)
    span = (0.2 * case.until, case.until)
    seen = late(run_late(problem, setting.hold_off, channel, span, seed, "end"), span[0])
    return {"above": seen.time_above, "misallocation": float(distance(problem, seen.average)[0])}


def draw_edges(axes: Axes, table: pd.DataFrame, measure: str, longer: str) -> None:
    """Draw how far a limit is kept, over hold-offs: each threshold beside theory, and longer runs."""
    short = pick(table, measure=measure, until=table["until"].min())
    for place, threshold in enumerate(thresholds(table)):
        rows = pick(short, threshold=threshold)
        figures.curve(axes, rows["hold_off"], rows, place, f"threshold {threshold:g}")
    rows = pick(table, measure=measure, until=table["until"].max())
    axes.plot(rows["hold_off"], rows["mean"], "x", color="black", label=f"{longer}, runs longer")
    figures.named(axes, "theory")


def thresholds(table: pd.DataFrame) -> list[float]:
    """List the thresholds of a map, the highest first."""
    return sorted(table["threshold"].unique(), reverse=True)


_LONGEST = 32.0
_THRESHOLDS = (1.0, 0.95, 0.9, 0.8)
# The threshold at which shares decide: with more draws of the costs, and runs that are three times as long.
_LONGER, _MANY = 0.9, 24


def _delays(quick: bool) -> list[Case]:
    """List hold-offs, thresholds and lengths of runs."""
    if quick:
        return [Case("latency", 8.0, 0.05, Setting(hold_off, _LONGER), 1_500.0, 2) for hold_off in (0.1, 1.0)]
    several = [
        Case("latency", _LONGEST, 0.02, Setting(hold_off, threshold), 3_000.0)
        for threshold in _THRESHOLDS
        for hold_off in (0.1, 0.2, 0.4, 0.7, 1.0, 1.3)
    ]
    cases = [case._replace(draws=_MANY) if case.setting.threshold == _LONGER else case for case in several]
    longer = [Setting(hold_off, _LONGER) for hold_off in (0.1, 0.4, 0.7, 1.3)]
    return cases + [Case("latency", _LONGEST, 0.02, setting, 9_000.0) for setting in longer]


@cache
def _cycle(hold_off: float, threshold: float, latency: float) -> tuple[float, float]:
    """Predict the time above the capacity, and the misallocation without noise."""
    problem = lowered(memory_alone(), threshold)
    found = theory.limit_cycle(problem, hold_off, latency)
    growth = float(problem.increase.sum() / problem.capacity[0])
    beyond = threshold + growth * latency - 1.0
    return max(beyond, 0.0) / growth / float(found.period[0]), float(distance(problem, found.allocation)[0])


def usable_delay(case: Case) -> Seen:
    """Predict how far each limit is kept; NaN where signals do not suffice at the threshold."""
    setting = case.setting

    def edge(place: int, limit: float) -> float:
        def beyond(latency: float) -> float:
            return _cycle(setting.hold_off, setting.threshold, latency)[place] - limit

        return float(brentq(beyond, 0.0, case.most, xtol=1e-3)) if beyond(case.most) > 0.0 else case.most

    try:
        return Seen(*(edge(place, limit) for place, limit in enumerate(MOST.values())))
    except InputError:
        return Seen(np.nan, np.nan)


def _draw_delay(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    """Draw how far each limit is kept, over hold-offs, for thresholds and for lengths of runs."""
    titles = "(a) At most 1 % of the time above the capacity", "(b) Shares at most 5 % off"
    for axes, measure, title in zip(panels, MOST, titles, strict=True):
        draw_edges(axes, table, measure, f"{_LONGER:g}")
        limits: dict[str, Any] = {"xscale": "log", "yscale": "log", "ylim": (0.01, 1.2 * _LONGEST)}
        figures.dress(axes, title, "hold-off (control periods)", "latency up to (control periods)", **limits)
        axes.legend(fontsize="small", frameon=False, loc=(0.03, 0.12), ncols=2)


def _about_delay(table: pd.DataFrame) -> list[str]:
    short, longer = (pick(table, until=until) for until in (table["until"].min(), table["until"].max()))
    within = short[short["hold_off"] <= 0.7]
    hold_offs = np.unique(within["hold_off"])

    def say(rows: pd.DataFrame, measure: str, **wanted: Any) -> str:
        return beside_theory(rows, measure=measure, **wanted)

    levels = [
        f"{say(within, 'above', threshold=threshold, hold_off=hold_offs[-1])}, at threshold {threshold:g}"
        for threshold in np.unique(within["threshold"])[::-1]
    ]
    means = within[within["measure"] == "above"].groupby("threshold")["mean"]
    apart = float((means.max() - means.min()).max())
    shares = [
        f"{say(short, 'misallocation', threshold=_LONGER, hold_off=hold_off)}, at hold-off {hold_off:g}"
        for hold_off in np.unique(short["hold_off"])
    ]
    aged = "; ".join(
        f"{say(longer, 'misallocation', threshold=_LONGER, hold_off=hold_off)}, at hold-off {hold_off:g}"
        for hold_off in np.unique(longer["hold_off"])
    )
    lift = float(memory_alone().capacity[0] / memory_alone().increase.sum())
    return sentences(f"""
        - At most 1 % of the time above the capacity, hold-off {hold_offs[-1]:g}: latencies up to
          {"; ".join(levels)}. That is what the threshold leaves for the growth over the latency, {lift:.1f}
          periods for all of the capacity; hold-offs from {hold_offs[0]:g} to {hold_offs[-1]:g} move it by
          at most {apart:.2f}.
        - Shares at most 5 % off, threshold {_LONGER:g}: latencies up to {"; ".join(shares)} (looked for up
          to {_LONGEST:g}). In runs of {longer["until"].max():,.0f} instead of {short["until"].min():,.0f},
          with less noise, it is {aged}.
    """)


_LARGEST = 0.95
_LEVELS = (1.0, 0.95, 0.9)
_HOLD_OFFS = (0.1, 0.25, 0.5, 0.75, 1.0, 1.25)
# The threshold at which runs are also three times as long.
_AGED = 1.0


def _losses(quick: bool) -> list[Case]:
    """List hold-offs, thresholds and lengths of runs."""
    if quick:
        return [Case("loss", _LARGEST, 0.02, Setting(hold_off), 1_000.0, 2) for hold_off in (0.25, 1.0)]
    cases = [
        Case("loss", _LARGEST, 0.005, Setting(hold_off, threshold), 3_000.0)
        for threshold in _LEVELS
        for hold_off in _HOLD_OFFS
    ]
    longer = [Setting(hold_off, _AGED) for hold_off in (0.25, 1.0)]
    return cases + [Case("loss", _LARGEST, 0.005, setting, 9_000.0) for setting in longer]


def usable_loss(case: Case) -> Seen:
    """Predict how far demand stays below the capacity; of shares there is no prediction beyond."""
    setting = case.setting
    problem = lowered(memory_alone(), setting.threshold)
    return Seen(usable(problem, setting.hold_off), np.nan)


def _critical(threshold: float, hold_off: float) -> float:
    problem = memory_alone()
    needed = theory.needed_rate(problem, capacity=threshold * problem.capacity)
    return float(theory.critical_loss(needed, hold_off=hold_off)[0])


def _draw_loss(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    """Draw how far each limit is kept, over hold-offs, for thresholds and for lengths of runs."""
    titles = "(c) At most 1 % of the time above the capacity", "(d) Shares at most 5 % off"
    hold_offs = np.unique(table["hold_off"])
    for axes, measure, title in zip(panels, MOST, titles, strict=True):
        draw_edges(axes, table, measure, f"{_AGED:g}")
        for place, threshold in enumerate(thresholds(table)):
            limit = [_critical(threshold, hold_off) for hold_off in hold_offs]
            axes.plot(hold_offs, limit, "--", color=colour(place), linewidth=1.0)
        figures.named(axes, "critical loss by theory", "--", linewidth=1.0)
        limits: dict[str, Any] = {"xlim": (0.0, 1.3), "ylim": (-0.02, 1.0)}
        figures.dress(axes, title, "hold-off (control periods)", "loss up to", **limits)
        axes.legend(fontsize="small", frameon=False, loc="lower left")


def _about_loss(table: pd.DataFrame) -> list[str]:
    short, longer = (pick(table, until=until) for until in (table["until"].min(), table["until"].max()))
    hold_offs, thresholds = np.unique(short["hold_off"]), np.unique(short["threshold"])[::-1]

    def say(rows: pd.DataFrame, threshold: float, hold_off: float) -> str:
        wanted: dict[str, Any] = {"measure": "above", "threshold": threshold, "hold_off": hold_off}
        known = number(rows, "theory", **wanted)
        critical = _critical(threshold, hold_off)
        return f"{over_draws(rows, **wanted)} (theory {known:.2f}, critical {critical:.2f})"

    levels = "; ".join(
        f"{say(short, threshold, hold_off)} with hold-off {hold_off:g} and threshold {threshold:g}"
        for threshold in thresholds
        for hold_off in hold_offs
        if hold_off in {0.25, 0.5, 1.0}
    )
    shares = pick(short, measure="misallocation")
    beyond = min(
        mean - _critical(threshold, hold_off)
        for mean, threshold, hold_off in zip(
            shares["mean"], shares["threshold"], shares["hold_off"], strict=True
        )
    )
    slow = hold_offs[hold_offs <= 1.0][-1]
    aged = ""
    if longer["until"].max() > short["until"].min():
        aged = f"""In runs of {longer["until"].max():,.0f} instead of {short["until"].min():,.0f} it is
            {say(longer, _AGED, slow)} with hold-off {slow:g} and threshold {_AGED:g}."""
    return sentences(f"""
        - At most 1 % of the time above the capacity: losses up to {levels}. {aged}
        - Losses that are the same for all cost no shares: the first hold-off and threshold at which these are
          more than 5 % off are so at {beyond:+.2f} from the critical loss.
    """)


_LABELS = ["rises", "hold_off", "threshold", "other", "until"]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Search how far latencies or losses may rise before a limit is passed, over draws of the costs."""
    cases = [*_delays(quick), *_losses(quick)]
    pairs = [
        pair
        for count in sorted({case.draws for case in cases})
        for pair in run_draws(
            search, [case for case in cases if case.draws == count], count, 1, seed, quick, runs
        )
    ]
    rows = rows_of(pairs, lambda case, _, seen: {**_labels(case), **seen._asdict(), BOTH: seen.both})
    table = summarise_draws(rows, _LABELS)
    expected = {
        tuple(_labels(case).values()): (usable_delay if case.rises == "latency" else usable_loss)(case)
        for case in cases
    }
    table["theory"] = [
        getattr(expected[tuple(row[name] for name in _LABELS)], row["measure"])
        for row in table.to_dict("records")
    ]
    latencies, losses = (pick(table, rises=name) for name in ("latency", "loss"))
    settings = {"seed": seed, "draws": max(case.draws for case in cases)}
    findings = [*_about_delay(latencies), *_about_loss(losses)]
    printed = shown(table, [*_LABELS, "measure"], ".2f")
    drawn = {"usable": partial(_figure, latencies, losses)}
    return Finding("usable", settings, table, printed, findings, drawn)


def _labels(case: Case) -> dict[str, Any]:
    """Name a case; `other` is the loss where the latency rises, and the latency where the loss does."""
    setting = case.setting
    other = setting.loss if case.rises == "latency" else setting.latency
    values = case.rises, setting.hold_off, setting.threshold, other, case.until
    return dict(zip(_LABELS, values, strict=True))


def _figure(latencies: pd.DataFrame, losses: pd.DataFrame) -> Figure:
    figure, panels = figures.panels(2, 2, (11.0, 9.2))
    _draw_delay(panels[:2], latencies)
    _draw_loss(panels[2:], losses)
    return figure


main = command("usable", study, __doc__)

if __name__ == "__main__":
    main()
