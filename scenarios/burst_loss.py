"""Does it matter whether losses come in bursts?

Little, while the part of the capacity that bad links hold, n p alpha B / C, is small and each link has
bursts of its own.  Where it is larger each agent takes about p alpha B with any costs: shares level out,
and signals do not suffice in the end.  Where all links have their bursts together, total demand rises by
n alpha B in each, and is above the capacity for p of the time and a little more. Shares stay right up to
bursts of some tens of periods.  Compensation for loss does not help where bursts are long.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import (
    BroadcastChannel,
    Problem,
    Recording,
    Result,
    solve_optimum,
    theory,
    topology,
)
from aimd_des.compensation import Compensation, EstimatedLoss, KnownLoss
from aimd_des.loss import Bernoulli, CommonMode, GilbertElliott, Loss
from aimd_des.lowlevel import Channel, FloatArray
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, late, quietly, rows_of, run_draws, run_late, sensed
from scenarios.common.systems import memory_alone, spread
from scenarios.common.tables import (
    beside_theory,
    over_draws,
    pick,
    shown,
    summarise_draws,
    theory_of,
    with_theory,
)

# Of the total, for what is rounding and no excess.
_ROUNDING = 1e-9
# What is exceeded for so much of the time is a high level, however long the run.
_RARE = 0.01
# A Gamma so small that no response saturates, however much an agent compensates.
_GENTLE = 1 / 360


class Bursts(NamedTuple):
    """What is run: losses with a mean and a mean length of bursts, 0 for none."""

    common: bool  # whether all links are one
    # p, and B in units of time.
    loss: float
    burst: float
    hold_off: float  # r, in units of time
    # The end, and the time from which the run is measured.
    until: float
    start: float

    def channel(self, n: int) -> Channel:
        """Make the channel: links that are one are a single edge, from which a relay reaches all agents."""
        if self.burst == 0.0:
            model = CommonMode(self.loss) if self.common else Bernoulli(self.loss)
            return BroadcastChannel(loss=model)
        if not self.common:
            return BroadcastChannel(loss=GilbertElliott(self.loss, self.burst))
        graph: Any = nx.Graph()
        graph.add_edge("unit", "relay", latency=0.0, loss=self.loss)
        graph.add_edges_from((("relay", agent) for agent in range(n)), latency=0.0, loss=0.0)
        bursty = partial(GilbertElliott, mean_burst=self.burst)
        return topology.tree(graph, root="unit", agents=list(range(n)), loss=bursty)


class Outcome(NamedTuple):
    """What is measured of one run after its start; demand is over the capacity."""

    # Signals per unit of time, share of time above the capacity, mean of what is above it, the level that is
    # exceeded for 1 % of the time, and the highest.
    signals: float
    time_above: float
    excess: float
    high: float
    peak: float
    # Mean excess where total demand turns back above the capacity, seen once in a hold-off; NaN if it
    # never did.
    run_away_peak: float
    # Mean duration of excursions above the capacity, in units of time; NaN if there were none.
    excursion: float
    # Share of the total that the third of the agents with the smallest optimal allocations holds, and the
    # distance of the averages from the optimum for what they use.
    smallest: float
    misallocation: float


def run_one(run: Bursts, draw: int, seed: int, looks: FloatArray) -> Result:
    """Run, with total demand recorded at `looks`."""
    problem, span = memory_alone(draw=draw), (run.start, run.until)
    return run_late(problem, run.hold_off, run.channel(problem.n_agents), span, seed, looks)


def measure(run: Bursts, draw: int, seed: int) -> Outcome:
    """Run and measure; beyond what can be held responses are cut off at probability 1."""
    result = run_one(run, draw, seed, np.arange(run.start, run.until, run.hold_off))
    problem, found = result.problem, late(result, run.start)
    times = result.signals_sent.time
    times = times[times >= run.start]
    # A signal that did not suffice is repeated a hold-off later: so long as it is, demand is above.
    again = np.append(False, np.diff(times) <= run.hold_off * (1.0 + 1e-9))
    begun = int((again[1:] & ~again[:-1]).sum())
    level = result.observations.total_demand[:, 0] / problem.capacity[0] - 1.0
    turns = (level[1:-1] > _ROUNDING) & (level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])
    return Outcome(
        signals=found.signals,
        time_above=found.time_above,
        excess=found.excess,
        high=1.0 + float(np.quantile(level, 1.0 - _RARE)),
        peak=found.peak,
        run_away_peak=float(level[1:-1][turns].mean()) if turns.any() else np.nan,
        excursion=float(found.time_above * (run.until - run.start) / begun) if begun else np.nan,
        smallest=share_of_smallest(problem, found.average),
        misallocation=float(distance(problem, found.average)[0]),
    )


def share_of_smallest(problem: Problem, allocation: FloatArray) -> float:
    """Compute what the third of the agents holds that the optimum gives least of the one resource."""
    order = np.argsort(solve_optimum(problem).allocation[:, 0])
    return float(allocation[order[: problem.n_agents // 3], 0].sum() / allocation.sum())


class Answer(NamedTuple):
    """What is run with losses that are spread from 0 to twice a mean, and agents that compensate for them."""

    way: str  # "nothing", "known loss", or so many bits of a running number
    mean: float
    burst: float
    until: float

    @property
    def compensation(self) -> Compensation | None:
        """How agents compensate for loss."""
        if self.way == "nothing":
            return None
        return KnownLoss(_spread(self.mean)) if self.way == "known loss" else EstimatedLoss(int(self.way[0]))


def _spread(mean: float) -> FloatArray:
    return spread(0.0, 2.0 * mean)


def answer(run: Answer, draw: int, seed: int) -> float:
    """Run, and measure how far averages are from the optimum for what they use."""
    losses = _spread(run.mean)
    model: Loss = GilbertElliott(losses, run.burst) if run.burst > 0.0 else Bernoulli(losses)
    problem = memory_alone(normalization=_GENTLE, draw=draw)
    simulation = sensed(
        problem,
        0.1,
        channel=BroadcastChannel(loss=model),
        compensation=run.compensation,
        seed=seed,
        recording=Recording(demand="end", overshoot=False),
    )
    return float(distance(problem, quietly(simulation, run.until).average_at_end)[0])


_LOSS = 0.2
_HOLD_OFF = 0.25
_OWN, _COMMON = "each link for itself", "all links together"
_WAYS = ("nothing", "known loss", "5 bits", "8 bits")
# n alpha / C, the capacities that demand grows by in a period.
_GROWTH = 60 * 0.025 / 32.0
# Theory of bursts that all have together is for those much longer than the hold-off.
_LONG = 1.0
_SHOWN = 20.0
_OFF = "misallocation"
_LABELS = ["links", "loss", "burst", "length"]
_PRINTED = ("time_above", "high", "run_away_peak", "smallest", _OFF)
# Where links without a burst are drawn on a logarithmic axis.
_NONE = 0.3


class _Size(NamedTuple):
    draws: int
    losses: tuple[float, ...]
    held: tuple[float, ...]  # n p alpha B / C, the capacity that is held by links that are bad
    bursts: tuple[float, ...]  # of all links together
    start: float
    ends: tuple[float, ...]
    ways: tuple[str, ...]
    means: tuple[float, ...]
    answered: tuple[float, ...]  # mean bursts under which agents compensate
    until: float  # of those runs


_FULL = _Size(
    draws=10,
    losses=(0.1, 0.2, 0.4),
    held=(0.0, 0.05, 0.1, 0.2, 0.3, 0.45, 0.7),
    bursts=(0.0, 1.0, 3.0, 10.0, 20.0, 40.0, 80.0),
    start=1000.0,
    ends=(4000.0, 13_000.0),
    ways=_WAYS,
    means=(0.25, 0.4),
    answered=(0.0, 10.0, 40.0),
    until=5000.0,
)
_QUICK = _Size(
    2, (0.1, 0.4), (0.0, 0.2), (0.0, 20.0), 100.0, (400.0,), _WAYS[1:3], (0.25,), (0.0, 10.0), 400.0
)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with bursts of loss of many lengths, on each link and on all."""
    size = _QUICK if quick else _FULL
    cases = [
        Bursts(False, loss, round(held / (loss * _GROWTH), 6), _HOLD_OFF, until, size.start)
        for loss in size.losses
        for held in size.held
        for until in size.ends
    ]
    cases += [
        Bursts(True, _LOSS, burst, _HOLD_OFF, until, size.start)
        for burst in size.bursts
        for until in size.ends
    ]
    answers = [
        Answer(way, mean, burst, size.until)
        for way in size.ways
        for mean in size.means
        for burst in (size.answered if mean == size.means[0] else size.answered[:1])
    ]
    jobs = partial(run_draws, draws=size.draws, replications=1, seed=seed, quick=quick, runs=runs)
    rows = rows_of(jobs(measure, cases), _row, seed)
    rows += rows_of(
        jobs(answer, answers), lambda case, _, off: {**dict(zip(_LABELS, case, strict=True)), _OFF: off}, seed
    )
    table = with_theory(summarise_draws(rows, _LABELS), _LABELS)
    settings = {"seed": seed, **size._asdict()}
    printed = shown(table[table["measure"].isin(_PRINTED)], [*_LABELS, "measure"])
    drawn = {"burst_loss": partial(_figure, table, size, seed)}
    return Finding("burst_loss", settings, table, printed, _findings(table, size), drawn)


def _row(run: Bursts, draw: int, one: Outcome) -> dict[str, Any]:
    labels = {"links": _COMMON if run.common else _OWN, "loss": run.loss, "burst": run.burst}
    known = _expected(run.common, run.loss, run.burst, draw)
    expected = {theory_of(name): value for name, value in known.items()}
    return {**labels, "length": run.until, **one._asdict(), **expected}


@lru_cache(maxsize=1024)
def _expected(common: bool, loss: float, burst: float, draw: int) -> dict[str, float]:
    """Predict what there is a formula for, and what does not depend on the length of a run."""
    problem = memory_alone(draw=draw)
    if common and burst < _LONG:
        return {}
    if common:
        known = theory.burst_runaway(problem, loss, burst, hold_off=_HOLD_OFF, span=_LONG)
        if known is None:
            return {}
        found = {
            name: getattr(known, name) for name in ("time_above", "excess", "run_away_peak", "excursion")
        }
        return {**found, "smallest": share_of_smallest(problem, known.allocation), _OFF: 0.0}
    allocation, signals = theory.burst_shares(problem, loss, burst)
    if not signals * _HOLD_OFF < 1.0:  # also where it is not a number
        return {}
    away = float(distance(problem, allocation)[0])
    return {"signals": signals, "smallest": share_of_smallest(problem, allocation), _OFF: away}


def _figure(table: pd.DataFrame, size: _Size, seed: int) -> Figure:
    figure, panels = figures.panels(2, 3, (14.5, 8.4))
    _draw_demand(panels[0], seed)
    common = pick(table, links=_COMMON, length=size.ends[-1])
    _draw_levels(panels[1], common)
    _draw_shares(panels[2], common, table, size)
    held = "n p α B / C, the capacity that bad links hold"
    _draw_held(panels[3], table, size, "time_above")
    title = "(d) Bursts of each link: overload"
    figures.dress(panels[3], title, held, "time above the capacity (%)", ylim=(-3.0, 103.0))
    _draw_held(panels[4], table, size, "smallest")
    title = "(e) Bursts of each link level the shares"
    figures.dress(panels[4], title, held, "memory held by the 20 smallest (%)")
    _draw_answers(panels[5], table, size)
    figures.legends(panels)
    return figure


def _draw_demand(axes: Axes, seed: int) -> None:
    """Draw total demand of one run each, with the same random numbers."""
    for place, links in enumerate((_OWN, _COMMON)):
        run = Bursts(links == _COMMON, _LOSS, _SHOWN, _HOLD_OFF, 1200.0, 200.0)
        demand = run_one(run, seed, seed, np.arange(200.0, 1200.0, 0.5)).demand
        total = demand["total"] / 32.0
        axes.plot(demand["time"], total, color=colour(place), linewidth=1.0, label=links)
    figures.level(axes, 1.0)
    title = f"(a) One run with bursts of {_SHOWN:g} in the mean"
    figures.dress(axes, title, "time (control periods)", "total demand over capacity", numbers="x")


def _bursts(axes: Axes, title: str, label: str, **limits: Any) -> None:
    across = "mean length of a burst (control periods)"
    figures.dress(axes, title, across, label, numbers="y", xscale="log", **limits)
    axes.set_xticks([_NONE, 1.0, 10.0, 100.0], ["none", "1", "10", "100"])


def _draw_levels(axes: Axes, common: pd.DataFrame) -> None:
    names = {"high": "exceeded for 1 % of the time", "run_away_peak": "mean end of an excursion"}
    for place, (measured, label) in enumerate(names.items()):
        found, lift = pick(common, measure=measured), float(measured == "run_away_peak")
        rows = found.assign(mean=found["mean"] + lift, theory=found["theory"] + lift)
        burst = np.maximum(rows["burst"], _NONE)
        figures.curve(axes, burst, rows, place, label)
    figures.named(axes, "theory")
    figures.level(axes, 1.0)
    _bursts(axes, "(b) In common: demand runs away", "total demand over capacity", ylim=(0.0, None))


def _draw_shares(axes: Axes, common: pd.DataFrame, table: pd.DataFrame, size: _Size) -> None:
    own = pick(
        table, links=_OWN, loss=_LOSS if _LOSS in size.losses else size.losses[0], length=size.ends[-1]
    )
    for place, (links, all_rows) in enumerate(((_OWN, own), (_COMMON, common))):
        rows = pick(all_rows, measure=_OFF)
        burst = np.maximum(rows["burst"], _NONE)
        figures.curve(axes, burst, rows, place, links, scale=100.0)
    figures.named(axes, "theory")
    _bursts(axes, "(c) Shares", "distance from the optimum (%)")


def _draw_held(axes: Axes, table: pd.DataFrame, size: _Size, measured: str) -> None:
    for place, loss in enumerate(size.losses):
        rows = pick(table, links=_OWN, loss=loss, length=size.ends[-1], measure=measured)
        held = loss * _GROWTH * rows["burst"]
        figures.curve(axes, held, rows, place, f"loss {loss:g}", scale=100.0)
    if measured == "smallest":
        figures.named(axes, "theory")


def _draw_answers(axes: Axes, table: pd.DataFrame, size: _Size) -> None:
    for place, way in enumerate(size.ways):
        rows = pick(table, links=way, loss=size.means[0], measure=_OFF)
        look = {"fmt": f"{figures.MARKS[place]}-", "linewidth": 1.0}
        figures.points(axes, np.maximum(rows["burst"], _NONE), rows, place, way, scale=100.0, **look)
    title = f"(f) Making good for losses from 0 to {2 * size.means[0]:g}"
    _bursts(axes, title, "distance from the optimum (%)", ylim=(0.0, None))


def _findings(table: pd.DataFrame, size: _Size) -> list[str]:
    end, some = size.ends[-1], size.held[3] if len(size.held) > 3 else size.held[-1]

    def own(measured: str, held: float, scale: float = 100.0, digits: int = 1, length: float = end) -> str:
        return ", ".join(
            over_draws(
                table,
                scale,
                digits,
                links=_OWN,
                loss=loss,
                burst=round(held / (loss * _GROWTH), 6),
                length=length,
                measure=measured,
            )
            for loss in size.losses
        )

    def common(measured: str, burst: float, scale: float = 1.0, digits: int = 2, length: float = end) -> str:
        wanted = {"links": _COMMON, "burst": burst, "length": length, "measure": measured}
        return beside_theory(table, scale, digits, **wanted)

    def made_good(mean: float, burst: float) -> str:
        found = {
            way: over_draws(table, 100.0, 1, links=way, loss=mean, burst=burst, measure=_OFF)
            for way in size.ways
        }
        return ", ".join(f"{off} with {way}" for way, off in found.items())

    losses, last = ", ".join(f"{loss:g}" for loss in size.losses), size.bursts[-1]
    lengths = "; ".join(
        f"the highest is {common('peak', _SHOWN, length=length)} by {length:g}" for length in size.ends
    )
    answered = "; ".join(f"{made_good(size.means[0], burst)} at B = {burst:g}" for burst in size.answered)
    return sentences(f"""
        - Each link for itself: what orders bursts is the part of the capacity that bad links hold,
          n p alpha B / C. Where it is {some:g}, with losses of {losses}, demand is above the capacity for
          {own("time_above", some)} % of the time and the twenty smallest hold
          {own("smallest", some)} %; where it is {size.held[-1]:g},
          {own("time_above", size.held[-1])} and {own("smallest", size.held[-1])} %;
          without bursts {own("time_above", 0.0)} and {own("smallest", 0.0)} %.
        - All links together: bursts of {_SHOWN:g} end {common("run_away_peak", _SHOWN)} of the capacity above
          it in the mean, {common("time_above", _SHOWN, 100.0, 1)} % of the time is above, and the level that
          is exceeded for 1 % of the time is {common("high", _SHOWN)}; {lengths}.
        - Shares with bursts of all links are {common(_OFF, 0.0, 100.0, 1)} % from the optimum without bursts,
          {common(_OFF, _SHOWN, 100.0, 1)} at {_SHOWN:g} and {common(_OFF, last, 100.0, 1)} at {last:g}.
        - Losses spread from 0 to {2 * size.means[0]:g}, averages in % from the optimum: {answered}. With
          independent losses from 0 to {2 * size.means[-1]:g} they are {made_good(size.means[-1], 0.0)}.
    """)


main = command("burst_loss", study, __doc__)

if __name__ == "__main__":
    main()
