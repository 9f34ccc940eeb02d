"""The map of usable loss, the same for all agents: over hold-offs and thresholds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from aimd_des import theory
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import sentences
from scenarios.common.systems import lowered, memory_alone, usable
from scenarios.common.tables import number, over_draws, pick
from scenarios.usable.frame import MOST, Case, Map, Seen, Setting, draw_edges, thresholds

_MOST = 0.95
_THRESHOLDS = (1.0, 0.95, 0.9)
_HOLD_OFFS = (0.1, 0.25, 0.5, 0.75, 1.0, 1.25)
# The threshold at which runs are also three times as long.
_LONGER = 1.0


def _cases(quick: bool) -> list[Case]:
    """List hold-offs, thresholds and lengths of runs."""
    if quick:
        return [Case("loss", _MOST, 0.02, Setting(hold_off), 1_000.0, 2) for hold_off in (0.25, 1.0)]
    cases = [
        Case("loss", _MOST, 0.005, Setting(hold_off, threshold), 3_000.0)
        for threshold in _THRESHOLDS
        for hold_off in _HOLD_OFFS
    ]
    return cases + [
        Case("loss", _MOST, 0.005, Setting(hold_off, _LONGER), 9_000.0) for hold_off in (0.25, 1.0)
    ]


def _expected(case: Case) -> Seen:
    """Predict how far demand stays below the capacity; of shares there is no prediction beyond."""
    setting = case.setting
    problem = lowered(memory_alone(), setting.threshold)
    return Seen(usable(problem, setting.hold_off), np.nan)


def _critical(threshold: float, hold_off: float) -> float:
    problem = memory_alone()
    needed = theory.needed_rate(problem, capacity=threshold * problem.capacity)
    return float(theory.critical_loss(needed, hold_off=hold_off)[0])


def _draw(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    """Draw how far each limit is kept, over hold-offs, for thresholds and for lengths of runs."""
    titles = "(c) At most 1 % of the time above the capacity", "(d) Shares at most 5 % off"
    hold_offs = np.unique(table["hold_off"])
    for axes, measure, title in zip(panels, MOST, titles, strict=True):
        draw_edges(axes, table, measure, f"{_LONGER:g}")
        for place, threshold in enumerate(thresholds(table)):
            limit = [_critical(threshold, hold_off) for hold_off in hold_offs]
            axes.plot(hold_offs, limit, "--", color=colour(place), linewidth=1.0)
        figures.named(axes, "critical loss by theory", "--", linewidth=1.0)
        limits: dict[str, Any] = {"xlim": (0.0, 1.3), "ylim": (-0.02, 1.0)}
        figures.dress(axes, title, "hold-off (control periods)", "loss up to", **limits)
        axes.legend(fontsize="small", frameon=False, loc="lower left")


def _findings(table: pd.DataFrame) -> list[str]:
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
            {say(longer, _LONGER, slow)} with hold-off {slow:g} and threshold {_LONGER:g}."""
    return sentences(f"""
        - At most 1 % of the time above the capacity: losses up to {levels}. {aged}
        - Losses that are the same for all cost no shares: the first hold-off and threshold at which these are
          more than 5 % off are so at {beyond:+.2f} from the critical loss.
    """)


LOSS = Map("loss", _cases, _expected, _draw, _findings)
