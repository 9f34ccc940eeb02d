"""The study: what is run, and what is made of it."""

import dataclasses
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Crossing, Fleet, Problem, Recording, Sampled, Simulation, theory
from aimd_des.compensation import EstimatedLoss, KnownLoss
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from aimd_des.study import jackknife
from models.smart_cameras import smart_cameras
from scenarios.common import figures
from scenarios.common.command import Finding, command
from scenarios.common.measure import distance, quietly, run_all
from scenarios.common.systems import critical, held, memory_alone, rate, spread
from scenarios.common.tables import estimate, number, pick, shown, summarise

MEMORY = memory_alone()
# A Gamma so small that no response saturates, however much an agent makes good for.
_GENTLE = 1 / 360
_LOSS = spread(0.0, 0.5)
_SHARED = {"continuous": smart_cameras(0, normalization=_GENTLE), "discrete": memory_alone(60, _GENTLE)}
_LOOSE = 8.0
_TIGHT = 1.25  # below 1 / rho
_UNITS = {
    "fixed 0.25": Crossing(0.25),
    "fixed 1": Crossing(1.0),
    f"0.25 to {_TIGHT:g}": Crossing(0.25, longest_hold_off=_TIGHT),
    f"0.25 to {_LOOSE:g}": Crossing(0.25, longest_hold_off=_LOOSE),
}
_MEASURES = {"signals": "signals", "bits": "bits", "used": "utilisation", "above": "overshoot_time"}


class _Case(NamedTuple):
    labels: dict[str, Any]
    problem: Problem
    until: float
    parts: dict[str, Any]


class _Threshold(NamedTuple):
    value: float
    used_plain: float
    used_safe: float


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run compensation of loss, thresholds below 1, and hold-offs that adapt."""
    replications, long, short = (2, 500.0, 200.0) if quick else (4, 20_000.0, 5000.0)
    waits = [
        (hold_off, latency) for hold_off in ((0.5,) if quick else (0.5, 1.0)) for latency in _delays(quick)
    ]
    safe = {wait: found for wait, (found,) in run_all(_threshold, waits, 1, seed, quick, runs)}
    cases = [*_answers(quick, long), *_thresholds(safe, short), *_hold_offs(quick, short)]
    table = _table(run_all(_measure, cases, replications, seed, quick, runs))
    table["theory"] = [_expected(row, table, safe) for row in table.to_dict("records")]
    wide = table["panel"].str.startswith("loss, ")
    chosen = table["measure"].str.startswith("misallocation").where(wide, table["measure"] != "signals")
    limits = {name: critical(MEMORY, unit.hold_off) for name, unit in _UNITS.items()}
    settings = {"seed": seed, "replications": replications, "until, losses": long, "until, delays": short}
    printed = shown(table[chosen], ["panel", "setting", "at", "resource", "measure"])
    drawn = {"robust_responses": partial(_figure, table, limits)}
    return Finding("robust_responses", settings, table, printed, _findings(table), drawn)


def _delays(quick: bool) -> tuple[float, ...]:
    return (0.25,) if quick else (0.0, 0.25, 0.5, 1.0, 1.5, 2.0)


def _labels(panel: str, setting: str, at: float, threshold: float = 1.0) -> dict[str, Any]:
    return {"panel": panel, "setting": setting, "at": at, "threshold": threshold}


def _answers(quick: bool, until: float) -> list[_Case]:
    """Set up losses that differ: agents that do nothing, know, or estimate with so many bits (`at`)."""
    ways: dict[str, Any] = {"nothing": None, "known": KnownLoss(_LOSS)}
    ways |= {f"{bits} bits": EstimatedLoss(bits) for bits in ((3, 8) if quick else (2, 3, 4, 5, 8))}
    cases = []
    for dynamics, problem in _SHARED.items():
        clock = dynamics == "discrete"
        parts = {
            "dynamics": dynamics,
            "control_unit": Sampled() if clock else Crossing(0.1),
            "channel": BroadcastChannel(latency=float(clock), loss=_LOSS),
        }
        for name, way in ways.items():
            labels = _labels(f"loss, {dynamics}", name, 0.0 if way is None else float(way.bits))
            cases.append(_Case(labels, problem, until, {**parts, "compensation": way}))
    return cases


def _thresholds(safe: dict[tuple[float, float], _Threshold], until: float) -> list[_Case]:
    cases = []
    for (hold_off, latency), found in safe.items():
        for name, threshold in (("threshold 1", 1.0), ("safe threshold", found.value)):
            labels = _labels("threshold", f"{name}, hold-off {hold_off:g}", latency, threshold)
            cases.append(_Case(labels, _lowered(threshold), until, _continuous(Crossing(hold_off), latency)))
    return cases


def _hold_offs(quick: bool, until: float) -> list[_Case]:
    latencies = (8.0,) if quick else (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0)
    losses = (0.7,) if quick else (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
    cases = []
    for name, unit in _UNITS.items():
        for latency in latencies:
            labels = _labels("latency", name, latency)
            cases.append(_Case(labels, MEMORY, until, _continuous(unit, latency)))
        for loss in losses:
            labels = _labels("loss", name, loss)
            cases.append(_Case(labels, MEMORY, until, _continuous(unit, 0.0, loss)))
    return cases


def _continuous(unit: Crossing, latency: float, loss: float = 0.0) -> dict[str, Any]:
    channel = BroadcastChannel(latency=latency, loss=loss)
    return {"dynamics": "continuous", "control_unit": unit, "channel": channel}


def _lowered(threshold: float) -> Problem:
    memory = dataclasses.replace(MEMORY.resources[0], threshold=threshold)
    return Problem([memory], MEMORY.costs, agent_names=MEMORY.agent_names)


def _measure(case: _Case, seed: int) -> tuple[dict[Any, dict[Any, Any]], FloatArray]:
    """Run; responses with a probability above 1 are counted in the summary instead of warned of."""
    simulation = Simulation(
        case.problem, agents=Fleet, seed=seed, recording=Recording(demand=[case.until]), **case.parts
    )
    result = quietly(simulation, case.until)
    return result.summary().to_dict("index"), result.average_at_end


def _table(pairs: list[tuple[_Case, list[Any]]]) -> pd.DataFrame:
    rows, pooled = [], []
    for case, runs in pairs:
        compensated = case.labels["panel"] in ("loss, continuous", "loss, discrete")
        for summary, _ in runs:
            for name, seen in summary.items():
                numbers = {measure: float(seen[column]) for measure, column in _MEASURES.items()}
                for measure in ("signals", "bits"):
                    numbers[measure] /= case.until
                if compensated:
                    numbers |= {"misallocation": seen["misallocation"], "saturated": float(seen["saturated"])}
                rows.append({**case.labels, "resource": name, **numbers})
        if compensated:
            values, errors = jackknife([average for _, average in runs], partial(distance, case.problem))
            names = case.problem.resource_names
            for name, *found in zip(names, values, errors, strict=True):
                labels = {**case.labels, "resource": name}
                pooled.append(estimate(labels, "misallocation of the mean", (found[0], found[1]), len(runs)))
    single = summarise(rows, ["panel", "setting", "at", "threshold", "resource"]).dropna(subset="mean")
    return pd.concat([single, pd.DataFrame(pooled)], ignore_index=True)


def _threshold(wait: tuple[float, float], _seed: int) -> _Threshold:
    given: dict[str, Any] = dict(zip(("hold_off", "latency"), wait, strict=True))
    safe = float(theory.safe_threshold(MEMORY, "continuous", **given)[0])
    used = [float(theory.predict(_lowered(t), "continuous", **given).utilisation[0]) for t in (1.0, safe)]
    return _Threshold(safe, *used)


def _compensated(row: dict[Any, Any], signals: float) -> float:
    """Predict the misallocation that is left; on the clock the share of steps with a signal is measured."""
    dynamics = row["panel"].removeprefix("loss, ")
    problem = _SHARED[dynamics]
    believed = {"nothing": np.zeros(len(_LOSS)), "known": _LOSS}.get(row["setting"])
    if believed is None:
        believed = theory.believed_loss(_LOSS, int(row["at"]))
    weights = theory.loss_weights(_LOSS, signals if dynamics == "discrete" else 0.0, believed)
    best = theory.reweighted_optimum(problem, weights, capacity=problem.capacity)
    return float(distance(problem, best.allocation)[problem.resource_names.index(row["resource"])])


def _expected(row: dict[Any, Any], table: pd.DataFrame, safe: dict[tuple[float, float], _Threshold]) -> float:
    """Predict one number of the table; NaN where there is no formula."""
    panel, setting, at, measure = row["panel"], row["setting"], row["at"], row["measure"]
    signals = number(table, panel=panel, setting=setting, at=at, measure="signals")
    if panel.startswith("loss, "):
        return _compensated(row, signals) if measure == "misallocation of the mean" else np.nan
    if panel == "threshold":
        found = safe[float(setting.split()[-1]), at]
        aim = {"used": found.used_safe, "above": 0.01} if "safe" in setting else {"used": found.used_plain}
        return aim.get(measure, np.nan)
    if measure not in ("bits", "used"):
        return np.nan
    unit, latency, loss = _UNITS[setting], at * (panel == "latency"), at * (panel == "loss")
    if unit.longest_hold_off is None or latency == 0.0:  # without latency nothing makes a hold-off longer
        known = held(MEMORY, hold_off=unit.hold_off, latency=latency, loss=loss, repeats=True)
        return known[int(measure == "used")]
    # Where signals no longer suffice, their number as measured says where demand comes to rest.
    if measure != "used" or signals >= 0.5 * rate(MEMORY):
        return np.nan
    return held(MEMORY, hold_off=1.0 / signals, latency=latency, repeats=True).utilisation


def _figure(table: pd.DataFrame, critical: Mapping[str, float]) -> Figure:
    """Draw compensation of loss, thresholds, and hold-offs with their critical losses, in four columns."""
    figure = Figure(figsize=(13.0, 7.4), layout="constrained")
    panels = figure.subplots(2, 4, sharex="col")
    _draw_losses(panels[:, 0], table)
    _draw_thresholds(panels[:, 1], table[table["panel"] == "threshold"])
    _draw_hold_offs(panels[:, 2], table[table["panel"] == "latency"], "latency (control periods)")
    _draw_hold_offs(panels[:, 3], table[table["panel"] == "loss"], "probability of loss, the same for all")
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


def _draw_losses(panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame) -> None:
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


def _draw_thresholds(panels: "np.ndarray[tuple[int], np.dtype[np.object_]]", table: pd.DataFrame) -> None:
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


def _draw_hold_offs(
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


def _pick(table: pd.DataFrame, panel: str, setting: str, measure: str) -> pd.DataFrame:
    return table[
        (table["panel"] == panel) & table["setting"].str.startswith(setting) & (table["measure"] == measure)
    ]


def _listed(rows: pd.DataFrame, scale: float = 1.0) -> str:
    return " / ".join(f"{scale * value:.1f}" for value in rows["mean"])


def _span(rows: pd.DataFrame) -> str:
    return f"{rows['mean'].min():.2f} to {rows['mean'].max():.2f}"


def _findings(table: pd.DataFrame) -> list[str]:
    found = []
    for dynamics in ("continuous", "discrete"):
        for way in dict.fromkeys(table.loc[table["panel"] == f"loss, {dynamics}", "setting"]):
            rows = partial(_pick, table, f"loss, {dynamics}", way)
            cut = rows("saturated")["mean"].sum()
            found.append(
                f"{dynamics}, losses 0 to 0.5, {way} ({' / '.join(rows('bits')['resource'])}): a run is "
                f"{_listed(rows('misallocation'), 100)} % off, the mean of the averages "
                f"{_listed(rows('misallocation of the mean'), 100)} %, at {_listed(rows('bits'))} bits per "
                f"unit of time; responses with a probability above 1: {cut:g} a run."
            )
    plain, careful = (_pick(table, "threshold", name, "above") for name in ("threshold 1", "safe threshold"))
    used, less = (_pick(table, "threshold", name, "used") for name in ("threshold 1", "safe threshold"))
    cost = used["mean"].to_numpy() - less["mean"].to_numpy()
    gap = pd.concat([used["mean"] - used["theory"], less["mean"] - less["theory"]]).abs().max()
    found.append(
        f"Threshold 1 leaves demand above capacity for up to {100 * plain['mean'].max():.0f} % of the time, "
        f"those from theory (down to {careful['threshold'].min():.3f}) for "
        f"{100 * careful['mean'].min():.2f} to {100 * careful['mean'].max():.2f} %, and cost up to "
        f"{100 * cost.max():.1f} points of utilisation, which theory has to within {100 * gap:.2f} points."
    )
    for panel in ("latency", "loss"):
        for name in _UNITS:
            rows = partial(_pick, table, panel, name)
            found.append(
                f"{panel} {rows('used')['at'].min():g} to {rows('used')['at'].max():g}, hold-off {name}: "
                f"mean demand {_span(rows('used'))} of the capacity, {_span(rows('bits'))} bits per unit of "
                f"time, above the capacity for {_span(rows('above'))} of the time."
            )
    limits = " and ".join(f"{critical(MEMORY, hold_off):.2f}" for hold_off in (0.25, 1.0))
    found.append(
        f"1 / rho is {1 / rate(MEMORY):.2f}; hold-offs of 0.25 and 1 survive losses up to {limits} by theory."
    )
    return found


main = command(
    "robust_responses",
    study,
    "What helps against loss and delay: answering more, a lower threshold, an adaptive hold-off?",
)
