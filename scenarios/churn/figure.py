"""The figure of the study of churn."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import colour
from scenarios.churn.runs import KEPT, WAYS, Size, Together
from scenarios.churn.theory import CRITICAL_STAY, fluid, kinds, optimum, steady
from scenarios.common import figures
from scenarios.common.figures import REFERENCE
from scenarios.common.tables import number, pick


def figure_of(table: pd.DataFrame, together: dict[str, list[Together]], size: Size) -> Figure:
    """Draw what churn does, and what those do who come back together, in four panels."""
    figure, panels = figures.panels(2, 2, (12.5, 8.6))
    _draw_use(panels[0], table)
    _draw_tracking(panels[1], table)
    _draw_shares(panels[2], table)
    _draw_return(panels[3], together, size)
    for axes in panels:
        axes.legend(frameon=False, fontsize="small")
    return figure


def still(table: pd.DataFrame, way: str, name: str) -> float:
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
    axes.axvline(CRITICAL_STAY, color=REFERENCE, linewidth=1.0, linestyle="--")
    axes.text(CRITICAL_STAY * 1.04, 0.5, "critical stay\nC / (n alpha)", fontsize="small", color=REFERENCE)
    figures.named(axes, "theory")
    _dress(axes, "(a) Use gives way late, signals long before", "share of capacity; signals")


def _draw_tracking(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(WAYS):
        rows, look = _moving(table, way, "tracking"), {"linestyle": ":", "linewidth": 0.9}
        figures.points(
            axes, rows["stay"], rows, place, f"average: {way}", scale=100.0, fmt="os^D"[place], **look
        )
        calm = 100.0 * still(table, way, "tracking")
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
