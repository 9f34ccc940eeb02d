"""How far does total demand run away in an outage, when is it back, and which agents pay for it?

No further than n alpha (duration + latency), and, behind a short latency, in the mean half a sawtooth less:
91 % of the capacity after 20 periods in which no agent hears. The way back depends on the hold-off, as each
brings a signal: 2.8 periods with 0.25, 13.7 with 1. No agent gets less then; the resource pays. If only half
of the agents are cut off, the others give way as far as signals let them: demand runs away by 8 % with
hold-off 0.25, and by 35 % with 1. Averages remember, and pay a little back.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Recording, Result, theory
from aimd_des.interventions import CapacityStep, Failover, Intervention, Partition
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import quietly, run_draws, sensed
from scenarios.common.systems import memory_alone, optimum, predicted
from scenarios.common.tables import number, over_draws, pick, shown, table_of

# Growth and capacity are the same in all draws of the costs.
_PROBLEM = memory_alone()
N, CAPACITY = _PROBLEM.n_agents, float(_PROBLEM.capacity[0])
GROWTH = float(_PROBLEM.increase.sum())
# Every other camera: both halves have all kinds of costs.
HALF, OTHER = list(range(0, N, 2)), list(range(1, N, 2))
ALL, FAILOVER, PART = "all agents are cut off", "the control unit fails over", "half are cut off"
FAULTS = (ALL, FAILOVER, PART)
# What is watched before and after the fault, and how often totals and, so many times rarer, agents are kept.
BEFORE, AFTER, GRAIN, COARSE = 10.0, 100.0, 0.125, 8
# A capacity's worth of growth, which is also the time x / alpha in which agents find a new share.
PACE = CAPACITY / GROWTH
# What the figure shows in detail.
_SHOWN_DURATION, _SHOWN_LATENCY, _SHORT, _LONG = 20.0, 0.5, 0.25, 1.0
# A latency beyond both hold-offs: signals are on their way when an outage begins.
_FAR = 5.0
# Over how many of the last periods it is measured how halves end.
_LATE = 30
RUNAWAY, BACK, OVERLOAD, ROOM = "run-away", "time to come back", "overload", "room below the bound"
GAP, EVEN, ODD = "gap left after x / alpha", "extra of the even half", "extra of the odd half"


class Outage(NamedTuple):
    """An outage: which, for how long, behind which latency and with which hold-off, and when it begins."""

    fault: str
    duration: float
    latency: float
    hold_off: float
    at: float

    @property
    def interventions(self) -> list[Intervention]:
        """The fault, and a note of the capacity as it is, from which peaks count anew."""
        note = CapacityStep("memory", self.at, CAPACITY)
        if self.fault == FAILOVER:
            return [note, Failover(self.at, self.duration)]
        agents = HALF if self.fault == PART else None
        return [note, Partition(self.at, self.duration, agents)]

    @property
    def until(self) -> float:
        """The end, when everything has been watched."""
        return self.at + self.duration + AFTER

    @property
    def wait(self) -> float:
        """The longest wait for a signal after the fault: a unit that takes over knows of no hold-off."""
        return 0.0 if self.fault == FAILOVER else self.hold_off

    @property
    def bound(self) -> float:
        """The run-away over the capacity at most."""
        silent = theory.partition_runaway(_PROBLEM, self.duration, self.latency, hold_off=self.wait)
        return float(silent[0]) / CAPACITY


class Found(NamedTuple):
    """What is kept of one run."""

    numbers: dict[str, float]
    total: FloatArray  # (q,): over the capacity
    holdings: FloatArray  # (r, 2): what the even and the odd agents hold over their optimum


def _run(case: Outage, draw: int, seed: int, interventions: list[Intervention]) -> Result:
    looks = np.arange(case.at - BEFORE, case.until, GRAIN)
    simulation = sensed(
        memory_alone(draw=draw),
        case.hold_off,
        channel=BroadcastChannel(latency=case.latency),
        interventions=interventions,
        seed=seed,
        recording=Recording(demand=looks, allocations=looks[::COARSE]),
    )
    return quietly(simulation, case.until)


def measure(settled: Outage, draw: int, seed: int) -> Found:
    """Run with the fault and without it, and measure what differs."""
    # Instants that fall evenly over the cycles from one signal to the next, which start alike.
    case = settled._replace(at=settled.at + GRAIN * round(5.0 * (0.618 * (draw + seed) % 1.0) / GRAIN))
    changes = case.interventions
    result, without = (_run(case, draw, seed, some) for some in (changes, changes[:1]))
    seen, share = result.observations, optimum(memory_alone(draw=draw))
    last, ordinary = (one.pieces.iloc[-1] for one in (result, without))
    total = seen.total_demand[:-1, 0] / CAPACITY
    held = total[round((BEFORE + case.duration) / GRAIN) :] <= 1.0
    runaway = float(last["overshoot_peak"]) - 1.0
    # What each agent got more than without the fault, in periods of its own optimum.
    extra = (result.average_at_end - without.average_at_end)[:, 0] * case.until / share
    demand = seen.demand[:-1, 0]
    sides = [demand[:, agents].sum(axis=1) / share[agents].sum() for agents in (HALF, OTHER)]
    holdings = np.stack(sides, axis=1)
    numbers = {
        RUNAWAY: runaway,
        ROOM: case.bound - runaway,
        BACK: float(GRAIN * (held.argmax() - 0.5)) if held.any() and not held[0] else 0.0,
        # Beyond the ordinary, in periods of all of the capacity.
        OVERLOAD: float(last["overshoot_mean"] - ordinary["overshoot_mean"]) * (case.until - case.at),
        EVEN: float(extra[HALF].mean()),
        ODD: float(extra[OTHER].mean()),
    }
    if case.fault == PART and case.duration >= _SHOWN_DURATION:
        # The part of the gap between the halves that is left a time x / alpha after healing.
        heal, gaps = _healed(case.duration + case.latency), holdings[:, 0] - holdings[:, 1]
        numbers[GAP] = float(gaps[heal + round(PACE)] / gaps[heal])
        for side, name in enumerate(("even", "odd")):
            numbers[f"{name} half at the end"] = float(holdings[-_LATE:, side].mean())
    return Found(numbers, total, holdings)


def _healed(after: float) -> int:
    """Find the record of agents that is so long after the outage began."""
    return round((BEFORE + after) / (GRAIN * COARSE))


@lru_cache
def expected(case: Outage) -> dict[str, float]:
    """Predict what there is a formula for, with the costs of draw 0, from the means alone.

    Signals on their way keep the total at its mean until the latency is over; from then on all agents that
    are cut off grow. Agents that hear are cut at every hold-off while the total is above the capacity.
    """
    ordinary = predicted(_PROBLEM, latency=case.latency, hold_off=case.hold_off)
    cut = (1.0 - _PROBLEM.decrease[:, 0]) * ordinary.probability[:, 0]
    share, alpha = optimum(_PROBLEM), _PROBLEM.increase[:, 0]
    demand = ordinary.utilisation[0] * share * CAPACITY / share.sum()
    hears = np.isin(np.arange(N), OTHER) if case.fault == PART else np.zeros(N, dtype=bool)
    time, peak, heal = 0.0, -np.inf, case.duration + 0.5 * case.wait
    while time < heal:
        step = min(case.hold_off, heal - time)
        demand = demand + alpha * step
        time, peak = time + step, max(peak, float(demand.sum()))
        if demand.sum() > CAPACITY and time < heal:
            demand = np.where(hears, demand * (1.0 - cut), demand)
    # Where it is more, what a latency costs without a fault.
    runaway = max(peak / CAPACITY - 1.0, case.latency / PACE)
    back = case.latency + 0.5 * case.wait if demand.sum() > CAPACITY else np.nan
    demand = demand * (1.0 - cut)
    while demand.sum() > CAPACITY:
        demand = (demand + alpha * case.hold_off) * (1.0 - cut)
        back += case.hold_off
    found = {RUNAWAY: runaway, BACK: back, GAP: float(np.exp(-1.0))}
    fall = 0.5 * runaway * (back - case.latency)
    return found if case.fault == PART else {**found, OVERLOAD: 0.5 * runaway**2 * PACE + fall}


def _cases(quick: bool, settled: float) -> list[Outage]:
    durations = (5.0, _SHOWN_DURATION) if quick else (2.0, 5.0, 10.0, _SHOWN_DURATION, 40.0)
    latencies = (_SHOWN_LATENCY,) if quick else (0.0, _SHOWN_LATENCY, 1.0)
    waits = [(latency, _SHORT, duration) for latency in latencies for duration in durations]
    waits += [(_SHOWN_LATENCY, _LONG, duration) for duration in durations[-2:]]
    waits += [(_FAR, hold_off, _SHOWN_DURATION) for hold_off in (_SHORT, _LONG)]
    return [
        Outage(fault, duration, latency, hold_off, settled)
        for fault in FAULTS
        for latency, hold_off, duration in waits
    ]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Silence memory alone for up to 40 periods, in three ways, behind latencies and with two hold-offs."""
    draws, settled = (2, 60.0) if quick else (16, 200.0)
    pairs = run_draws(measure, _cases(quick, settled), draws, 1, seed, quick, runs)
    labels = ["fault", "latency", "hold_off", "duration"]
    numbers = [(case, [[run.numbers] for (run,) in found]) for case, found in pairs]
    table = table_of(numbers, labels, seed, lambda case, _: expected(case))
    least = [min(run[ROOM] for (run,) in found) for _, found in numbers]
    table.loc[table["measure"] == ROOM, "least"] = least
    shape = (_SHOWN_DURATION, _SHOWN_LATENCY, _SHORT)
    watched = {case.fault: [run for (run,) in found] for case, found in pairs if case[1:4] == shape}
    settings = {"seed": seed, "draws": draws, "settled": settled}
    chosen = table["measure"].isin([RUNAWAY, BACK, OVERLOAD])
    drawn = {"outage": partial(_figure, table, watched)}
    printed = shown(table[chosen], [*labels, "measure"], ".3f")
    return Finding("outage", settings, table, printed, _findings(table), drawn)


def _figure(table: pd.DataFrame, watched: dict[str, list[Found]]) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (13.0, 4.6))
    _draw_totals(left, watched)
    _draw_runaways(middle, pick(table, measure=RUNAWAY, latency=_SHOWN_LATENCY, hold_off=_SHORT))
    _draw_halves(right, watched[PART])
    shared_legend(figure)
    return figure


def _draw_totals(axes: Axes, watched: dict[str, list[Found]]) -> None:
    axes.axvspan(0.0, _SHOWN_DURATION, color="0.93", linewidth=0.0)
    for place, (fault, found) in enumerate(watched.items()):
        total = np.mean([run.total for run in found], axis=0)
        time = GRAIN * np.arange(len(total)) - BEFORE
        style = "--" if fault == FAILOVER else "-"
        axes.plot(time, total, style, color=colour(place), linewidth=1.8, label=fault)
    end = _SHOWN_DURATION + _SHOWN_LATENCY
    ink = figures.REFERENCE
    axes.plot([0.0, end], [1.0, 1.0 + end / PACE], color=ink, linewidth=1.2, linestyle=":")
    line = {"arrowstyle": "-"}
    axes.annotate("bound", (12.0, 1.0 + 12.0 / PACE), (2.0, 1.75), color=ink, arrowprops=line)
    low = axes.get_xaxis_transform()
    axes.text(0.5 * _SHOWN_DURATION, 0.03, "outage", ha="center", color=ink, transform=low)
    x, y = "time since the outage began (periods)", "total demand over capacity"
    figures.dress(axes, "(a) Total demand rises in the outage and falls at once", x, y, xlim=(-BEFORE, 50.0))


def _draw_runaways(axes: Axes, table: pd.DataFrame) -> None:
    for place, fault in enumerate(FAULTS):
        rows, size = pick(table, fault=fault), 8.0 - 2.0 * (place == 1)
        figures.curve(axes, rows["duration"], rows, place, scale=100.0, markersize=size)
    ends = np.array([0.0, 41.0])
    bound = 100 * (ends + _SHOWN_LATENCY) / PACE
    words = "bound n alpha (duration + latency)"
    axes.plot(ends, bound, ":", color=figures.REFERENCE, linewidth=1.2, label=words)
    figures.named(axes, "theory of the means")
    x, y = "duration of the outage (periods)", "run-away (% of the capacity)"
    figures.dress(axes, "(b) Run-away, half a sawtooth below its bound", x, y)


def _draw_halves(axes: Axes, found: list[Found]) -> None:
    holdings = np.mean([run.holdings for run in found], axis=0)
    time = GRAIN * COARSE * np.arange(len(holdings)) - BEFORE
    axes.axvspan(0.0, _SHOWN_DURATION, color="0.93", linewidth=0.0)
    for side, (name, place) in enumerate((("the half that is cut off", 3), ("the half that hears", 4))):
        axes.plot(time, holdings[:, side], color=colour(place), linewidth=1.8, label=name)
    heal = _healed(_SHOWN_DURATION + _SHOWN_LATENCY + 1.0)
    middle, since = holdings[-40:].mean(), time[heal:] - time[heal]
    gap = 0.5 * (holdings[heal, 0] - holdings[heal, 1]) * np.exp(-since / PACE)
    for sign in (1.0, -1.0):
        axes.plot(time[heal:], middle + sign * gap, color=figures.REFERENCE, linewidth=1.0, linestyle="--")
    figures.named(axes, "gap that closes at rate alpha / x", "--", linewidth=1.0)
    x, y = "time since the outage began (periods)", "demand over that at the optimum"
    limits: dict[str, Any] = {"xlim": (-BEFORE, _SHOWN_DURATION + AFTER), "ylim": (0.0, None)}
    figures.dress(axes, "(c) Half are cut off: the others hold less", x, y, **limits)


def _findings(table: pd.DataFrame) -> list[str]:
    usual: dict[str, Any] = {"latency": _SHOWN_LATENCY, "hold_off": _SHORT, "duration": _SHOWN_DURATION}

    def say(fault: str, what: str, scale: float = 1.0, digits: int = 1, **other: float) -> str:
        return over_draws(table, scale, digits, fault=fault, measure=what, **(usual | other))

    def theory(fault: str, what: str, **other: float) -> float:
        return number(table, "theory", fault=fault, measure=what, **(usual | other))

    away = table[(table["fault"] != PART) & (table["measure"] == RUNAWAY)]
    near = pick(away[away["latency"] < _FAR], hold_off=_SHORT)
    gap = 100 * (near["mean"] - near["theory"]).abs().max()
    far = {
        name: 100 * number(away, name, latency=_FAR, hold_off=_SHORT, fault=ALL)
        for name in ("mean", "theory")
    }
    room = {wait: 100 * pick(table, hold_off=wait)["least"].min() for wait in (_SHORT, _LONG)}
    held = {
        wait: f"no run exceeds it, and the nearest stays {least:.2f} % of the capacity below"
        if least >= 0.0
        else f"runs exceed it by up to {-least:.1f} % of the capacity"
        for wait, least in room.items()
    }
    return sentences(f"""
        - The run-away is at most n alpha (duration + latency), and a hold-off more where a channel heals, if
          one signal was enough before. With hold-off {_SHORT:g} {held[_SHORT]}; with {_LONG:g}
          {held[_LONG]}.
        - With hold-off {_SHORT:g} and latencies up to 1 the mean run-away is that of the means, half a
          sawtooth less, to within {gap:.1f} points: {say(ALL, RUNAWAY, 100.0)} % after {_SHOWN_DURATION:g}
          periods of silence with latency {_SHOWN_LATENCY:g}. At latency {_FAR:g} it is {far["mean"]:.0f} %,
          where the means have {far["theory"]:.0f}: they leave out that the total swings by itself there.
        - It is back {say(ALL, BACK)} periods after those {_SHOWN_DURATION:g} with hold-off
          {_SHORT:g} (theory {theory(ALL, BACK):.1f}), and
          {say(ALL, BACK, hold_off=_LONG)} with {_LONG:g} (theory
          {theory(ALL, BACK, hold_off=_LONG):.1f}): every hold-off brings a signal. The demand
          in excess of the capacity adds up to {say(ALL, OVERLOAD)} and
          {say(ALL, OVERLOAD, hold_off=_LONG)} periods of all of it.
        - Half of the agents cut off for {_SHOWN_DURATION:g} periods run away by
          {say(PART, RUNAWAY, 100.0)} % with hold-off {_SHORT:g}, as the others give way, and by
          {say(PART, RUNAWAY, 100.0, hold_off=_LONG)} % with {_LONG:g}, where signals come too rarely to
          give way. With {_SHORT:g} those that hear get {say(PART, ODD)} periods of their
          share more than without the outage, the half that is cut off
          {say(PART, EVEN)}.
        - A time x / alpha = {PACE:.0f} periods after healing {say(PART, GAP, 1.0, 2)}
          of the gap is left ({theory(PART, GAP):.2f} at the rate alpha / x alone), and
          in the last {_LATE} periods the halves hold {say(PART, "even half at the end", 1.0, 2)} and
          {say(PART, "odd half at the end", 1.0, 2)} of their optimum: averages remember.
    """)


main = command("outage", study, __doc__)

if __name__ == "__main__":
    main()
