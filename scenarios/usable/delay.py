"""The map of usable delay: over hold-offs and thresholds."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from scipy.optimize import brentq

from aimd_des import InputError, theory
from scenarios.common import figures
from scenarios.common.command import sentences
from scenarios.common.measure import distance
from scenarios.common.systems import lowered, memory_alone
from scenarios.common.tables import number, over_draws, pick
from scenarios.usable.frame import MOST, Case, Map, Seen, Setting, draw_edges

_MOST = 32.0
_THRESHOLDS = (1.0, 0.95, 0.9, 0.8)
# The threshold at which shares decide: with more draws of the costs, and runs that are three times as long.
_LONGER, _MANY = 0.9, 24


def _cases(quick: bool) -> list[Case]:
    """List hold-offs, thresholds and lengths of runs."""
    if quick:
        return [Case("latency", 8.0, 0.05, Setting(hold_off, _LONGER), 1_500.0, 2) for hold_off in (0.1, 1.0)]
    cases = [
        Case(
            "latency",
            _MOST,
            0.02,
            Setting(hold_off, threshold),
            3_000.0,
            _MANY if threshold == _LONGER else 10,
        )
        for threshold in _THRESHOLDS
        for hold_off in (0.1, 0.2, 0.4, 0.7, 1.0, 1.3)
    ]
    return cases + [
        Case("latency", _MOST, 0.02, Setting(hold_off, _LONGER), 9_000.0) for hold_off in (0.1, 0.4, 0.7, 1.3)
    ]


@cache
def _cycle(hold_off: float, threshold: float, latency: float) -> tuple[float, float]:
    """Predict the time above the capacity, and the misallocation without noise."""
    problem = lowered(memory_alone(), threshold)
    found = theory.limit_cycle(problem, hold_off, latency)
    growth = float(problem.increase.sum() / problem.capacity[0])
    beyond = threshold + growth * latency - 1.0
    return max(beyond, 0.0) / growth / float(found.period[0]), float(distance(problem, found.allocation)[0])


def _expected(case: Case) -> Seen:
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


def _draw(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    """Draw how far each limit is kept, over hold-offs, for thresholds and for lengths of runs."""
    titles = "(a) At most 1 % of the time above the capacity", "(b) Shares at most 5 % off"
    for axes, measure, title in zip(panels, MOST, titles, strict=True):
        draw_edges(axes, table, measure, f"{_LONGER:g}")
        limits: dict[str, Any] = {"xscale": "log", "yscale": "log", "ylim": (0.01, 1.2 * _MOST)}
        figures.dress(axes, title, "hold-off (control periods)", "latency up to (control periods)", **limits)
        axes.legend(fontsize="small", frameon=False, loc=(0.03, 0.12), ncols=2)


def _findings(table: pd.DataFrame) -> list[str]:
    short, longer = (pick(table, until=until) for until in (table["until"].min(), table["until"].max()))
    within = short[short["hold_off"] <= 0.7]
    hold_offs = np.unique(within["hold_off"])

    def say(rows: pd.DataFrame, measure: str, **wanted: Any) -> str:
        known = number(rows, "theory", measure=measure, **wanted)
        return f"{over_draws(rows, measure=measure, **wanted)}, theory {known:.2f}"

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
          to {_MOST:g}). In runs of {longer["until"].max():,.0f} instead of {short["until"].min():,.0f},
          with less noise, it is {aged}.
    """)


DELAY = Map("latency", _cases, _expected, _draw, _findings)
