"""Do vehicles charge in time behind one transformer, by one bit that gets lost?

They do: 40 vehicles behind a transformer for 20 houses, with 30 % of the signals lost and latencies of half a
minute, are full 5.4 hours early, and the last of a night 2.5 hours. The capacity that the houses leave is
exceeded for 40 minutes of a night, by up to 1.8 %; without control it is for 278 minutes, by up to 3.5 times.
The threshold of theory, 0.979, prevents it, and takes 11 minutes more. What agents average over hardly
matters: well below the rating, responses do not depend on averages.
"""  # noqa: D400 - a question

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Problem, Recording, Result, theory
from aimd_des.averaging import Cumulative, Forgetting
from aimd_des.interventions import CapacityProfile, Join, leave
from aimd_des.latency import Constant, Exponential
from aimd_des.loss import Bernoulli
from aimd_des.lowlevel import EventKind, FloatArray, ProcessGenerator, System
from aimd_des.plots import colour, shared_legend
from aimd_des.study import mean_and_error, replicate
from models.ev_charging import Vehicles, capacity_left, daily_base_load, ev_charging, vehicle_schedule
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import sensed
from scenarios.common.tables import number, pick, shown, summarise, theory_of, with_theory

_DAY = 1440
_CHARGERS, _HOUSES = (3.7, 7.4), 0.5  # kW in turn, and houses for each vehicle
_HOLD_OFF, _LATENCY, _EXCEEDANCE, _MEMORY = 0.5, 0.5, 0.01, 120.0

#: Probability that a signal is lost on a vehicle, where the channel is lossy.
LOSS = 0.3
#: When totals are kept, and when averages are: from 18:00 to 3:00.
TIMES, LOOKS = np.arange(0.0, _DAY, 5.0), np.arange(360.0, 901.0, 30.0)
#: Parts of its stay for which the progress of a vehicle is kept.
SHARES = np.linspace(0.0, 1.0, 101)
#: When nearly all are here: 22:00 to 1:00.
SPAN = (600.0, 780.0)


class Case(NamedTuple):
    """What is run."""

    # Whether signals are late, and whether they get lost.
    late: bool
    lossy: bool
    forgets: bool = False  # whether averages forget, or are over all of the stay
    lowered: bool = False  # whether the threshold is lowered to the one that theory gives


class Garage:
    """Meters all vehicles by the minute; full or due ones leave, and no charger exceeds its rating.

    Arrivals and departures are whole minutes.
    """

    def __init__(self, vehicles: Vehicles) -> None:
        self.vehicles = vehicles
        self.ratings = np.resize(_CHARGERS, len(vehicles))
        self.energy = np.zeros(len(vehicles))  # in kWh
        self.gone = np.full(len(vehicles), np.nan)  # when each has left
        self.history = np.zeros((_DAY, len(vehicles)))  # the energy at every minute of its stay

    def __call__(self, system: System) -> ProcessGenerator:
        """Look at all vehicles every minute, as a process beside theirs."""
        away, held = system.conditions.away, np.zeros(len(self.vehicles))
        minute = int(self.vehicles.arrival.min())
        while np.isnan(self.gone).any():
            minute += 1
            yield system.env.at(float(minute), EventKind.INTERVENE)
            before, held = held, system.allocations()[0][0]
            self.energy += 0.5 * (before + held) / 60.0
            self.history[minute] = self.energy
            done = (self.energy >= self.vehicles.energy) | (self.vehicles.departure <= minute)
            for i in np.flatnonzero(done & ~away).tolist():
                leave(system, i)
                self.gone[i] = minute
            for i in np.flatnonzero((held > self.ratings) & ~away).tolist():
                system.set_demand(i, 0, float(self.ratings[i]))
            held = np.where(away, 0.0, np.minimum(held, self.ratings))


class Night(NamedTuple):
    """What is measured of one night."""

    numbers: dict[str, float]  # and what theory has for some of them
    error: FloatArray  # distance of the averages from the optimum in force, at `LOOKS`
    # (4, 288): At `TIMES`: total demand, what it would be without control, the capacity, all in kW;
    # vehicles present.
    lines: FloatArray
    progress: FloatArray  # (101, n): share of its need that each vehicle has, at `SHARES` of its stay


def night(case: Case, n: int, step: int, seed: int) -> Night:
    """Run a night from noon to noon: n vehicles, and so many minutes between two changes of the capacity."""
    result, garage = run(case, n, step, seed)
    vehicles, pieces = garage.vehicles, result.pieces
    place = np.searchsorted(pieces["start"], TIMES, side="right") - 1
    at_once = vehicles.arrival + 60.0 * vehicles.energy / garage.ratings
    plugged = (TIMES[:, None] >= vehicles.arrival) & (TIMES[:, None] < at_once)
    error = result.tracking["relative_error"].to_numpy()[: len(LOOKS)]
    capacity, present = (pieces[name].to_numpy()[place] for name in ("capacity", "agents"))
    total = result.observations.total_demand[: len(TIMES), 0]
    stay = SHARES[:, None] * (vehicles.departure - vehicles.arrival)
    minutes = np.minimum(np.round(vehicles.arrival + stay), garage.gone).astype(np.int64)
    progress = garage.history[minutes, np.arange(len(vehicles))] / vehicles.energy
    lines = np.stack([total, plugged @ garage.ratings, capacity, present])
    known = {theory_of(name): value for name, value in _expected(case, result, vehicles).items()}
    return Night({**_measured(result, garage, error), **known}, error, lines, progress)


def run(case: Case, n: int, step: int, seed: int) -> tuple[Result, Garage]:
    """Run a night as `night` does, for its result and the garage as it is in the end."""
    drawn = vehicle_schedule(seed, n)
    vehicles = replace(drawn, arrival=np.round(drawn.arrival), departure=np.round(drawn.departure))
    problem = ev_charging(seed, n, _CHARGERS, _HOUSES, probability=0.5)
    if case.lowered:
        setting = {"latency": _LATENCY, "hold_off": _HOLD_OFF, "exceedance": _EXCEEDANCE}
        gamma = theory.safe_threshold(problem, "continuous", loss=LOSS, **setting)
        problem = Problem([replace(problem.resources[0], threshold=float(gamma[0]))], problem.costs)
    latency = Exponential(_LATENCY) if case.late else Constant(0.0)
    minutes, base_load = daily_base_load(step)
    garage = Garage(vehicles)
    result = sensed(
        problem,
        _HOLD_OFF,
        channel=BroadcastChannel(latency, Bernoulli(LOSS if case.lossy else 0.0)),
        averaging=Forgetting(_MEMORY) if case.forgets else Cumulative(),
        interventions=[
            CapacityProfile("power", minutes, capacity_left(base_load, n * _HOUSES)),
            *(Join(i, at) for i, at in enumerate(vehicles.arrival.tolist())),
        ],
        seed=seed,
        recording=Recording(demand=TIMES, allocations=LOOKS),
        processes=[garage],
    ).run(_DAY)
    return result, garage


def _measured(result: Result, garage: Garage, error: FloatArray) -> dict[str, float]:
    vehicles, pieces, sent = garage.vehicles, result.pieces, result.signals_sent.time
    lasted, spare = _lasted(result), vehicles.departure - garage.gone
    missing = np.maximum(vehicles.energy - garage.energy, 0.0)
    return {
        _ABOVE: float((pieces["overshoot_time"] * (pieces["end"] - pieces["start"])).sum()),
        "peak": float(pieces["overshoot_peak"].max()),
        _SIGNALS: float(((sent >= SPAN[0]) & (sent < SPAN[1])).sum()),
        _USED: float(pieces["utilisation"].to_numpy() @ lasted / lasted.sum()),
        "energy missing": float(missing.sum() / vehicles.energy.sum()),
        _SPARE: float(spare.mean() / 60.0),
        "least hours to spare": float(spare.min() / 60.0),
        _ERROR: float(error[(SPAN[0] <= LOOKS) & (SPAN[1] >= LOOKS)].mean()),
        "threshold": float(result.problem.threshold[0]),
    }


def _lasted(result: Result) -> FloatArray:
    """Return for how long each piece lasted within the span."""
    pieces = result.pieces
    return np.asarray(np.clip(pieces["end"], *SPAN) - np.clip(pieces["start"], *SPAN), dtype=np.float64)


def _expected(case: Case, result: Result, vehicles: Vehicles) -> dict[str, float]:
    """Predict signals, piece by piece, and the random error of averages at the middle of their time."""
    pieces, problem, loss = result.pieces, result.problem, LOSS if case.lossy else 0.0
    middle = 0.5 * sum(SPAN)
    alpha, beta, gamma = problem.increase[0, 0], problem.decrease[0, 0], problem.normalization[0]
    lasted = _lasted(result)
    rates = theory.signal_rate(alpha, beta, gamma, pieces["multiplier"].to_numpy()[lasted > 0.0], loss)
    piece = result.piece_at(middle)
    best = result.optimum_of(piece)
    assert best is not None  # noqa: S101 - vehicles are there at midnight
    held = best.allocation[:, 0]
    age = float(middle - vehicles.arrival[piece.present].mean())
    memory = {"time_constant": _MEMORY} if case.forgets else {"window": age}
    chance = (1.0 - loss) * gamma * best.multipliers[0] / held
    spread = theory.averaging_spread(held, alpha, beta, probability=chance, **memory)
    # The expected absolute value of a normal number is the root of 2 / pi of its standard deviation.
    luck = float(np.sqrt(2.0 / np.pi) * (held @ spread) / held.sum())
    found = {_SIGNALS: float(rates @ lasted[lasted > 0.0]), _ERROR: luck}
    if case.lowered:
        found[_ABOVE] = _EXCEEDANCE * float(np.ptp(result.signals_sent.time))
    return found


_PERFECT, _LOSSY, _LOWERED = "perfect", "late and lossy", "late and lossy, lower threshold"
_LATE_ALONE, _LOST_ALONE = "late alone", "lossy alone"
_STAY, _FORGET, _NOBODY = "all of the stay", "forgetting", "uncontrolled"
_CASES = {
    (_PERFECT, _STAY): Case(late=False, lossy=False),
    (_LOSSY, _STAY): Case(late=True, lossy=True),
    (_LOSSY, _FORGET): Case(late=True, lossy=True, forgets=True),
    (_LOWERED, _STAY): Case(late=True, lossy=True, lowered=True),
    (_LATE_ALONE, _STAY): Case(late=True, lossy=False),
    (_LOST_ALONE, _STAY): Case(late=False, lossy=True),
}
_BAD, _OTHER, _LOW = "lossy minus perfect", "forgetting minus all of the stay", "lower threshold minus not"
_LATER, _FEWER = "late alone minus perfect", "lossy alone minus perfect"
_PAIRS = {
    _BAD: ((_LOSSY, _STAY), (_PERFECT, _STAY)),
    _OTHER: ((_LOSSY, _FORGET), (_LOSSY, _STAY)),
    _LOW: ((_LOWERED, _STAY), (_LOSSY, _STAY)),
    _LATER: ((_LATE_ALONE, _STAY), (_PERFECT, _STAY)),
    _FEWER: ((_LOST_ALONE, _STAY), (_PERFECT, _STAY)),
}
_ABOVE, _SIGNALS, _SPARE = "minutes above capacity", "signals, 22:00 to 1:00", "hours to spare"
_ERROR, _USED = "error of averages", "used, 22:00 to 1:00"


_Nights = dict[tuple[str, str], list[Night]]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run nights with a perfect channel, a bad one, averages that forget, and a lower threshold."""
    replications, n, step = (2, 6, 240) if quick else (12, 40, 15)
    jobs = [partial(night, case, n, step) for case in _CASES.values()]
    found = replicate(jobs, replications, seed, workers=1 if quick else None, out=runs)
    nights = dict(zip(_CASES, found, strict=True))
    table = _table(nights)
    settings = {"seed": seed, "replications": replications, "vehicles": n}
    printed = shown(table, ["channel", "average", "measure"], ".3f")
    drawn = {"ev_day": partial(_figure, table, nights)}
    return Finding("ev_day", settings, table, printed, _findings(table), drawn)


def _table(nights: _Nights) -> pd.DataFrame:
    """Sum up the nights, what would be without control, and paired differences."""
    rows = [(case, run.numbers) for case, found in nights.items() for run in found]
    for _, uncontrolled, capacity, _ in (run.lines for run in nights[_PERFECT, _STAY]):
        above, peak = 5.0 * float((uncontrolled > capacity).sum()), float((uncontrolled / capacity).max())
        rows.append(((_NOBODY, ""), {_ABOVE: above, "peak": peak}))
    for name, (one, other) in _PAIRS.items():
        for left, right in zip(nights[one], nights[other], strict=True):
            gaps = {key: left.numbers[key] - right.numbers[key] for key in (_SIGNALS, _SPARE)}
            rows.append(((name, ""), gaps))
    keys = ["channel", "average"]
    labelled = [dict(zip(keys, case, strict=True)) | numbers for case, numbers in rows]
    return with_theory(summarise(labelled, keys), keys)


def _figure(table: pd.DataFrame, nights: _Nights) -> Figure:
    figure = Figure(figsize=(13.0, 5.4), layout="constrained")
    axes = figure.subplot_mosaic("abc;abc;abd;ebd", width_ratios=[1.2, 0.9, 1.1])
    first = nights[_LOSSY, _STAY][0]
    _draw_day(axes["a"], axes["e"], first.lines)
    _draw_progress(axes["b"], first.progress)
    _draw_error(axes["c"], table, nights)
    _draw_above(axes["d"], table)
    shared_legend(figure)
    return figure


def _clock(axes: Axes, title: str, label: str, low: int, high: int, every: int) -> None:
    ticks = range(low, high + 1, every)
    figures.dress(axes, title, "time of day", label, numbers="y", xlim=(low, high), ylim=(0.0, None))
    axes.set_xticks(ticks, [f"{(12 + tick // 60) % 24}:00" for tick in ticks])


def _draw_day(power: Axes, present: Axes, lines: FloatArray) -> None:
    total, uncontrolled, capacity, here = lines
    power.fill_between(TIMES, uncontrolled, color="0.86", label="charging if no vehicle held back")
    power.plot(TIMES, total, color=colour(0), linewidth=1.3, label="charging")
    power.plot(TIMES, capacity, color=colour(1), linewidth=1.8, label="capacity left by the houses")
    present.plot(TIMES, here, color=figures.REFERENCE, drawstyle="steps-post")
    _clock(power, "(a) A night: what the houses leave is used", "power (kW)", 120, 1320, 240)
    _clock(present, "", "vehicles", 120, 1320, 240)
    present.set_yticks([0, int(here.max())])
    power.set_xlabel("")
    power.tick_params(labelbottom=False)


def _draw_progress(axes: Axes, progress: FloatArray) -> None:
    axes.plot(100 * SHARES, 100 * progress, color=colour(0), linewidth=0.6, alpha=0.7)
    figures.named(axes, "one vehicle", color=colour(0), linewidth=0.8, alpha=0.7)
    axes.plot([0, 100], [0, 100], "--", color=figures.REFERENCE, linewidth=1.4, label="just in time")
    x, y = "part of the stay that is over (%)", "energy delivered (% of the need)"
    title = "(b) All are full before they leave"
    figures.dress(axes, title, x, y, numbers="", xlim=(0, 100), ylim=(0, 103))


def _draw_error(axes: Axes, table: pd.DataFrame, nights: _Nights) -> None:
    names = {_STAY: "average over all of the stay", _FORGET: "average that forgets in 2 hours"}
    for place, (average, name) in enumerate(names.items()):
        mean, error = mean_and_error([100 * run.error for run in nights[_LOSSY, average]])
        look: dict[str, Any] = {"color": colour(place + 2), "marker": "os"[place], "markersize": 4.0}
        axes.errorbar(LOOKS, mean, 2 * error, label=name, **look)
        luck = 100 * number(table, "theory", channel=_LOSSY, average=average, measure=_ERROR)
        axes.plot(SPAN, [luck, luck], ":", color=figures.REFERENCE, linewidth=1.8)
    figures.named(axes, "random error alone, by theory", ":", linewidth=1.8)
    title = "(c) Averages are off by random error, and late"
    _clock(axes, title, "distance of averages\nfrom the optimum (%)", 360, 900, 120)


def _draw_above(axes: Axes, table: pd.DataFrame) -> None:
    names = (_NOBODY, _PERFECT, _LOSSY, _LOWERED)
    for place, name in enumerate(names):
        above = pick(table, channel=name, measure=_ABOVE).iloc[0]
        minutes, peak = above["mean"], number(table, channel=name, measure="peak")
        fill = "0.86" if name == _NOBODY else colour(0)
        axes.barh(-place, minutes, 0.4, xerr=2 * above["standard_error"], color=fill, capsize=2.0)
        words = f"{name}: {minutes:.0f} min, up to {peak:.2f} of capacity"
        axes.text(2.0, 0.28 - place, words, va="bottom", fontsize="small")
    axes.set_yticks([])
    how: dict[str, Any] = {"numbers": "x", "xlim": (0.0, None), "ylim": (-3.4, 0.8)}
    figures.dress(axes, "(d) Overload of the transformer in a night", "minutes above the capacity", **how)


def _findings(table: pd.DataFrame) -> list[str]:
    def mean(channel: str, measure: str, column: str = "mean", **average: str) -> float:
        """Look up a number, of the average over all of the stay unless it is said."""
        return number(table, column, channel=channel, measure=measure, **average)

    def both(channel: str, measure: str, scale: float = 1.0) -> str:
        error = abs(scale) * mean(channel, measure, "standard_error")
        return f"{scale * mean(channel, measure):.1f} ± {error:.1f}"

    ratio, rate = mean(_LOSSY, _SIGNALS) / mean(_PERFECT, _SIGNALS), 1.0 / (1.0 - LOSS)
    allowed = mean(_LOWERED, _ABOVE, "theory")
    stay, forget = (100 * mean(_LOSSY, _ERROR, average=name) for name in (_STAY, _FORGET))
    luck = [100 * mean(_LOSSY, _ERROR, "theory", average=name) for name in (_STAY, _FORGET)]
    return sentences(f"""
        - {100 * mean(_LOSSY, "energy missing"):.1f} % of the energy needed is missing when vehicles leave.
          They are full {both(_LOSSY, _SPARE)} hours early, the last of a night
          {both(_LOSSY, "least hours to spare")} hours.
        - Where no vehicle holds back the capacity is exceeded for {mean(_NOBODY, _ABOVE):.0f} minutes of
          a night, up to {mean(_NOBODY, "peak"):.1f} times; with one bit, late and lossy, for
          {both(_LOSSY, _ABOVE)} minutes, by up to {100 * mean(_LOSSY, "peak") - 100:.1f} %; with a perfect
          channel for {both(_PERFECT, _ABOVE)}.
        - The bad channel takes {ratio:.2f} times the signals, where 1 / (1 - p) is {rate:.2f}. It leaves
          demand nearer to the capacity, {100 * mean(_LOSSY, _USED):.1f} % of it instead of
          {100 * mean(_PERFECT, _USED):.1f} %, and vehicles are full {both(_BAD, _SPARE, 60.0)} minutes
          earlier: {both(_LATER, _SPARE, 60.0)} by latency alone, {both(_FEWER, _SPARE, 60.0)} by loss alone.
        - With the threshold that theory gives, {mean(_LOWERED, "threshold"):.3f}, the capacity is exceeded
          for {mean(_LOWERED, _ABOVE):.2f} minutes, of {allowed:.1f} allowed, and vehicles are full
          {both(_LOW, _SPARE, -60.0)} minutes later.
        - With averages that forget, vehicles are full {both(_OTHER, _SPARE, 60.0)} minutes earlier. These
          averages are {forget:.1f} % from the optimum in force around midnight, and {stay:.1f} % over all of
          the stay; random error alone is {luck[1]:.1f} and {luck[0]:.1f} %.
    """)


main = command("ev_day", study, __doc__)

if __name__ == "__main__":
    main()
