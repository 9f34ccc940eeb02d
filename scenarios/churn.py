"""How much coming and going does the system bear, and what does a camera do that has forgotten?

Utilisation stays high until cameras leave about as fast as they grow: it is 0.95 with a mean stay of 80
periods, and 0.72 with 24, below the critical C / (n alpha) = 32. Peaks stay below the growth over the
latency. Churn evens out the shares, nearly as a square added to all costs. Averages over the whole past
follow the optimum of present cameras the slower the older the run, within 17 % after 800 periods and 10 %
after 8,000. Short memories follow within 20 to 22 % at any age. A camera that has forgotten its average
takes 1.35 times its share with costs of power 6, because a small average makes a small response
probability.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Recording, Result, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import Absence, Crash
from aimd_des.latency import Constant
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, quietly, run_draws, sensed
from scenarios.common.presence import PRESENT, schedule
from scenarios.common.systems import alike, memory_alone, used
from scenarios.common.tables import number, over_draws, pick, shown, table_of, theory_of

# Growth and capacity are the same in all draws of the costs.
_PROBLEM = memory_alone()
N, ALPHA, CAPACITY = _PROBLEM.n_agents, float(_PROBLEM.increase[0, 0]), float(_PROBLEM.capacity[0])
LATENCY = HOLD_OFF = 0.5
#: Of agents that are present on average: what they can grow to before they go is the capacity.
CRITICAL_STAY = CAPACITY / (PRESENT * N * ALPHA)
#: Agents that leave together.
GROUP = tuple(range(0, N, 4))
# Looks at the total after that.
_LOOKS, _SPAN = 0.05, 30.0


class _Way(NamedTuple):
    returns: type[Absence] | type[Crash]
    averaging: Averaging


#: Cameras keep their averages, over all of the time for which they were there.
KEPT = "all of the past"
WAYS = {
    KEPT: _Way(Absence, Cumulative()),
    "window, 200": _Way(Absence, Window(200.0)),
    "forgetting, 100": _Way(Absence, Forgetting(100.0)),
    "all since a crash": _Way(Crash, Cumulative()),
}
QUADRATIC, STEEP = "returning, quadratic costs", "returning, costs of power 6"
STAYED, REUSED = "agents that stayed", "reused after"
FORGOT: dict[str, type[Absence] | type[Crash]] = {"average kept": Absence, "average forgotten": Crash}


class Case(NamedTuple):
    """A way of averaging and returning, the mean stay of a camera, and the end, in units of time."""

    way: str
    stay: float
    until: float

    @property
    def start(self) -> float:
        """From when on the run is measured."""
        return 0.375 * self.until


class Group(NamedTuple):
    """A quarter leaves together: with which averages, when, when it is back, the end, and the sampling."""

    way: str
    leave: float = 400.0
    back: float = 500.0
    until: float = 800.0
    every: float = 5.0

    @property
    def stay(self) -> float:
        """What the table has for the mean stay of a camera: NaN, as these come and go once."""
        return np.nan

    @property
    def looks(self) -> FloatArray:
        """When allocations are kept."""
        return np.asarray(np.arange(self.leave - 50.0, self.until + 0.5 * self.every, self.every))


class Together(NamedTuple):
    """What is seen of a run in which a quarter leaves together."""

    # (q, n): Of all cameras, in units of the resource.
    demand: FloatArray
    average: FloatArray
    again: float  # time until the total is where it was, or at the capacity
    # What was released over the growth of agents that stay, which is the time that it should take.
    released: float


def measure(case: Case, draw: int, seed: int) -> dict[str, float]:
    """Run with a draw of the costs, and measure what comes after the start."""
    returns, averaging = WAYS[case.way]
    changes = schedule(case.stay, case.until, returns, seed)
    recording = Recording(demand=0.25, allocations=np.arange(case.start, case.until + 1.0, 25.0))
    parts = {"averaging": averaging, "interventions": changes, "recording": recording}
    result = _run(draw, case.until, seed, **parts)
    seen, sent, average = result.observations, result.signals_sent, result.average_at_end
    total = seen.total_demand[seen.demand_times >= case.start, 0] / CAPACITY
    found = {
        "signals": float((sent.time >= case.start).sum() / (case.until - case.start)),
        "utilisation": float(total.mean()),
        "high": float(np.quantile(total, 0.99)),  # what the total is below for 99 % of the time
        "above": float(seen.overshoot.time[0]),  # share of the time above the capacity
        # Error of the averages of those present against their optimum, in the mean over time.
        "tracking": float(result.tracking["relative_error"].mean()),
    }
    if np.isfinite(case.stay):  # without churn a third is never there
        share = steady(case.stay, draw).share
        found["from_plain"] = float(distance(memory_alone(draw=draw), average)[0])
        found["from_churned"] = float(np.abs(average[:, 0] / average.sum() - share / share.sum()).sum())
    return found


def _run(draw: int, until: float, seed: int, **parts: Any) -> Result:
    channel = BroadcastChannel(latency=Constant(LATENCY))
    return quietly(sensed(memory_alone(draw=draw), HOLD_OFF, channel=channel, seed=seed, **parts), until)


def leave_together(case: Group, draw: int, seed: int) -> Together:
    """Let a quarter of the cameras leave and come back, with or without their averages."""
    before, after = case.leave - 1e-6, case.leave + np.arange(round(_SPAN / _LOOKS) + 1) * _LOOKS
    recording = Recording(demand=np.append(before, after), allocations=case.looks, overshoot=False)
    leaves = FORGOT[case.way](list(GROUP), case.leave, case.back)
    seen = _run(draw, case.until, seed, interventions=[leaves], recording=recording).observations
    total = seen.total_demand[: len(after) + 1, 0]
    again = np.argmax(total[1:] >= min(total[0], CAPACITY))
    released = (total[0] - total[1]) / (ALPHA * (N - len(GROUP)))
    return Together(seen.demand[:, 0], seen.average[:, 0], float(again * _LOOKS), float(released))


@lru_cache
def steady(stay: float, draw: int = 0) -> theory.Churn:
    """Predict the steady state with a mean stay."""
    return theory.churn(memory_alone(draw=draw), stay, PRESENT, LATENCY)


@lru_cache
def optimum(draw: int = 0) -> FloatArray:
    """Compute the optimum of all cameras for what is used without churn, (n,)."""
    problem = memory_alone(draw=draw)
    best = solve_optimum(problem, capacity=[used(problem, LATENCY)])
    return np.asarray(best.allocation[:, 0])


@lru_cache
def kinds(draw: int = 0) -> dict[str, list[int]]:
    """Sort cameras into those that come back, by their costs, and those that have stayed."""
    problem = memory_alone(draw=draw)
    return {
        QUADRATIC: [i for i in alike(problem, 1.0) if i in GROUP],
        STEEP: [i for i in alike(problem, 5.0) if i in GROUP],
        STAYED: [i for i in range(N) if i not in GROUP],
    }


@lru_cache
def fluid(case: Group, draw: int = 0) -> tuple[FloatArray, FloatArray]:
    """Compute what the fluid does where a quarter leaves together: demand and averages, (q, n)."""
    away = theory.Spell(case.leave, case.back, GROUP, forgets=FORGOT[case.way] is Crash)
    problem = memory_alone(draw=draw)
    path = theory.flow(problem, used(problem, LATENCY), case.until, spells=[away])
    # Observers look just after an intervention.
    at = np.minimum(np.searchsorted(path.time, case.looks) + 1, len(path.time) - 1)
    return path.demand[at], path.average[at]


def held(case: Group, draw: int, demand: FloatArray) -> dict[str, float]:
    """Measure what each kind of camera holds a while after the return, over its share of the optimum."""
    since, share = case.looks - case.back, optimum(draw)
    window = demand[(since >= _WINDOW[0]) & (since <= _WINDOW[1])]
    return {
        kind: float(window[:, agents].sum(axis=1).mean()) / share[agents].sum()
        for kind, agents in kinds(draw).items()
    }


# When the demand of agents that have come back is sampled, in periods since then.
_WINDOW = (50.0, 100.0)
_LABELS = ["way", "stay", "until"]
# The mean stay at which runs of two lengths are compared, and a run is so many times as long.
_SHOWN, _LONGER = 80.0, 10.0

_Groups = list[tuple[Group, list[list[Together]]]]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Let cameras come and go, ever faster, and let a quarter of them leave and come back together."""
    draws, until = (2, 60.0) if quick else (10, 800.0)
    stays = (24.0, _SHOWN, np.inf) if quick else (24.0, 48.0, _SHOWN, 160.0, np.inf)
    times = (100.0, 140.0, 240.0, 10.0) if quick else ()
    cases = [Case(way, stay, until) for stay in stays for way in WAYS]
    cases += [Case(way, _SHOWN, _LONGER * until) for way in WAYS]
    groups = [Group(way, *times) for way in FORGOT]
    pairs = run_draws(measure, cases, draws, 1, seed, quick, runs)
    together = run_draws(leave_together, groups, draws, 1 if quick else 3, seed, quick, runs)
    returned = [
        (case, [[_numbers(case, draw, run) for run in part] for draw, part in enumerate(found, seed)])
        for case, found in together
    ]
    swept, back = table_of(pairs, _LABELS, seed, _expected), table_of(returned, _LABELS, seed)
    table = pd.concat([swept, back], ignore_index=True)
    settings = {"seed": seed, "draws": draws, "until": until}
    printed = shown(table[table["until"] != _LONGER * until], ["way", "stay", "measure"], ".3f")
    drawn = {"churn": partial(_figure, table, together, seed)}
    return Finding("churn", settings, table, printed, _findings(table), drawn)


def _expected(case: Case, _: int) -> dict[str, float]:
    """Predict what there is a formula for, with the costs of draw 0."""
    known = steady(case.stay)
    # All agents that can be there grow over the latency.
    high = 1.0 + float(theory.peak_lift(N, ALPHA, LATENCY)) / CAPACITY
    return {"signals": known.signals, "utilisation": known.utilisation, "high": high}


def _numbers(case: Group, draw: int, run: Together) -> dict[str, float]:
    """Measure one return, beside what the fluid has for it."""
    known = {**held(case, draw, fluid(case, draw)[0]), REUSED: run.released}
    found = {**held(case, draw, run.demand), REUSED: run.again}
    return {**found, **{theory_of(measure): value for measure, value in known.items()}}


def _figure(table: pd.DataFrame, together: _Groups, seed: int) -> Figure:
    """Draw what churn does, and what the cameras do that come back together, in four panels."""
    figure = Figure(figsize=(12.5, 9.4), layout="constrained")
    # Use and signals have an axis each, one above the other, in the place of one panel.
    rows: list[Any] = [["use", "tracking"], ["signals", "tracking"], ["shares", "return"]]
    panels = figure.subplot_mosaic(rows, height_ratios=[1.0, 1.0, 2.0])
    moving = table[np.isfinite(table["stay"])]
    short = moving[moving["until"] == moving["until"].min()]
    _draw_use(panels["use"], panels["signals"], pick(short, way=KEPT))
    longer = moving.drop(short.index)
    _draw_tracking(panels["tracking"], pick(short, measure="tracking"), pick(longer, measure="tracking"))
    _draw_shares(panels["shares"], pick(moving, way=KEPT))
    _draw_return(panels["return"], together, seed)
    figures.legends([panels[name] for name in ("use", "tracking", "shares", "return")])
    return figure


def _dress(axes: Axes, title: str, label: str) -> None:
    x: dict[str, Any] = {"x": "mean stay of a camera (periods)", "xscale": "log"}
    figures.dress(axes, title, y=label, ylim=(0.0, None), **x)


def _draw_use(top: Axes, bottom: Axes, table: pd.DataFrame) -> None:
    grid = np.geomspace(table["stay"].min(), table["stay"].max(), 24)
    for axes, name in ((top, "utilisation"), (bottom, "signals")):
        rows = pick(table, measure=name)
        figures.points(axes, rows["stay"], rows, 0, "mean over draws ± 2 standard errors")
        axes.plot(grid, [getattr(steady(stay), name) for stay in grid], color=colour(0), linewidth=1.4)
        axes.axvline(CRITICAL_STAY, color=figures.REFERENCE, linewidth=1.0, linestyle="--")
    figures.named(top, "theory", color=colour(0), linewidth=1.4)
    figures.named(top, "critical stay C / (n alpha)", "--", linewidth=1.0)
    _dress(top, "(a) Signals become rare before demand falls", "mean demand\nover capacity")
    _dress(bottom, "", "signals per period")
    top.sharex(bottom)
    top.set_xlabel("")
    top.tick_params(labelbottom=False)


def _draw_tracking(axes: Axes, short: pd.DataFrame, longer: pd.DataFrame) -> None:
    how: dict[str, Any] = {"scale": 100.0, "linestyle": ":", "linewidth": 0.9}
    figures.curves(axes, "stay", "way", short, "average: {}", **how)
    figures.curves(axes, "stay", "way", longer, "", scale=100.0, fillstyle="none")
    figures.named(axes, "after ten times the time", "o", fillstyle="none", markersize=6)
    _dress(axes, "(b) Averages against the optimum of those present", "tracking error (%)")


def _draw_shares(axes: Axes, table: pd.DataFrame) -> None:
    names = (("full", "from_plain", "from the optimum"), ("none", "from_churned", "from that with a square"))
    for face, name, label in names:
        rows, words = pick(table, measure=name), f"{label}, {{:g}} periods"
        figures.curves(axes, "stay", "until", rows, words, scale=100.0, fillstyle=face)
    _dress(axes, "(c) Churn evens out the shares", "distance of the averages (%)")


def _draw_return(axes: Axes, together: _Groups, seed: int) -> None:
    for place, (case, found) in enumerate(together):
        shade, since = colour(4 + place), case.looks - case.back
        courses, flowing = [], []
        for draw, runs in enumerate(found, seed):
            agents = kinds(draw)[STEEP]
            share = optimum(draw)[agents].mean()
            both = [[run.demand, run.average] for run in runs]
            courses += [[part[:, agents].mean(axis=1) / share for part in parts] for parts in both]
            flowing.append([part[:, agents].mean(axis=1) / share for part in fluid(case, draw)])
        figures.course(axes, since, courses, np.mean(flowing, axis=0), shade)
        axes.plot([], [], color=shade, linewidth=2.2, label=f"{case.way} (thin: demand)")
    figures.level(axes, 1.0, "--")
    figures.named(axes, "theory (fluid)", ":", color="black", linewidth=0.9)
    x, y = "time since a quarter is back (periods)", "memory over the optimal share, costs of power 6"
    figures.dress(axes, "(d) Cameras that have forgotten take too much", x, y, ylim=(0.0, None))


def _findings(table: pd.DataFrame) -> list[str]:
    short, long = float(table["until"].min()), float(table["until"].max())
    groups = float(table.loc[table["stay"].isna(), "until"].iloc[0])

    def say(
        way: str, stay: float, name: str, scale: float = 1.0, digits: int = 2, until: float = short
    ) -> str:
        return over_draws(table, scale, digits, way=way, stay=stay, until=until, measure=name)

    known = partial(number, table, "theory", way=KEPT, stay=_SHOWN, until=short)
    fast = table["stay"].min()
    tracking = "; ".join(f"{way} {say(way, _SHOWN, 'tracking', 100, 1)}" for way in WAYS)
    later = "; ".join(f"{way} {say(way, _SHOWN, 'tracking', 100, 1, long)}" for way in WAYS)
    returned = {
        name: "; ".join(f"{kind} {say(name, np.nan, kind, until=groups)}" for kind in kinds())
        for name in FORGOT
    }
    kept, forgotten = FORGOT
    return sentences(f"""
        - Churn costs use late and signals early. With a mean stay of {_SHOWN:g} periods
          {say(KEPT, _SHOWN, "utilisation", digits=3)} of the capacity are used (theory
          {known(measure="utilisation"):.3f}) at {say(KEPT, _SHOWN, "signals")} signals a period (theory
          {known(measure="signals"):.2f}), with {fast:g} {say(KEPT, fast, "utilisation", digits=3)} at
          {say(KEPT, fast, "signals", digits=3)}; without churn
          {say(KEPT, np.inf, "utilisation", digits=3)} at {say(KEPT, np.inf, "signals")}. Below a stay of
          {CRITICAL_STAY:.0f} periods cameras go before they can fill the capacity. For 99 % of the time the
          total is below {say(KEPT, _SHOWN, "high", digits=3)} capacities.
        - Tracking error in % at a mean stay of {_SHOWN:g}, in runs of {short:g} periods: {tracking};
          in runs of {long:g}: {later}. What the whole past costs is the age of the run.
        - Churn evens out the shares: with a mean stay of {fast:g} averages are
          {say(KEPT, fast, "from_plain", 100, 1)} % from the plain optimum and
          {say(KEPT, fast, "from_churned", 100, 1)} % from that of costs to which it adds a square, with
          {_SHOWN:g} {say(KEPT, _SHOWN, "from_plain", 100, 1)} and
          {say(KEPT, _SHOWN, "from_churned", 100, 1)} %, and after ten times the time
          {say(KEPT, _SHOWN, "from_plain", 100, 1, long)} and
          {say(KEPT, _SHOWN, "from_churned", 100, 1, long)} %.
        - What a quarter releases is in use again after {say(kept, np.nan, REUSED, 1.0, 1, groups)}
          periods. Demand over the optimum, {_WINDOW[0]:g} to {_WINDOW[1]:g} periods after it is back: {kept}:
          {returned[kept]}; {forgotten}: {returned[forgotten]}.
    """)


main = command("churn", study, __doc__)

if __name__ == "__main__":
    main()
