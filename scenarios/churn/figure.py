"""The figure of the study of churn."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import colour
from aimd_des.plots.style import REFERENCE, frame, number_axis
from scenarios.churn.runs import KEPT, WAYS, Size, Together
from scenarios.churn.theory import CRITICAL_STAY, fluid, kinds, optimum, steady
from scenarios.common.replicate import mean_and_error

__all__ = ["figure_of", "still"]


def figure_of(table: pd.DataFrame, together: dict[str, list[Together]], size: Size) -> Figure:
    """Draw what churn does, and what those do who come back together.

    Parameters
    ----------
    table : DataFrame
        All numbers.
    together : dict of str to list of Together
        Runs in which a quarter leaves together.
    size : Size
        When.

    Returns
    -------
    Figure
        Four panels.
    """
    figure = Figure(figsize=(12.5, 8.6), layout="constrained")
    panels = figure.subplots(2, 2)
    _draw_use(panels[0, 0], table)
    _draw_tracking(panels[0, 1], table)
    _draw_shares(panels[1, 0], table)
    _draw_return(panels[1, 1], together, size)
    for axes in panels.flat:
        axes.legend(frameon=False, fontsize="small")
    return figure


def pick(table: pd.DataFrame, way: str, name: str) -> pd.DataFrame:
    chosen = (table["way"] == way) & (table["measure"] == name) & np.isfinite(table["stay"])
    rows: pd.DataFrame = table.loc[chosen]
    return rows


def still(table: pd.DataFrame, way: str, name: str) -> float:
    """Look up what there is without churn.

    Parameters
    ----------
    table : DataFrame
        All numbers.
    way, name : str
        How cameras average and return, and the measure.

    Returns
    -------
    float
        The mean.
    """
    rows = table[(table["way"] == way) & (table["measure"] == name) & np.isinf(table["stay"])]
    return float(rows["mean"].iloc[0])


def _points(
    axes: Axes, rows: pd.DataFrame, place: int, label: str, scale: float = 1.0, **kwargs: Any
) -> None:
    axes.errorbar(
        rows["stay"],
        scale * rows["mean"],
        2.0 * scale * rows["standard_error"],
        fmt="os^D"[place],
        color=colour(place),
        markersize=5.5,
        capsize=2.5,
        label=label,
        **kwargs,
    )


def _dress(axes: Axes, title: str, label: str) -> None:
    axes.set_xscale("log")
    axes.set_xlabel("mean stay of a camera (periods)")
    axes.set_ylabel(label)
    axes.set_title(title, loc="left", fontsize="medium")
    axes.set_ylim(bottom=0.0)
    number_axis(axes.xaxis)
    number_axis(axes.yaxis)
    frame(axes)


def _draw_use(axes: Axes, table: pd.DataFrame) -> None:
    stays = pick(table, KEPT, "signals")["stay"]
    grid = np.geomspace(stays.min(), stays.max(), 24)
    for place, (name, label) in enumerate(
        (("utilisation", "mean total demand over capacity"), ("signals", "signals per period"))
    ):
        _points(axes, pick(table, KEPT, name), 2 + place, label)
        axes.plot(
            grid, [getattr(steady(stay), name) for stay in grid], color=colour(2 + place), linewidth=1.4
        )
    axes.axvline(CRITICAL_STAY, color=REFERENCE, linewidth=1.0, linestyle="--")
    axes.text(CRITICAL_STAY * 1.04, 0.5, "critical stay\nC / (n alpha)", fontsize="small", color=REFERENCE)
    axes.plot([], [], color=REFERENCE, linewidth=1.4, label="theory")
    _dress(axes, "(a) Use gives way late, signals long before", "share of capacity; signals")


def _draw_tracking(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(WAYS):
        _points(
            axes, pick(table, way, "tracking"), place, f"average: {way}", 100.0, linestyle=":", linewidth=0.9
        )
        axes.axhline(
            100.0 * still(table, way, "tracking"), color=colour(place), linewidth=0.8, linestyle="--"
        )
    axes.plot([], [], color=REFERENCE, linewidth=0.8, linestyle="--", label="the same without churn")
    _dress(axes, "(b) Averages against the optimum of those present", "tracking error (%)")


def _draw_shares(axes: Axes, table: pd.DataFrame) -> None:
    for face, name in (("full", "from plain optimum"), ("none", "from churned optimum")):
        rows = pick(table, KEPT, name)
        _points(axes, rows, 0, name, 100.0, fillstyle=face)
        axes.plot(rows["stay"], 100.0 * rows["theory"], color=colour(0), linewidth=1.4)
    _dress(axes, "(c) Churn evens out the shares", "distance of the averages (%)")


def _draw_return(axes: Axes, together: dict[str, list[Together]], size: Size) -> None:
    agents, times = kinds()["returning, costs of power 6"], size.times - size.back
    for place, (name, found) in enumerate(together.items()):
        shade = colour(4 + place)
        courses = [[part[:, agents].mean(axis=1) for part in (run.demand, run.average)] for run in found]
        mean, error = mean_and_error(courses)
        for k, width in ((0, 0.9), (1, 2.2)):
            low, high = mean[k] - 2 * error[k], mean[k] + 2 * error[k]
            axes.fill_between(times, low, high, color=shade, alpha=0.25, linewidth=0)
            axes.plot(times, mean[k], color=shade, linewidth=width)
            axes.plot(times, fluid(name, size)[k][:, agents].mean(axis=1), ":", color="black", linewidth=0.9)
        axes.plot([], [], color=shade, linewidth=2.2, label=f"{name} (thin: demand)")
    axes.axhline(optimum()[agents].mean(), color=REFERENCE, linewidth=1.0, linestyle="--")
    axes.plot([], [], ":", color="black", linewidth=0.9, label="theory (fluid)")
    axes.set_xlabel("time since a quarter is back (periods)")
    axes.set_ylabel("memory of a camera with costs of power 6 (GB)")
    axes.set_title("(d) Who has forgotten takes too much", loc="left", fontsize="medium")
    axes.set_ylim(bottom=0.0)
    number_axis(axes.xaxis)
    number_axis(axes.yaxis)
    frame(axes)
