"""What helps against loss and delay: answering more often, a lower threshold, a hold-off that adapts?

Agents that know their loss, or estimate it from running numbers of 5 bits, end up within 2 % of the
optimum, from 9 to 32 % off; numbers of 2 bits do not help. Thresholds from theory keep demand below the
capacity except for about 1 % of the time, at up to 8 points of utilisation. A hold-off that adapts
survives as much loss as a short one, and saves signals under latency, if it is bounded below 1 / rho. One
that may grow beyond saves them by letting demand run away.
"""  # noqa: D400 - a question

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Crossing, Fleet, Problem, Recording, Sampled, Simulation, theory
from aimd_des.compensation import Compensation, EstimatedLoss, KnownLoss
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from models.smart_cameras import smart_cameras
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, late, quietly, rows_of, run_draws, run_late
from scenarios.common.systems import critical, held, lowered, memory_alone, rate, spread
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws, with_theory

MEMORY = memory_alone()
# A Gamma so small that no response saturates, however much an agent compensates.
_GENTLE = 1 / 360
_LOSS = spread(0.0, 0.5)
_LOOSE = 8.0
_TIGHT = 1.25  # below 1 / rho
_UNITS = {
    "fixed 0.25": Crossing(0.25),
    "fixed 1": Crossing(1.0),
    f"0.25 to {_TIGHT:g}": Crossing(0.25, longest_hold_off=_TIGHT),
    f"0.25 to {_LOOSE:g}": Crossing(0.25, longest_hold_off=_LOOSE),
}

# Colour and mark of each hold-off, the same in all panels; those of 1 and 2 are disk and bandwidth.
_PLACES = {"fixed 0.5": 0, "fixed 0.25": 3, "fixed 1": 4, f"0.25 to {_TIGHT:g}": 5, f"0.25 to {_LOOSE:g}": 6}

_NOTHING, _KNOWN = "nothing", "known"
_LABELS = ["panel", "setting", "at", "resource"]
_OFF, _EARLY, _LUCK = "misallocation", "misallocation after a quarter", "distance from theory's optimum"
_PARTS = {"bits": "bits", _OFF: "misallocation", _EARLY: "early", _LUCK: "luck", "saturated": "saturated"}
_PARTS["theory of misallocation"] = "predicted"

# For what a threshold is made, and what comes instead: latency and loss.
_MADE_FOR, _WRONG = 1.0, ((1.1, 0.0), (1.2, 0.0), (1.0, 0.1))


class Answer(NamedTuple):
    """Losses that differ, what agents do about them, and the end: for any draw of the costs."""

    dynamics: Literal["continuous", "discrete"]
    setting: str
    until: float

    @property
    def compensation(self) -> Compensation | None:
        """What agents do."""
        if self.setting == _NOTHING:
            return None
        return KnownLoss(_LOSS) if self.setting == _KNOWN else EstimatedLoss(self.number_bits)

    @property
    def number_bits(self) -> int:
        """How many bits agents estimate their loss with; 0 if they do not."""
        return 0 if self.setting in (_NOTHING, _KNOWN) else int(self.setting.split()[0])


class _Answered(NamedTuple):
    """What is measured of it, (m,): averages are those of all of the run."""

    bits: FloatArray
    misallocation: FloatArray
    early: FloatArray  # misallocation after a quarter of the run
    luck: FloatArray  # distance from what theory has, which is without random error
    predicted: FloatArray  # misallocation without random error
    saturated: FloatArray  # responses with a probability above 1


class Drawn(NamedTuple):
    """A run of memory alone, for any draw of the costs; the first fifth is cut off."""

    labels: dict[str, Any]
    unit: Crossing
    latency: float
    loss: float
    until: float
    safe: float | None = None  # the latency for which the threshold is made, if it is not 1


class _Late(NamedTuple):
    """What is measured of it: bits are signals, as there are no running numbers."""

    bits: float
    used: float
    misallocation: float
    above: float
    threshold: float


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run compensation of loss, thresholds below 1, and hold-offs that adapt."""
    draws, long = (2, 500.0) if quick else (10, 20_000.0)
    until, short = (600.0, 300.0) if quick else (12_500.0, 5_000.0)
    run = partial(run_draws, draws=draws, replications=1, seed=seed, quick=quick, runs=runs)
    late_runs = run(measure_late, [*_thresholds(quick, until), *_hold_offs(quick, short)])
    rows = rows_of(late_runs, lambda case, _, one: {**case.labels, "resource": "memory", **one._asdict()})
    table = summarise_draws(rows, _LABELS)
    table["theory"] = [_expected(row, table) for row in table.to_dict("records")]
    table = pd.concat([_compensated(run(answer, _answers(quick, long))), table], ignore_index=True)
    wide = table["panel"].str.startswith("loss, ")
    chosen = (table["measure"] == _OFF).where(wide, table["measure"] != "threshold")
    limits = {name: critical(MEMORY, unit.hold_off) for name, unit in _UNITS.items()}
    settings = {"seed": seed, "draws": draws, "until, losses": long}
    settings |= {"until, thresholds": until, "until, hold-offs": short}
    printed = shown(table[chosen], ["panel", "setting", "at", "resource", "measure"])
    drawn = {"robust_responses": partial(_figure, table, limits)}
    return Finding("robust_responses", settings, table, printed, _findings(table), drawn)


def _labels(panel: str, setting: str, at: float) -> dict[str, Any]:
    return {"panel": panel, "setting": setting, "at": at}


def _answers(quick: bool, until: float) -> list[Answer]:
    numbers = (f"{bits} bits" for bits in ((3, 8) if quick else (2, 3, 4, 5, 8)))
    ways = [_NOTHING, _KNOWN, *numbers]
    return [Answer(dynamics, way, until) for dynamics in ("continuous", "discrete") for way in ways]


def _thresholds(quick: bool, until: float) -> list[Drawn]:
    cases = []
    for hold_off in (0.5,) if quick else (0.5, 1.0):
        unit = Crossing(hold_off)
        for latency in (0.25, 1.0) if quick else (0.0, 0.25, 0.5, 1.0, 1.5, 2.0):
            for name, safe in (("threshold 1", None), ("safe threshold", latency)):
                labels = _labels("threshold", f"{name}, hold-off {hold_off:g}", latency)
                cases.append(Drawn(labels, unit, latency, 0.0, until, safe))
        for latency, loss in _WRONG:
            setting = f"made for latency {_MADE_FOR:g}, hold-off {hold_off:g}, loss {loss:g}"
            cases.append(Drawn(_labels("wrong", setting, latency), unit, latency, loss, until, _MADE_FOR))
    return cases


def _hold_offs(quick: bool, until: float) -> list[Drawn]:
    latencies = (8.0,) if quick else (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0)
    losses = (0.7,) if quick else (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
    return [
        Drawn(_labels(panel, name, at), unit, at * (panel == "latency"), at * (panel == "loss"), until)
        for name, unit in _UNITS.items()
        for panel, values in (("latency", latencies), ("loss", losses))
        for at in values
    ]


def measure_late(case: Drawn, draw: int, seed: int) -> _Late:
    """Run one draw of the costs, with the threshold that theory has for them."""
    threshold = 1.0
    if case.safe is not None:
        threshold = _safe(draw, case.unit.hold_off, case.safe)
    problem = lowered(memory_alone(draw=draw), threshold)
    channel = BroadcastChannel(latency=case.latency, loss=case.loss)
    span = (0.2 * case.until, case.until)
    seen = late(run_late(problem, case.unit, channel, span, seed, "end"), span[0])
    off = float(distance(problem, seen.average)[0])
    return _Late(seen.signals, seen.utilisation, off, seen.time_above, threshold)


@lru_cache
def _safe(draw: int, hold_off: float, latency: float) -> float:
    problem = memory_alone(draw=draw)
    return float(theory.safe_threshold(problem, "continuous", hold_off=hold_off, latency=latency)[0])


@lru_cache
def shared(dynamics: str, draw: int) -> Problem:
    """Draw the costs of what is shared: the paper's system, or memory alone on the clock."""
    if dynamics == "discrete":
        return memory_alone(60, _GENTLE, draw)
    return smart_cameras(draw, normalization=_GENTLE)


def answer(case: Answer, draw: int, seed: int) -> _Answered:
    """Run one draw of the costs; responses with a probability above 1 are counted instead of warned of."""
    problem, clock = shared(case.dynamics, draw), case.dynamics == "discrete"
    simulation = Simulation(
        problem,
        dynamics=case.dynamics,
        control_unit=Sampled() if clock else Crossing(0.1),
        channel=BroadcastChannel(latency=float(clock), loss=_LOSS),
        compensation=case.compensation,
        agents=Fleet,
        seed=seed,
        recording=Recording(demand="end", allocations=[0.25 * case.until], overshoot=False),
    )
    result = quietly(simulation, case.until)
    signals = result.signals_sent.counts(problem.n_resources) / case.until
    # Of the clock's single resource; that of continuous agents depends on no number of signals.
    weights = _weights(case, float(signals[0]) if clock else 0.0)
    best = theory.reweighted_optimum(problem, weights, capacity=problem.capacity)
    return _Answered(
        bits=signals * (1 + case.number_bits),
        misallocation=distance(problem, result.average_at_end),
        early=distance(problem, result.observations.average[0].T),
        luck=distance(problem, result.average_at_end, weights),
        predicted=distance(problem, best.allocation),
        saturated=result.account.saturated.sum(axis=1).astype(np.float64),
    )


def _weights(case: Answer, signals: float) -> FloatArray:
    """Weigh the costs by what agents believe; on the clock the share of steps with a signal is measured."""
    believed = {_NOTHING: np.zeros(len(_LOSS)), _KNOWN: _LOSS}.get(case.setting)
    if believed is None:
        believed = theory.believed_loss(_LOSS, case.number_bits)
    return theory.loss_weights(_LOSS, signals, believed)


def _compensated(pairs: list[tuple[Answer, list[list[_Answered]]]]) -> pd.DataFrame:
    rows = []
    for case, outcomes in pairs:
        labels = _labels(f"loss, {case.dynamics}", case.setting, float(case.number_bits))
        for draw, (seen,) in enumerate(outcomes):
            for j, name in enumerate(shared(case.dynamics, draw).resource_names):
                values = {measure: float(getattr(seen, part)[j]) for measure, part in _PARTS.items()}
                rows.append({**labels, "resource": name, "draw": draw, **values})
    return with_theory(summarise_draws(rows, _LABELS), _LABELS)


def _expected(row: dict[Any, Any], table: pd.DataFrame) -> float:
    """Predict one number of the table, of draw 0 of the costs; NaN where there is no formula."""
    panel, setting, at, measure = row["panel"], row["setting"], row["at"], row["measure"]
    if panel == "threshold":
        return _of_threshold(setting, at, measure)
    if panel == "wrong" or measure not in ("bits", "used", "misallocation"):
        return np.nan
    return _of_hold_off(table, panel, setting, at, measure)


def _of_threshold(setting: str, at: float, measure: str) -> float:
    safe, hold_off = "safe" in setting, float(setting.rsplit(maxsplit=1)[-1])
    if measure != "used":
        return 0.01 if safe and measure == "above" else np.nan
    problem = lowered(MEMORY, _safe(0, hold_off, at) if safe else 1.0)
    return float(theory.predict(problem, "continuous", hold_off=hold_off, latency=at).utilisation[0])


def _of_hold_off(table: pd.DataFrame, panel: str, setting: str, at: float, measure: str) -> float:
    unit, latency, loss = _UNITS[setting], at * (panel == "latency"), at * (panel == "loss")
    if unit.longest_hold_off is None and latency > unit.hold_off:
        found = theory.limit_cycle(MEMORY, unit.hold_off, latency)
        off = float(distance(MEMORY, found.allocation)[0])
        return {"bits": float(found.signals[0]), "used": float(found.utilisation[0])}.get(measure, off)
    if measure == "misallocation":
        return np.nan
    if unit.longest_hold_off is None or latency == 0.0:  # without latency nothing makes a hold-off longer
        known = held(MEMORY, hold_off=unit.hold_off, latency=latency, loss=loss, repeats=True)
        return known[int(measure == "used")]
    # Where signals no longer suffice, their number as measured says where demand comes to rest.
    signals = number(table, panel=panel, setting=setting, at=at, measure="bits")
    if measure != "used" or signals >= 0.5 * rate(MEMORY):
        return np.nan
    return held(MEMORY, hold_off=1.0 / signals, latency=latency, repeats=True).utilisation


def _figure(table: pd.DataFrame, critical: Mapping[str, float]) -> Figure:
    """Draw four groups of panels, each with its legend below: (a) and (b) above (c) and (d)."""
    figure = Figure(figsize=(11.0, 14.0), layout="constrained")
    grid = figure.subplots(5, 2)
    losses, thresholds, latency, loss = map(list, (grid[:2, 0], grid[:2, 1], grid[2:, 0], grid[2:, 1]))
    _draw_losses(losses, table)
    _draw_thresholds(thresholds, table[table["panel"] == "threshold"])
    _draw_hold_offs(latency, table[table["panel"] == "latency"], "latency (control periods)")
    _draw_hold_offs(loss, table[table["panel"] == "loss"], "probability of loss, the same for all")
    for axes in loss:
        for name in ("fixed 0.25", "fixed 1"):
            axes.axvline(critical[name], color=colour(_PLACES[name]), linewidth=1.2, linestyle="--")
    figures.named(loss[0], "critical loss by theory", "--", linewidth=1.2)
    titles = (
        "(a) Losses from 0 to 0.5: answering more often",
        "(b) Threshold 1 and the one from theory",
        "(c) Hold-offs over latency",
        "(d) Hold-offs over loss",
    )
    for group, title in zip((losses, thresholds, latency, loss), titles, strict=True):
        group[0].set_title(title, loc="left", fontsize="medium")
        _share(group)
    return figure


def _share(group: Sequence[Axes]) -> None:
    """Let panels above each other have one horizontal axis, and one legend under the lowest."""
    *upper, lowest = group
    for axes in upper:
        axes.sharex(lowest)
        axes.tick_params(labelbottom=False)
    for axes in group:
        figures.frame(axes)
    handles, labels = group[0].get_legend_handles_labels()
    look: dict[str, Any] = {"fontsize": "small", "frameon": False, "handlelength": 2.0, "ncols": 2}
    lowest.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.22), **look)


def _draw_losses(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    ways = list(dict.fromkeys(table.loc[table["panel"].str.startswith("loss, "), "setting"]))
    # A colour and mark for each resource; on the clock it is open.
    kinds = [
        ("continuous", "memory", 0),
        ("continuous", "disk", 1),
        ("continuous", "bandwidth", 2),
        ("discrete", "memory", 0),
    ]
    top, bottom = panels
    for k, (dynamics, resource, place) in enumerate(kinds):
        rows = table[(table["panel"] == f"loss, {dynamics}") & (table["resource"] == resource)].copy()
        rows["at"] = rows["setting"].map(ways.index) + 0.16 * (k - 1.5)
        look: dict[str, Any] = {
            "linestyle": "none",
            "fillstyle": "none" if dynamics == "discrete" else "full",
        }
        off = pick(rows, measure=_OFF)
        figures.points(top, off["at"], off, place, f"{dynamics}, {resource}", scale=100.0, **look)
        top.plot(off["at"], 100 * off["theory"].where(off["theory"] > 0.004), "_k", markersize=12)
        bits = pick(rows, measure="bits")
        figures.points(bottom, bits["at"], bits, place, **look)
    figures.named(top, "theory", "_", color="black", markersize=12)
    for axes, label in ((top, "distance from\nthe optimum (%)"), (bottom, "bits per unit of time")):
        axes.set_yscale("log")
        axes.set_ylabel(label)
        figures.number_axis(axes.yaxis)
    bottom.set_xticks(range(len(ways)), ways)
    bottom.set_xlabel("what agents know of their loss")


def _draw_thresholds(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    """Draw a colour and mark for each hold-off; the threshold from theory is open."""
    top, bottom = panels
    for name in dict.fromkeys(table["setting"]):
        rows, place = table[table["setting"] == name], _PLACES[f"fixed {name.rsplit(maxsplit=1)[-1]}"]
        face = "none" if "safe" in name else "full"
        _joined(top, pick(rows, measure="above"), place, name, scale=100.0, fillstyle=face)
        used = pick(rows, measure="used")
        _joined(bottom, used, place, scale=100.0, fillstyle=face)
        figures.theory(bottom, used["at"], used, place, scale=100.0)
    figures.level(top, 1.0)
    figures.named(top, "1 % of the time, as promised", ":", linewidth=1.0)
    figures.named(top, "theory")
    top.set_yscale("symlog", linthresh=1.0)
    top.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
    top.set_ylim(0.0, 100.0)
    top.set_ylabel("time above\nthe capacity (%)")
    bottom.set_ylabel("mean total demand\n(% of the capacity)")
    bottom.set_xlabel("latency (control periods)")
    for axis in (bottom.xaxis, bottom.yaxis):
        figures.number_axis(axis)


def _draw_hold_offs(panels: Sequence[Axes], table: pd.DataFrame, what: str) -> None:
    names = (
        ("used", 100.0, "mean total demand\n(% of the capacity)"),
        ("bits", 1.0, "bits per unit of time"),
        ("misallocation", 100.0, "distance from\nthe optimum (%)"),
    )
    for axes, (measure, scale, label) in zip(panels, names, strict=True):
        for name in dict.fromkeys(table["setting"]):
            rows, place = pick(table, setting=name, measure=measure), _PLACES[name]
            # Where curves lie on each other the later, smaller marks leave the earlier ones visible.
            size = {"fixed 0.25": 10.0, f"0.25 to {_LOOSE:g}": 4.5}.get(name, 7.0)
            _joined(axes, rows, place, f"hold-off {name}", scale=scale, markersize=size)
            figures.theory(axes, rows["at"], rows, place, scale=scale)
        axes.set_ylabel(label)
        figures.number_axis(axes.yaxis)
    figures.level(panels[0], 100.0)
    figures.named(panels[0], "theory")
    figures.number_axis(panels[-1].xaxis)
    panels[-1].set_xlabel(what)


def _joined(axes: Axes, rows: pd.DataFrame, place: int, label: str = "", **look: Any) -> None:
    """Draw means over latency or loss, with a dotted line from one to the next."""
    figures.points(axes, rows["at"], rows, place, label, linestyle=":", linewidth=0.8, **look)


def _pick(table: pd.DataFrame, panel: str, setting: str, measure: str) -> pd.DataFrame:
    return table[
        (table["panel"] == panel) & table["setting"].str.startswith(setting) & (table["measure"] == measure)
    ]


def _findings(table: pd.DataFrame) -> list[str]:
    found = _about_losses(table)
    found += _about_thresholds(table)
    for panel, at in (("latency", (8.0, 16.0)), ("loss", (0.3, 0.7))):
        for name in _UNITS:
            for value in at:
                seen = pick(table, panel=panel, setting=name, at=value)
                if len(seen):
                    found.append(
                        f"{panel} {value:g}, hold-off {name}: mean demand {over_draws(seen, measure='used')} "
                        f"of the capacity, {over_draws(seen, measure='bits')} bits per unit of time, shares "
                        f"{over_draws(seen, 100.0, 1, measure='misallocation')} % off."
                    )
    limits = " and ".join(f"{critical(MEMORY, hold_off):.2f}" for hold_off in (0.25, 1.0))
    found.append(
        f"1 / rho is {1 / rate(MEMORY):.2f}; hold-offs of 0.25 and 1 survive losses up to {limits} by theory."
    )
    return found


def _about_losses(table: pd.DataFrame) -> list[str]:
    found = []
    for panel in ("loss, continuous", "loss, discrete"):
        rows = pick(table, panel=panel)
        for way in rows["setting"].unique():
            here = pick(rows, setting=way)
            names = pick(here, measure=_OFF)["resource"]

            def say(measure: str, scale: float, here: pd.DataFrame = here, names: Any = names) -> str:
                return ", ".join(over_draws(here, scale, 1, measure=measure, resource=name) for name in names)

            known = ", ".join(f"{100 * value:.1f}" for value in pick(here, measure=_OFF)["theory"])
            found.append(
                f"{panel} 0 to 0.5, {way} ({', '.join(names)}): {say(_OFF, 100.0)} % off (theory {known}), "
                f"after a quarter of the run {say(_EARLY, 100.0)}; {say(_LUCK, 100.0)} % from theory's "
                f"optimum; {say('bits', 1.0)} bits per unit of time; responses with a probability above 1: "
                f"{pick(here, measure='saturated')['mean'].sum():g} a run."
            )
    return found


def _about_thresholds(table: pd.DataFrame) -> list[str]:
    plain, careful = (_pick(table, "threshold", name, "above") for name in ("threshold 1", "safe threshold"))
    used, less = (_pick(table, "threshold", name, "used") for name in ("threshold 1", "safe threshold"))
    cost = used["mean"].to_numpy() - less["mean"].to_numpy()
    gap = pd.concat([used["mean"] - used["theory"], less["mean"] - less["theory"]]).abs().max()
    wrong = pick(table, panel="wrong", measure="above")
    errors = [
        f"{over_draws(wrong, 100.0, 1, setting=setting, at=at)} % at latency {at:g} ({setting})"
        for setting, at in zip(wrong["setting"], wrong["at"], strict=True)
    ]
    return sentences(f"""
        - Threshold 1 leaves demand above capacity for up to {100 * plain["mean"].max():.0f} % of the time,
          those from theory for {100 * careful["mean"].min():.2f} to {100 * careful["mean"].max():.2f} %
          (± {100 * careful["spread"].max():.2f} over draws). They cost up to {100 * cost.max():.1f} points of
          utilisation, which theory has to within {100 * gap:.2f} points.
        - A threshold bears little error: demand is above the capacity for {"; ".join(errors)}.
    """)


main = command("robust_responses", study, __doc__)

if __name__ == "__main__":
    main()
