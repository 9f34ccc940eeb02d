"""Latency and loss together: which of them is survived, and what does each cost?

Loss decides whether demand is held, and latency does not. On both sides of the critical loss of theory,
the means of 20 replications agree with it at latencies from 0 to 10 periods. A few points next to it are
exceptions. Shares stay right to within 3.2 % on both sides, until responses are cut off at probability 1.
Latency is paid in excess over the capacity, loss in signals.
"""  # noqa: D400 - a question

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import CenteredNorm, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from aimd_des import Study, plots, run_study, theory
from aimd_des.lowlevel import FloatArray
from aimd_des.study import read_study, summarise
from models.smart_cameras import smart_cameras
from scenarios.common.command import Finding, command, sentences
from scenarios.common.tables import pick


class _Map(NamedTuple):
    """A measure and how it is shown."""

    measure: str  # column of the means
    label: str  # beside the colours, with the unit
    title: str  # the quantity, without its unit
    scale: str  # how values become colours


_MAPS = (
    _Map("utilisation", "mean demand over capacity", "mean demand", "around 1"),
    _Map("misallocation", "misallocation (%)", "misallocation", "log"),
    _Map("overshoot_mean", "mean excess over capacity (%)", "mean excess", "log"),
    _Map("signals", "signals per control period", "signals", "linear"),
)
# What is printed: the maps, and what is next to nothing for most points, which is no map.
_PRINTED = {shown.measure: shown.label for shown in _MAPS} | {"saturated": "responses cut off at 1 (%)"}
_LEAST = 0.1  # percent: what is smaller has one colour


_FILE = Path(__file__).with_suffix(".toml")
_AXES = ["dynamics", "latency", "loss"]
# Above this share of the opportunities the control unit signals at practically every one.
_RUN_AWAY = 0.99
# The quick size: replications, units of time, latencies and losses.
_QUICK = (2, 300.0, [0.0, 2.0, 10.0], [0.0, 0.4, 0.8])


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run the paper's system over latency and loss, continuous and discrete."""
    described = _described(quick, seed)
    # A thread will do for a second's work: a process would take longer to start.
    with TemporaryDirectory(prefix="delay_loss.") as temporary, ThreadPoolExecutor(1) as thread:
        folder = runs or Path(temporary) / "runs"
        frame = run_study(described, folder, thread if quick else None, 1 if quick else None).runs
    table, critical = _table(frame), _critical()
    table["theory"] = [critical[row["resource"]][row["dynamics"]] for row in table.to_dict("records")]
    settings = {"seed": seed, "replications": described.replications, "until": described.scenario["until"]}
    printed = _shown(table)
    drawn = {
        f"delay_loss_{name}": partial(_draw, _wide(pick(table, resource=name), _AXES), critical[name], name)
        for name in critical
    }
    return Finding("delay_loss", settings, table, printed, _findings(table), drawn)


def _described(quick: bool, seed: int) -> Study:
    """Read the study from its file; the quick size has fewer points and shorter runs."""
    full = read_study(_FILE).model_copy(update={"seed": seed})
    if not quick:
        return full
    replications, until, latencies, losses = _QUICK
    dynamics, latency, loss = full.axes
    axes = [
        dynamics,
        latency.model_copy(update={"linspace": None, "values": latencies}),
        loss.model_copy(update={"linspace": None, "values": losses}),
    ]
    scenario = {**full.scenario, "until": until}
    return full.model_copy(update={"replications": replications, "axes": axes, "scenario": scenario})


def _table(frame: pd.DataFrame) -> pd.DataFrame:
    """Make means and standard errors of the measures that are shown, in the units of the maps."""
    shown = frame.assign(
        signals=frame["signals"] / frame["until"],
        saturated=100.0 * frame["saturated"] / frame["responses"].clip(lower=1),
        misallocation=100.0 * frame["misallocation"],
        overshoot_mean=100.0 * frame["overshoot_mean"],
    )
    return summarise(shown, [*_AXES, "resource"], list(_PRINTED))


def _critical() -> dict[str, dict[str, float]]:
    """Compute the loss that is survived, by resource of the first draw of the costs and by dynamics."""
    problem = smart_cameras(0)
    dynamics: tuple[Literal["continuous", "discrete"], ...] = ("continuous", "discrete")
    found = {each: theory.critical_loss(theory.needed_rate(problem), each, hold_off=1.0) for each in dynamics}
    return {
        name: {each: float(losses[j]) for each, losses in found.items()}
        for j, name in enumerate(problem.resource_names)
    }


def _wide(table: pd.DataFrame, labels: list[str]) -> pd.DataFrame:
    """Give each measure a column of means, with a row for each point."""
    return table.pivot_table("mean", labels, "measure", observed=True).reset_index()


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """Print the corners and the middle of the maps."""
    ends = [sorted(table[axis].unique()) for axis in ("latency", "loss")]
    picked = [{values[0], values[len(values) // 2], values[-1]} for values in ends]
    rows = table[table["latency"].isin(picked[0]) & table["loss"].isin(picked[1])]
    wide = _wide(rows, [*_AXES, "resource"])
    return pd.DataFrame(
        {
            **{name: [str(value) for value in wide[name]] for name in ("dynamics", "resource")},
            **{name: [f"{value:g}" for value in wide[name]] for name in ("latency", "loss")},
            **{label: [f"{value:.3g}" for value in wide[measure]] for measure, label in _PRINTED.items()},
        }
    )


def _draw(means: pd.DataFrame, critical: Mapping[str, float], resource: str) -> Figure:
    """Draw the maps of one resource, a column for each dynamics with its critical loss.

    Means have a row for each point: dynamics, latency, loss and the measures.
    """
    figure = Figure(figsize=(10.4, 11.4), layout="constrained")
    figure.suptitle(
        f"{resource} of the paper's system; the line is the loss that is survived, by theory",
        fontsize="medium",
    )
    grid = figure.subplots(len(_MAPS), len(critical), sharex=True, sharey=True, squeeze=False)
    for row, shown in zip(grid, _MAPS, strict=True):
        norm = _norm(means[shown.measure].to_numpy(), shown.scale)
        for axes, (dynamics, loss) in zip(row, critical.items(), strict=True):
            mesh = _draw_map(axes, means[means["dynamics"] == dynamics], shown, norm, loss)
            axes.set_title(f"{dynamics}: {shown.title}", loc="left", fontsize="medium")
        bar = figure.colorbar(
            mesh, ax=list(row), pad=0.015, extend="min" if shown.scale == "log" else "neither"
        )
        bar.set_label(shown.label)
        if shown.scale == "around 1":  # the capacity is the middle of the colours, not of the values
            bar.ax.set_ylim(means[shown.measure].min(), means[shown.measure].max())
        if shown.scale == "log":
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    return figure


def _norm(values: FloatArray, scale: str) -> Normalize:
    if scale == "log":
        return LogNorm(_LEAST, max(float(values.max()), 10.0 * _LEAST))
    if scale == "around 1":
        return CenteredNorm(1.0, max(float(np.abs(values - 1.0).max()), 0.1))
    return Normalize(0.0, max(float(values.max()), 1e-9))


def _draw_map(axes: Axes, rows: pd.DataFrame, shown: _Map, norm: Normalize, loss: float) -> QuadMesh:
    """Draw one map, and return what a bar of colours is made from."""
    latencies = np.unique(rows["latency"])
    across = (2.0 * latencies[0] - latencies[1], 2.0 * latencies[-1] - latencies[-2])  # beyond both ends
    plots.heat_map(axes, rows, "latency", "loss", shown.measure, norm=norm, boundary=(across, (loss, loss)))
    axes.set(xlabel="latency (control periods)", ylabel="probability of loss")
    axes.label_outer()
    return next(mesh for mesh in axes.collections if isinstance(mesh, QuadMesh))


def _findings(table: pd.DataFrame) -> list[str]:
    wide = _wide(table, [*_AXES, "resource", "theory"])
    held = wide["loss"] < wide["theory"]
    away = wide["signals"] > _RUN_AWAY
    clear = (wide["loss"] - wide["theory"]).abs() > 0.05  # half a step of the losses
    agree = int((held != away)[clear].sum())
    lossless = wide[wide["loss"] == 0.0]
    early, late = (lossless[lossless["latency"] == end] for end in (0.0, wide["latency"].max()))
    return sentences(f"""
        - The capacity is held where theory says, at any latency, at {agree} of the {int(clear.sum())}
          points that are not within 0.05 of the critical loss
          ({", ".join(f"{name} {_span(wide, name)}" for name in ("continuous", "discrete"))}).
        - Held, mean demand is {_range(wide[held], "utilisation")} of the capacity and the misallocation
          {_range(wide[held], "misallocation")} %; beyond, {_range(wide[~held], "utilisation")} and
          {_range(wide[~held], "misallocation")} %.
        - Without loss, latency {wide["latency"].max():g} lifts the mean excess from
          {_range(early, "overshoot_mean")} to {_range(late, "overshoot_mean")} % of the capacity, and leaves
          {_range(late, "signals")} signals per period for {_range(early, "signals")}.
        - Responses are cut off at probability 1 in {_range(wide[held], "saturated")} % of all where demand is
          held, and in {_range(wide[~held], "saturated")} % beyond.
    """)


def _range(rows: pd.DataFrame, column: str) -> str:
    return f"{rows[column].min():.2f} to {rows[column].max():.2f}"


def _span(rows: pd.DataFrame, dynamics: str) -> str:
    return _range(rows[rows["dynamics"] == dynamics], "theory")


main = command("delay_loss", study, __doc__)

if __name__ == "__main__":
    main()
