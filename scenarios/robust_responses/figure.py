"""The figure of `robust_responses`: in each column what is won above, and what it costs below."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.plots import colour
from aimd_des.plots.style import REFERENCE, frame, number_axis

__all__ = ["draw"]

_MARKS = "os^D"


def draw(table: pd.DataFrame, critical: Mapping[str, float]) -> Figure:
    """Draw compensation of loss, thresholds, and hold-offs under latency and loss.

    Parameters
    ----------
    table : DataFrame
        All numbers of the study.
    critical : mapping of str to float
        Critical loss of each hold-off, by theory.

    Returns
    -------
    Figure
        Four columns of two panels.
    """
    figure = Figure(figsize=(13.0, 7.4), layout="constrained")
    panels = figure.subplots(2, 4, sharex="col")
    _losses(panels[:, 0], table)
    _thresholds(panels[:, 1], table[table["panel"] == "threshold"])
    _hold_offs(panels[:, 2], table[table["panel"] == "latency"], "latency (control periods)")
    _hold_offs(panels[:, 3], table[table["panel"] == "loss"], "probability of loss, the same for all")
    for name, place in (("fixed 0.25", 0), ("fixed 1", 1)):
        for axes in panels[:, 3]:
            axes.axvline(critical[name], color=colour(place), linewidth=1.0, linestyle="--")
    panels[0, 3].plot([], [], color=REFERENCE, linewidth=1.0, linestyle="--", label="critical loss by theory")
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
        frame(axes)
    return figure


def _bars(
    axes: Axes, rows: pd.DataFrame, place: int, label: str = "", *, scale: float = 1.0, joined: bool = True
) -> None:
    axes.errorbar(
        rows["at"],
        scale * rows["mean"],
        2.0 * scale * rows["standard_error"],
        fmt=_MARKS[place],
        linestyle=":" if joined else "none",
        linewidth=0.8,
        color=colour(place),
        markersize=6.5 - place,
        capsize=2.5,
        label=label,
    )


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
        pick = {measure: rows[rows["measure"] == measure] for measure in rows["measure"].unique()}
        _bars(top, pick["misallocation"], place, f"{dynamics}, {resource}", scale=100.0, joined=False)
        pooled = pick["misallocation of the mean"]
        top.plot(pooled["at"], 100 * pooled["theory"].where(pooled["theory"] > 0.004), "_k", markersize=10)
        _bars(bottom, pick["bits"], place, joined=False)
    top.plot([], [], "_k", markersize=10, label="theory")
    top.axhline(2.0, color=REFERENCE, linewidth=1.0, linestyle=":")
    for axes, label in ((top, "misallocation of a single run (%)"), (bottom, "bits per unit of time")):
        axes.set_yscale("log")
        axes.set_ylabel(label)
        number_axis(axes.yaxis)
    bottom.set_xticks(range(len(ways)), ways, rotation=40)
    bottom.set_xlabel("what agents know of their loss")


def _thresholds(panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame) -> None:
    top, bottom = panels
    for place, name in enumerate(dict.fromkeys(table["setting"])):
        rows = table[table["setting"] == name]
        _bars(top, rows[rows["measure"] == "above"], place, name, scale=100.0)
        used = rows[rows["measure"] == "used"]
        _bars(bottom, used, place, scale=100.0)
        bottom.plot(used["at"], 100 * used["theory"], color=colour(place), linewidth=1.4)
    top.axhline(1.0, color=REFERENCE, linewidth=1.0, linestyle=":")
    top.plot([], [], color=REFERENCE, linewidth=1.4, label="theory")
    top.set_ylabel("time above the capacity (%)")
    bottom.set_ylabel("mean total demand (% of the capacity)")
    bottom.set_xlabel("latency (control periods)")
    for axes in panels:
        number_axis(axes.yaxis)


def _hold_offs(
    panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame, what: str
) -> None:
    for axes, measure in zip(panels, ("used", "bits"), strict=True):
        for place, name in enumerate(dict.fromkeys(table["setting"])):
            rows = table[(table["setting"] == name) & (table["measure"] == measure)]
            _bars(axes, rows, place, f"hold-off {name}")
            axes.plot(rows["at"], rows["theory"], color=colour(place), linewidth=1.4)
        number_axis(axes.yaxis)
    panels[0].axhline(1.0, color=REFERENCE, linewidth=1.0, linestyle=":")
    panels[0].plot([], [], color=REFERENCE, linewidth=1.4, label="theory")
    panels[0].set_ylabel("mean total demand over capacity")
    panels[1].set_ylabel("bits per unit of time")
    panels[1].set_xlabel(what)
