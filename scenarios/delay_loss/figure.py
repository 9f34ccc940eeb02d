"""Maps of `delay_loss`: every measure over latency and loss, with the loss that theory says is survived."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from aimd_des import plots
from aimd_des.lowlevel import FloatArray


class Map(NamedTuple):
    """A measure and how it is shown."""

    measure: str  # column of the means
    label: str  # beside the colours, with the unit
    message: str  # what the map shows at a glance
    scale: str  # how values become colours


MAPS = (
    Map("utilisation", "mean demand over capacity", "above the line demand runs away", "around 1"),
    Map("misallocation", "misallocation (%)", "shares stay right", "log"),
    Map("overshoot_mean", "mean excess over capacity (%)", "what latency costs", "log"),
    Map("signals", "signals per control period", "loss is paid in signals", "linear"),
    Map("saturated", "responses cut off at 1 (%)", "only where demand runs away", "linear"),
)
_LEAST = 0.1  # percent: what is smaller has one colour


def draw(means: pd.DataFrame, critical: Mapping[str, float], resource: str) -> Figure:
    """Draw the maps of one resource, a column for each dynamics with its critical loss.

    Means have a row for each point: dynamics, latency, loss and the measures.
    """
    figure = Figure(figsize=(10.4, 14.0), layout="constrained")
    figure.suptitle(
        f"{resource} of the paper's system; the line is the loss that is survived, by theory",
        fontsize="medium",
    )
    grid = figure.subplots(len(MAPS), len(critical), sharex=True, sharey=True, squeeze=False)
    for row, shown in zip(grid, MAPS, strict=True):
        norm = _norm(means[shown.measure].to_numpy(), shown.scale)
        for axes, (dynamics, loss) in zip(row, critical.items(), strict=True):
            mesh = _draw_map(axes, means[means["dynamics"] == dynamics], shown, norm, loss)
            axes.set_title(f"{dynamics}: {shown.message}", loc="left", fontsize="medium")
        bar = figure.colorbar(
            mesh, ax=list(row), pad=0.015, extend="min" if shown.scale == "log" else "neither"
        )
        bar.set_label(shown.label)
        if shown.scale == "log":
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    return figure


def _norm(values: FloatArray, scale: str) -> Normalize:
    if scale == "log":
        return LogNorm(_LEAST, max(float(values.max()), 10.0 * _LEAST))
    if scale == "around 1":
        return TwoSlopeNorm(1.0, min(float(values.min()), 0.9), max(float(values.max()), 1.1))
    return Normalize(0.0, max(float(values.max()), 1e-9))


def _draw_map(axes: Axes, rows: pd.DataFrame, shown: Map, norm: Normalize, loss: float) -> QuadMesh:
    """Draw one map, and return what a bar of colours is made from."""
    latencies = np.unique(rows["latency"])
    across = (2.0 * latencies[0] - latencies[1], 2.0 * latencies[-1] - latencies[-2])  # beyond both ends
    plots.heat_map(axes, rows, "latency", "loss", shown.measure, norm=norm, boundary=(across, (loss, loss)))
    axes.set(xlabel="latency (control periods)", ylabel="probability of loss")
    axes.label_outer()
    return next(mesh for mesh in axes.collections if isinstance(mesh, QuadMesh))
