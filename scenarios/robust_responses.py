"""What helps against loss and delay: answering more often, a lower threshold, a hold-off that adapts?

Agents that know their loss, or estimate it from running numbers of 5 bits, end up within 2 % of the
optimum, from 9 to 32 % off; numbers of 2 bits do not help. Thresholds from theory keep demand below the
capacity except for about 1 % of the time, at up to 8 points of utilisation. A hold-off that adapts
survives as much loss as a short one, and saves signals under latency, if it is bounded below 1 / rho. One
that may grow beyond saves them by letting demand run away.
"""  # noqa: D400 - a question

from collections.abc import Iterator, Sequence
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
from scenarios.common.measure import distance, late, quietly, run_draws, run_late
from scenarios.common.systems import critical, held, lowered, memory_alone, predicted, rate, spread
from scenarios.common.tables import over_draws, pick, shown, table_of, theory_of

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

# From one point to the next, which are over latency or loss.
_DOTTED: dict[str, Any] = {"linestyle": ":", "linewidth": 0.8}

_NOTHING, _KNOWN = "nothing", "known"
_LABELS = ["panel", "setting", "at", "resource"]
OFF, EARLY, LUCK = "misallocation", "misallocation after a quarter", "distance from theory's optimum"
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


class Drawn(NamedTuple):
    """A run of memory alone, for any draw of the costs; the first fifth is cut off."""

    panel: str
    setting: str
    at: float
    unit: Crossing
    latency: float
    loss: float
    until: float
    safe: float | None = None  # the latency for which the threshold is made, if it is not 1
    resource: str = "memory"


class _Point(NamedTuple):
    """A case of the table, for one of the resources that an answer is measured for."""

    panel: str
    setting: str
    at: float
    resource: str


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run compensation of loss, thresholds below 1, and hold-offs that adapt."""
    draws, long = (2, 500.0) if quick else (10, 20_000.0)
    until, short = (600.0, 300.0) if quick else (12_500.0, 5_000.0)
    run = partial(run_draws, draws=draws, replications=1, seed=seed, quick=quick, runs=runs)
    late_runs = run(measure_late, [*_thresholds(quick, until), *_hold_offs(quick, short)])
    # Where signals no longer suffice, their number as measured says where demand comes to rest.
    signals = {case: float(np.mean([one["bits"] for (one,) in found])) for case, found in late_runs}
    answered = table_of(_by_resource(run(answer, _answers(quick, long))), _LABELS)
    late_table = table_of(late_runs, _LABELS, theory=lambda case, _: _expected(case, signals[case]))
    table = pd.concat([answered, late_table], ignore_index=True)
    wide = table["panel"].str.startswith("loss, ")
    chosen = (table["measure"] == OFF).where(wide, table["measure"] != "threshold")
    settings = {"seed": seed, "draws": draws, "until, losses": long}
    settings |= {"until, thresholds": until, "until, hold-offs": short}
    printed = shown(table[chosen], ["panel", "setting", "at", "resource", "measure"])
    drawn = {"robust_responses": partial(_figure, table)}
    return Finding("robust_responses", settings, table, printed, _findings(table), drawn)


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
                setting = f"{name}, hold-off {hold_off:g}"
                cases.append(Drawn("threshold", setting, latency, unit, latency, 0.0, until, safe))
        for latency, loss in _WRONG:
            setting = f"made for latency {_MADE_FOR:g}, hold-off {hold_off:g}, loss {loss:g}"
            cases.append(Drawn("wrong", setting, latency, unit, latency, loss, until, _MADE_FOR))
    return cases


def _hold_offs(quick: bool, until: float) -> list[Drawn]:
    latencies = (8.0,) if quick else (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0)
    losses = (0.7,) if quick else (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
    return [
        Drawn(panel, name, at, unit, at * (panel == "latency"), at * (panel == "loss"), until)
        for name, unit in _UNITS.items()
        for panel, values in (("latency", latencies), ("loss", losses))
        for at in values
    ]


def measure_late(case: Drawn, draw: int, seed: int) -> dict[str, float]:
    """Run one draw of the costs, with the threshold that theory has for them."""
    threshold = 1.0 if case.safe is None else _safe(draw, case.unit.hold_off, case.safe)
    problem = lowered(memory_alone(draw=draw), threshold)
    channel = BroadcastChannel(latency=case.latency, loss=case.loss)
    span = (0.2 * case.until, case.until)
    seen = late(run_late(problem, case.unit, channel, span, seed, "end"), span[0])
    return {
        "bits": seen.signals,  # as there are no running numbers
        "used": seen.utilisation,
        OFF: float(distance(problem, seen.average)[0]),
        "above": seen.time_above,
        "threshold": threshold,
    }


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


def answer(case: Answer, draw: int, seed: int) -> dict[str, FloatArray]:
    """Run one draw of the costs, and measure each resource, (m,).

    Averages are those of all of the run, and of a quarter of it; saturated responses are counted.
    """
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
    return {
        "bits": signals * (1 + case.number_bits),
        OFF: distance(problem, result.average_at_end),
        EARLY: distance(problem, result.observations.average[0].T),
        LUCK: distance(problem, result.average_at_end, weights),  # from what theory has
        # Responses with a probability above 1.
        "saturated": result.account.saturated.sum(axis=1).astype(np.float64),
        theory_of(OFF): distance(problem, best.allocation),  # without random error
    }


def _weights(case: Answer, signals: float) -> FloatArray:
    """Weigh the costs by what agents believe; on the clock the share of steps with a signal is measured."""
    believed = {_NOTHING: np.zeros(len(_LOSS)), _KNOWN: _LOSS}.get(case.setting)
    if believed is None:
        believed = theory.believed_loss(_LOSS, case.number_bits)
    return theory.loss_weights(_LOSS, signals, believed)


def _by_resource(
    pairs: list[tuple[Answer, list[list[dict[str, FloatArray]]]]],
) -> Iterator[tuple[_Point, list[list[dict[str, float]]]]]:
    """Take what is measured of answers apart, a case for each resource."""
    for case, found in pairs:
        for j, name in enumerate(shared(case.dynamics, 0).resource_names):
            point = _Point(f"loss, {case.dynamics}", case.setting, float(case.number_bits), name)
            yield point, [[{key: float(values[j]) for key, values in seen.items()}] for (seen,) in found]


@lru_cache(maxsize=1024)
def _expected(case: Drawn, signals: float) -> dict[str, float]:
    """Predict what there is a formula for, of draw 0 of the costs; signals are those measured."""
    unit, latency = case.unit, case.latency
    if case.panel == "threshold":
        problem = MEMORY if case.safe is None else lowered(MEMORY, _safe(0, unit.hold_off, case.safe))
        used = float(predicted(problem, hold_off=unit.hold_off, latency=latency).utilisation[0])
        return {"used": used} if case.safe is None else {"used": used, "above": 0.01}
    if case.panel == "wrong":
        return {}
    fixed = unit.longest_hold_off is None
    if fixed and latency > unit.hold_off:
        found = theory.limit_cycle(MEMORY, unit.hold_off, latency)
        off = float(distance(MEMORY, found.allocation)[0])
        return {"bits": float(found.signals[0]), "used": float(found.utilisation[0]), OFF: off}
    if fixed or latency == 0.0:  # without latency nothing makes a hold-off longer
        known = held(MEMORY, hold_off=unit.hold_off, latency=latency, loss=case.loss, repeats=True)
        return {"bits": known[0], "used": known[1]}
    if signals >= 0.5 * rate(MEMORY):
        return {}
    return {"used": held(MEMORY, hold_off=1.0 / signals, latency=latency, repeats=True).utilisation}


def _figure(table: pd.DataFrame) -> Figure:
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
            limit = critical(MEMORY, _UNITS[name].hold_off)
            axes.axvline(limit, color=colour(_PLACES[name]), linewidth=1.2, linestyle="--")
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
    handles, labels = group[0].get_legend_handles_labels()
    look: dict[str, Any] = {"fontsize": "small", "frameon": False, "handlelength": 2.0, "ncols": 2}
    lowest.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.22), **look)


def _draw_losses(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    ways = list(table.loc[table["panel"].str.startswith("loss, "), "setting"].unique())
    # A colour and mark for each resource; on the clock it is open.
    kinds = [
        ("continuous", "memory", 0, "full"),
        ("continuous", "disk", 1, "full"),
        ("continuous", "bandwidth", 2, "full"),
        ("discrete", "memory", 0, "none"),
    ]
    top, bottom = panels
    for k, (dynamics, resource, place, face) in enumerate(kinds):
        rows = pick(table, panel=f"loss, {dynamics}", resource=resource)
        rows = rows.assign(at=rows["setting"].map(ways.index) + 0.16 * (k - 1.5))
        look: dict[str, Any] = {"linestyle": "none", "fillstyle": face}
        off, bits = pick(rows, measure=OFF), pick(rows, measure="bits")
        figures.points(top, off["at"], off, place, f"{dynamics}, {resource}", scale=100.0, **look)
        top.plot(off["at"], 100 * off["theory"].where(off["theory"] > 0.004), "_k", markersize=12)
        figures.points(bottom, bits["at"], bits, place, **look)
    figures.named(top, "theory", "_", color="black", markersize=12)
    figures.dress(top, y="distance from\nthe optimum (%)", numbers="y", yscale="log")
    x, y = "what agents know of their loss", "bits per unit of time"
    figures.dress(bottom, "", x, y, numbers="y", yscale="log")
    bottom.set_xticks(range(len(ways)), ways)


def _draw_thresholds(panels: Sequence[Axes], table: pd.DataFrame) -> None:
    """Draw a colour and mark for each hold-off; the threshold from theory is open."""
    top, bottom = panels
    for name in table["setting"].unique():
        rows, place = pick(table, setting=name), _PLACES[f"fixed {name.rsplit(maxsplit=1)[-1]}"]
        above, used = pick(rows, measure="above"), pick(rows, measure="used")
        look = {**_DOTTED, "scale": 100.0, "fillstyle": "none" if "safe" in name else "full"}
        figures.points(top, above["at"], above, place, name, **look)
        figures.curve(bottom, used["at"], used, place, **look)
    figures.level(top, 1.0)
    figures.named(top, "1 % of the time, as promised", ":", linewidth=1.0)
    figures.named(top, "theory")
    top.set_yscale("symlog", linthresh=1.0)
    top.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
    figures.dress(top, y="time above\nthe capacity (%)", numbers="", ylim=(0.0, 100.0))
    figures.dress(bottom, "", "latency (control periods)", "mean total demand\n(% of the capacity)")


def _draw_hold_offs(panels: Sequence[Axes], table: pd.DataFrame, what: str) -> None:
    names = (
        ("used", 100.0, "mean total demand\n(% of the capacity)"),
        ("bits", 1.0, "bits per unit of time"),
        (OFF, 100.0, "distance from\nthe optimum (%)"),
    )
    for axes, (measure, scale, label) in zip(panels, names, strict=True):
        for name in table["setting"].unique():
            rows, place = pick(table, setting=name, measure=measure), _PLACES[name]
            # Where curves lie on each other the later, smaller marks leave the earlier ones visible.
            size = {"fixed 0.25": 10.0, f"0.25 to {_LOOSE:g}": 4.5}.get(name, 7.0)
            look = {**_DOTTED, "scale": scale, "markersize": size}
            figures.curve(axes, rows["at"], rows, place, f"hold-off {name}", **look)
        figures.dress(axes, "", what if axes is panels[-1] else "", label)
    figures.level(panels[0], 100.0)
    figures.named(panels[0], "theory")


def _findings(table: pd.DataFrame) -> list[str]:
    answers = table[table["panel"].str.startswith("loss, ")]
    found = [_about_answer(here) for _, here in answers.groupby(["panel", "setting"], sort=False)]
    found += _about_thresholds(table)
    for panel, at in (("latency", (8.0, 16.0)), ("loss", (0.3, 0.7))):
        rows = pick(table[table["at"].isin(at)], panel=panel)
        for (name, value), seen in rows.groupby(["setting", "at"], sort=False):
            found.append(
                f"{panel} {value:g}, hold-off {name}: mean demand {over_draws(seen, measure='used')} "
                f"of the capacity, {over_draws(seen, measure='bits')} bits per unit of time, shares "
                f"{over_draws(seen, 100.0, 1, measure=OFF)} % off."
            )
    limits = " and ".join(f"{critical(MEMORY, hold_off):.2f}" for hold_off in (0.25, 1.0))
    found.append(
        f"1 / rho is {1 / rate(MEMORY):.2f}; hold-offs of 0.25 and 1 survive losses up to {limits} by theory."
    )
    return found


def _about_answer(here: pd.DataFrame) -> str:
    off = pick(here, measure=OFF)
    panel, way = off.iloc[0][["panel", "setting"]]
    names, known = off["resource"], ", ".join(f"{100 * value:.1f}" for value in off["theory"])

    def say(measure: str, scale: float) -> str:
        return ", ".join(over_draws(here, scale, 1, measure=measure, resource=name) for name in names)

    return (
        f"{panel} 0 to 0.5, {way} ({', '.join(names)}): {say(OFF, 100.0)} % off (theory {known}), "
        f"after a quarter of the run {say(EARLY, 100.0)}; {say(LUCK, 100.0)} % from theory's "
        f"optimum; {say('bits', 1.0)} bits per unit of time; responses with a probability above 1: "
        f"{pick(here, measure='saturated')['mean'].sum():g} a run."
    )


def _about_thresholds(table: pd.DataFrame) -> list[str]:
    rows, wrong = pick(table, panel="threshold"), pick(table, panel="wrong", measure="above")
    plain, careful = (rows[rows["setting"].str.startswith(name)] for name in ("threshold 1", "safe"))
    above, safely = (pick(part, measure="above") for part in (plain, careful))
    used, less = (pick(part, measure="used") for part in (plain, careful))
    cost = used["mean"].to_numpy() - less["mean"].to_numpy()
    gap = max((part["mean"] - part["theory"]).abs().max() for part in (used, less))
    errors = [
        f"{over_draws(wrong, 100.0, 1, setting=setting, at=at)} % at latency {at:g} ({setting})"
        for setting, at in zip(wrong["setting"], wrong["at"], strict=True)
    ]
    return sentences(f"""
        - Threshold 1 leaves demand above capacity for up to {100 * above["mean"].max():.0f} % of the time,
          those from theory for {100 * safely["mean"].min():.2f} to {100 * safely["mean"].max():.2f} %
          (± {100 * safely["spread"].max():.2f} over draws). They cost up to {100 * cost.max():.1f} points of
          utilisation, which theory has to within {100 * gap:.2f} points.
        - A threshold bears little error: demand is above the capacity for {"; ".join(errors)}.
    """)


main = command("robust_responses", study, __doc__)

if __name__ == "__main__":
    main()
