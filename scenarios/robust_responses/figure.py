"""The figure of `robust_responses`: in each column what is won above, and what it costs below."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.tables import pick


def draw(table: pd.DataFrame, critical: Mapping[str, float]) -> Figure:
    """Draw compensation of loss, thresholds, and hold-offs with their critical losses, in four columns."""
    figure = Figure(figsize=(13.0, 7.4), layout="constrained")
    panels = figure.subplots(2, 4, sharex="col")
    _losses(panels[:, 0], table)
    _thresholds(panels[:, 1], table[table["panel"] == "threshold"])
    _hold_offs(panels[:, 2], table[table["panel"] == "latency"], "latency (control periods)")
    _hold_offs(panels[:, 3], table[table["panel"] == "loss"], "probability of loss, the same for all")
    for name, place in (("fixed 0.25", 0), ("fixed 1", 1)):
        for axes in panels[:, 3]:
            axes.axvline(critical[name], color=colour(place), linewidth=1.0, linestyle="--")
    figures.named(panels[0, 3], "critical loss by theory", "--", linewidth=1.0)
    titles = (
        "(a) Losses 0 to 0.5: who answers\nmore often gets the right share",
        "(b) A lower threshold keeps\ndemand below the capacity",
        "(c) Latency: a hold-off that adapts\nmust be bounded below 1 / rho",
        "(d) Loss: a hold-off that adapts\nis as good as a short one",
    )
    for column, title in enumerate(titles):
        panels[0, column].set_title(title, loc="left", fontsize="medium")
        handles, labels = panels[0, column].get_legend_handles_labels()
        below = -0.22 if column else -0.4  # names of the ways need more room than numbers
        panels[1, column].legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=(-0.1, below),
            fontsize="small",
            frameon=False,
            handlelength=1.6,
        )
    for axes in panels.flat:
        figures.frame(axes)
    return figure


def _bars(
    axes: Axes, rows: pd.DataFrame, place: int, label: str = "", *, scale: float = 1.0, joined: bool = True
) -> None:
    look: dict[str, Any] = {
        "linestyle": ":" if joined else "none",
        "linewidth": 0.8,
        "markersize": 6.5 - place,
    }
    figures.points(axes, rows["at"], rows, place, label, scale=scale, **look)


def _losses(panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame) -> None:
    ways = list(dict.fromkeys(table.loc[table["panel"].str.startswith("loss, "), "setting"]))
    kinds = [
        ("continuous", "memory"),
        ("continuous", "disk"),
        ("continuous", "bandwidth"),
        ("discrete", "memory"),
    ]
    top, bottom = panels
    for place, (dynamics, resource) in enumerate(kinds):
        rows = table[(table["panel"] == f"loss, {dynamics}") & (table["resource"] == resource)].copy()
        rows["at"] = rows["setting"].map(ways.index) + 0.12 * (place - 1.5)
        single, label = pick(rows, measure="misallocation"), f"{dynamics}, {resource}"
        _bars(top, single, place, label, scale=100.0, joined=False)
        pooled = pick(rows, measure="misallocation of the mean")
        top.plot(pooled["at"], 100 * pooled["theory"].where(pooled["theory"] > 0.004), "_k", markersize=10)
        _bars(bottom, pick(rows, measure="bits"), place, joined=False)
    figures.named(top, "theory", "_", color="black", markersize=10)
    figures.level(top, 2.0)
    for axes, label in ((top, "misallocation of a single run (%)"), (bottom, "bits per unit of time")):
        axes.set_yscale("log")
        axes.set_ylabel(label)
        figures.number_axis(axes.yaxis)
    bottom.set_xticks(range(len(ways)), ways, rotation=40)
    bottom.set_xlabel("what agents know of their loss")


def _thresholds(panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame) -> None:
    top, bottom = panels
    for place, name in enumerate(dict.fromkeys(table["setting"])):
        rows = table[table["setting"] == name]
        _bars(top, pick(rows, measure="above"), place, name, scale=100.0)
        used = pick(rows, measure="used")
        _bars(bottom, used, place, scale=100.0)
        figures.theory(bottom, used["at"], used, place, scale=100.0)
    figures.level(top, 1.0)
    figures.named(top, "theory")
    top.set_ylabel("time above the capacity (%)")
    bottom.set_ylabel("mean total demand (% of the capacity)")
    bottom.set_xlabel("latency (control periods)")
    for axes in panels:
        figures.number_axis(axes.yaxis)


def _hold_offs(
    panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame, what: str
) -> None:
    for axes, measure in zip(panels, ("used", "bits"), strict=True):
        for place, name in enumerate(dict.fromkeys(table["setting"])):
            rows = pick(table, setting=name, measure=measure)
            _bars(axes, rows, place, f"hold-off {name}")
            figures.theory(axes, rows["at"], rows, place)
        figures.number_axis(axes.yaxis)
    figures.level(panels[0], 1.0)
    figures.named(panels[0], "theory")
    panels[0].set_ylabel("mean total demand over capacity")
    panels[1].set_ylabel("bits per unit of time")
    panels[1].set_xlabel(what)
