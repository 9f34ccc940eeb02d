"""How much coming and going does the system bear, and what does a camera do that has forgotten?

Utilisation stays high until cameras leave about as fast as they grow: it is 0.95 with a mean stay of 80
periods, and 0.72 with 24, below the critical C / (n alpha) = 32. Peaks stay below the growth over the
latency. Churn evens out the shares, nearly as a square added to all costs. Averages over the whole past
follow the optimum of present cameras the slower the older the run, within 17 % after 800 periods and 10 %
after 8,000. Short memories follow within 20 to 22 % at any age. A camera that has forgotten its average
takes 1.35 times its share with costs of power 6, because a small average makes a small response
probability.
"""  # noqa: D400 - a question

from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Recording, Result, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import Absence, Crash, Intervention
from aimd_des.latency import Constant
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, quietly, rows_of, run_draws, sensed
from scenarios.common.presence import PRESENT, schedule
from scenarios.common.systems import alike, memory_alone
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws

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
QUADRATIC, STEEP, STAYED = (
    "returning, quadratic costs",
    "returning, costs of power 6",
    "agents that stayed",
)
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


class Times(NamedTuple):
    """When a quarter leaves together, when it is back, the end, and how often allocations are kept."""

    leave: float = 400.0
    back: float = 500.0
    end: float = 800.0
    every: float = 5.0

    @property
    def looks(self) -> FloatArray:
        """When allocations are kept."""
        return np.asarray(np.arange(self.leave - 50.0, self.end + 0.5 * self.every, self.every))


class Seen(NamedTuple):
    """What is seen of one run."""

    signals: float  # per unit of time, after the start
    utilisation: float  # mean total demand over the capacity, after the start
    high: float  # what total demand is below for 99 % of the time, over the capacity
    above: float  # share of the time above the capacity
    # Relative error of the averages of those present against their optimum, in the mean over time.
    tracking: float
    # Of averages at the end: from the optimum for what is used, and from that which churn makes of it.
    from_plain: float
    from_churned: float


class Together(NamedTuple):
    """What is seen of a run in which a quarter leaves together."""

    # (q, n): Of all cameras, in units of the resource.
    demand: FloatArray
    average: FloatArray
    again: float  # time until the total is where it was, or at the capacity
    # What was released over the growth of agents that stay, which is the time that it should take.
    released: float


def measure(case: Case, draw: int, seed: int) -> Seen:
    """Run with a draw of the costs."""
    returns, averaging = WAYS[case.way]
    looks = np.arange(case.start, case.until + 1.0, 25.0)
    recording = Recording(demand=0.25, allocations=looks)
    changes = schedule(case.stay, case.until, returns, seed)
    result = _run(draw, averaging, changes, recording, case.until, seed)
    seen, sent, average = result.observations, result.signals_sent, result.average_at_end
    total = seen.total_demand[seen.demand_times >= case.start, 0] / CAPACITY
    share = steady(case.stay, draw).share
    return Seen(
        signals=float((sent.time >= case.start).sum() / (case.until - case.start)),
        utilisation=float(total.mean()),
        high=float(np.quantile(total, 0.99)),
        above=float(seen.overshoot.time[0]),
        tracking=float(result.tracking["relative_error"].mean()),
        from_plain=float(distance(memory_alone(draw=draw), average)[0]),
        from_churned=float(np.abs(average[:, 0] / average.sum() - share / share.sum()).sum()),
    )


def _run(
    draw: int,
    averaging: Averaging,
    interventions: Sequence[Intervention],
    recording: Recording,
    until: float,
    seed: int,
) -> Result:
    simulation = sensed(
        memory_alone(draw=draw),
        HOLD_OFF,
        channel=BroadcastChannel(latency=Constant(LATENCY)),
        averaging=averaging,
        interventions=interventions,
        seed=seed,
        recording=recording,
    )
    return quietly(simulation, until)


def leave_together(case: tuple[str, Times], draw: int, seed: int) -> Together:
    """Let a quarter of the cameras leave and come back, with or without their averages."""
    name, times = case
    before, after = times.leave - 1e-6, times.leave + np.arange(round(_SPAN / _LOOKS) + 1) * _LOOKS
    recording = Recording(demand=np.append(before, after), allocations=times.looks, overshoot=False)
    leaves = FORGOT[name](list(GROUP), times.leave, times.back)
    seen = _run(draw, Cumulative(), [leaves], recording, times.end, seed).observations
    total = seen.total_demand[: len(after) + 1, 0]
    again = np.argmax(total[1:] >= min(total[0], CAPACITY))
    released = (total[0] - total[1]) / (ALPHA * (N - len(GROUP)))
    return Together(seen.demand[:, 0], seen.average[:, 0], float(again * _LOOKS), float(released))


@lru_cache
def steady(stay: float, draw: int = 0) -> theory.Churn:
    """Predict the steady state with a mean stay."""
    return theory.churn(memory_alone(draw=draw), stay, PRESENT, LATENCY)


@lru_cache
def _level(draw: int) -> float:
    expected = theory.predict(memory_alone(draw=draw), "continuous", latency=LATENCY)
    return float(expected.utilisation[0]) * CAPACITY


@lru_cache
def optimum(draw: int = 0) -> FloatArray:
    """Compute the optimum of all cameras for what is used without churn, (n,)."""
    best = solve_optimum(memory_alone(draw=draw), capacity=np.array([_level(draw)]))
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
def fluid(name: str, times: Times, draw: int = 0) -> tuple[FloatArray, FloatArray]:
    """Compute what the fluid does where a quarter leaves together: demand and averages, (q, n)."""
    away = theory.Spell(times.leave, times.back, GROUP, forgets=FORGOT[name] is Crash)
    path = theory.flow(memory_alone(draw=draw), _level(draw), times.end, spells=[away])
    # Observers look just after an intervention.
    at = np.minimum(np.searchsorted(path.time, times.looks) + 1, len(path.time) - 1)
    return path.demand[at], path.average[at]


# When the demand of agents that have come back is sampled, in periods since then.
_WINDOW = (50.0, 100.0)
_LABELS = ["way", "stay", "until"]
# The mean stay at which runs of two lengths are compared, and a run is so many times as long.
_SHOWN, _LONGER = 80.0, 10.0

_Groups = list[tuple[tuple[str, Times], list[list[Together]]]]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Let cameras come and go, ever faster, and let a quarter of them leave and come back together."""
    draws, until = (2, 60.0) if quick else (10, 800.0)
    stays = (24.0, _SHOWN, np.inf) if quick else (24.0, 48.0, _SHOWN, 160.0, np.inf)
    times = Times(100.0, 140.0, 240.0, 10.0) if quick else Times()
    cases = [Case(way, stay, until) for stay in stays for way in WAYS]
    long = [Case(way, _SHOWN, _LONGER * until) for way in WAYS]
    pairs = run_draws(measure, cases + long, draws, 1, seed, quick, runs)
    together = run_draws(
        leave_together, [(name, times) for name in FORGOT], draws, 1 if quick else 3, seed, quick, runs
    )
    table = pd.concat([_sweep(pairs, seed), _returned(together, seed)], ignore_index=True)
    settings = {"seed": seed, "draws": draws, "until": until}
    printed = shown(table[table["until"] != _LONGER * until], ["way", "stay", "measure"], ".3f")
    drawn = {"churn": partial(_figure, table, together, seed)}
    return Finding("churn", settings, table, printed, _findings(table), drawn)


def _sweep(pairs: Sequence[tuple[Case, list[list[Seen]]]], seed: int) -> pd.DataFrame:
    table = summarise_draws(rows_of(pairs, first=seed), _LABELS)
    # Without churn a third is never there.
    kept: pd.DataFrame = table.loc[np.isfinite(table["stay"]) | ~table["measure"].str.startswith("from_")]
    theories = [_expected(row["measure"], row["stay"]) for row in kept.to_dict("records")]
    return kept.assign(theory=theories)


def _expected(name: str, stay: float) -> float:
    """Predict one number of the sweep, with the costs of draw 0; NaN where there is no formula."""
    if name == "high":  # all agents that can be there grow over the latency
        return 1.0 + float(theory.peak_lift(N, ALPHA, LATENCY)) / CAPACITY
    return float(getattr(steady(stay), name)) if name in ("signals", "utilisation") else np.nan


def _returned(together: _Groups, seed: int) -> pd.DataFrame:
    """Measure what each camera holds a while after the return, over its share of the optimum."""
    rows, known = [], []
    for (name, times), found in together:
        since = times.looks - times.back
        window = (since >= _WINDOW[0]) & (since <= _WINDOW[1])
        for draw, runs in enumerate(found, seed):
            labels: dict[str, Any] = {"way": name, "stay": np.nan, "until": times.end, "draw": draw}
            share = {kind: optimum(draw)[agents].sum() for kind, agents in kinds(draw).items()}

            def held(demand: Any, agents: list[int], window: Any = window) -> float:
                return float(demand[window][:, agents].sum(axis=1).mean())

            flowing = fluid(name, times, draw)[0]
            wanted = {kind: held(flowing, agents) / share[kind] for kind, agents in kinds(draw).items()}
            released = float(np.mean([run.released for run in runs]))
            known.append({**labels, **wanted, "reused after": released})
            for run in runs:
                got = {kind: held(run.demand, agents) / share[kind] for kind, agents in kinds(draw).items()}
                rows.append({**labels, **got, "reused after": run.again})
    expected = summarise_draws(known, _LABELS)["mean"].to_numpy()
    return summarise_draws(rows, _LABELS).assign(theory=expected)


def _figure(table: pd.DataFrame, together: _Groups, seed: int) -> Figure:
    """Draw what churn does, and what the cameras do that come back together, in four panels."""
    figure = Figure(figsize=(12.5, 9.4), layout="constrained")
    # Use and signals have an axis each, one above the other, in the place of one panel.
    rows: list[Any] = [["use", "tracking"], ["signals", "tracking"], ["shares", "return"]]
    panels = figure.subplot_mosaic(rows, height_ratios=[1.0, 1.0, 2.0])
    _draw_use(panels["use"], panels["signals"], table)
    _draw_tracking(panels["tracking"], table)
    _draw_shares(panels["shares"], table)
    _draw_return(panels["return"], together, seed)
    figures.legends([panels[name] for name in ("use", "tracking", "shares", "return")])
    return figure


def _short(table: pd.DataFrame) -> float:
    """Say how long the shorter runs are."""
    return float(table["until"].min())


def _moving(table: pd.DataFrame, way: str, name: str) -> pd.DataFrame:
    return pick(table[np.isfinite(table["stay"])], way=way, measure=name, until=_short(table))


def _dress(axes: Axes, title: str, label: str) -> None:
    x: dict[str, Any] = {"x": "mean stay of a camera (periods)", "xscale": "log"}
    figures.dress(axes, title, y=label, ylim=(0.0, None), **x)


def _draw_use(top: Axes, bottom: Axes, table: pd.DataFrame) -> None:
    stays = _moving(table, KEPT, "signals")["stay"]
    grid = np.geomspace(stays.min(), stays.max(), 24)
    for axes, name in ((top, "utilisation"), (bottom, "signals")):
        figures.points(axes, stays, _moving(table, KEPT, name), 0, "mean over draws ± 2 standard errors")
        axes.plot(grid, [getattr(steady(stay), name) for stay in grid], color=colour(0), linewidth=1.4)
        axes.axvline(CRITICAL_STAY, color=figures.REFERENCE, linewidth=1.0, linestyle="--")
    figures.named(top, "theory", color=colour(0), linewidth=1.4)
    figures.named(top, "critical stay C / (n alpha)", "--", linewidth=1.0)
    _dress(top, "(a) Signals become rare before demand falls", "mean demand\nover capacity")
    _dress(bottom, "", "signals per period")
    top.sharex(bottom)
    top.set_xlabel("")
    top.tick_params(labelbottom=False)


def _draw_tracking(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(WAYS):
        rows, look = _moving(table, way, "tracking"), {"linestyle": ":", "linewidth": 0.9}
        figures.points(
            axes, rows["stay"], rows, place, f"average: {way}", scale=100.0, fmt="os^D"[place], **look
        )
        longer = pick(
            table[table["until"] == _LONGER * _short(table)], way=way, measure="tracking", stay=_SHOWN
        )
        figures.points(axes, longer["stay"], longer, place, scale=100.0, fmt="os^D"[place], fillstyle="none")
    figures.named(axes, "after ten times the time", "o", fillstyle="none", markersize=6)
    _dress(axes, "(b) Averages against the optimum of those present", "tracking error (%)")


def _draw_shares(axes: Axes, table: pd.DataFrame) -> None:
    names = (("full", "from_plain", "from the optimum"), ("none", "from_churned", "from that with a square"))
    moving = table[np.isfinite(table["stay"])]
    for face, name, label in names:
        for place, until in enumerate((_short(table), _LONGER * _short(table))):
            rows, words = pick(moving, way=KEPT, measure=name, until=until), f"{label}, {until:g} periods"
            figures.points(axes, rows["stay"], rows, place, words, scale=100.0, fillstyle=face)
    _dress(axes, "(c) Churn evens out the shares", "distance of the averages (%)")


def _draw_return(axes: Axes, together: _Groups, seed: int) -> None:
    for place, ((name, times), found) in enumerate(together):
        shade, since = colour(4 + place), times.looks - times.back
        courses, flowing = [], []
        for draw, runs in enumerate(found, seed):
            agents = kinds(draw)[STEEP]
            share = optimum(draw)[agents].mean()
            courses += [
                [part[:, agents].mean(axis=1) / share for part in (run.demand, run.average)] for run in runs
            ]
            flowing.append([part[:, agents].mean(axis=1) / share for part in fluid(name, times, draw)])
        figures.course(axes, since, courses, np.mean(flowing, axis=0), shade)
        axes.plot([], [], color=shade, linewidth=2.2, label=f"{name} (thin: demand)")
    figures.level(axes, 1.0, "--")
    figures.named(axes, "theory (fluid)", ":", color="black", linewidth=0.9)
    x, y = "time since a quarter is back (periods)", "memory over the optimal share, costs of power 6"
    figures.dress(axes, "(d) Cameras that have forgotten take too much", x, y, ylim=(0.0, None))


def _findings(table: pd.DataFrame) -> list[str]:
    short, long = _short(table), float(table["until"].max())
    groups = float(table.loc[table["stay"].isna(), "until"].iloc[0])

    def say(
        way: str, stay: float, name: str, scale: float = 1.0, digits: int = 2, until: float = short
    ) -> str:
        return over_draws(table, scale, digits, way=way, stay=stay, until=until, measure=name)

    def theory_of(stay: float, name: str) -> float:
        return number(table, "theory", way=KEPT, stay=stay, until=short, measure=name)

    fast = table["stay"].min()
    tracking = "; ".join(f"{way} {say(way, _SHOWN, 'tracking', 100, 1)}" for way in WAYS)
    later = "; ".join(f"{way} {say(way, _SHOWN, 'tracking', 100, 1, long)}" for way in WAYS)
    held = {
        name: "; ".join(f"{kind} {say(name, np.nan, kind, until=groups)}" for kind in kinds())
        for name in FORGOT
    }
    kept, forgotten = FORGOT
    return sentences(f"""
        - Churn costs use late and signals early. With a mean stay of {_SHOWN:g} periods
          {say(KEPT, _SHOWN, "utilisation", digits=3)} of the capacity are used (theory
          {theory_of(_SHOWN, "utilisation"):.3f}) at {say(KEPT, _SHOWN, "signals")} signals a period (theory
          {theory_of(_SHOWN, "signals"):.2f}), with {fast:g} {say(KEPT, fast, "utilisation", digits=3)} at
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
        - What a quarter releases is in use again after {say(kept, np.nan, "reused after", 1.0, 1, groups)}
          periods. Demand over the optimum, {_WINDOW[0]:g} to {_WINDOW[1]:g} periods after it is back: {kept}:
          {held[kept]}; {forgotten}: {held[forgotten]}.
    """)


main = command("churn", study, __doc__)

if __name__ == "__main__":
    main()
