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

from aimd_des import BroadcastChannel, Problem, Recording, Result, theory, topology
from aimd_des.compensation import EstimatedLoss, KnownLoss
from aimd_des.loss import Bernoulli, CommonMode, GilbertElliott, Loss
from aimd_des.lowlevel import Channel, FloatArray
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, late, quietly, run_draws, run_late, sensed
from scenarios.common.systems import memory_alone, optimum, spread
from scenarios.common.tables import beside_theory, over_draws, pick, shown, table_of

HOLD_OFF = 0.25  # r, in units of time
OWN, COMMON = "each link for itself", "all links together"
# Of the total, for what is rounding and no excess.
_ROUNDING = 1e-9
# What is exceeded for so much of the time is a high level, however long the run.
_RARE = 0.01
# A Gamma so small that no response saturates, however much an agent compensates.
_GENTLE = 1 / 360


class Bursts(NamedTuple):
    """What is run: losses with a mean and a mean length of bursts, 0 for none."""

    links: str  # whether each has bursts of its own
    # p, and B in units of time.
    loss: float
    burst: float
    # The end, and the time from which the run is measured.
    length: float
    start: float

    def channel(self, n: int) -> Channel:
        """Make the channel: links that are one are a single edge, from which a relay reaches all agents."""
        if self.burst == 0.0:
            model = CommonMode(self.loss) if self.links == COMMON else Bernoulli(self.loss)
            return BroadcastChannel(loss=model)
        if self.links == OWN:
            return BroadcastChannel(loss=GilbertElliott(self.loss, self.burst))
        graph: Any = nx.Graph()
        graph.add_edge("unit", "relay", latency=0.0, loss=self.loss)
        graph.add_edges_from((("relay", agent) for agent in range(n)), latency=0.0, loss=0.0)
        bursty = partial(GilbertElliott, mean_burst=self.burst)
        return topology.tree(graph, root="unit", agents=list(range(n)), loss=bursty)


def run_one(run: Bursts, draw: int, seed: int, looks: FloatArray) -> Result:
    """Run, with total demand recorded at `looks`."""
    problem, span = memory_alone(draw=draw), (run.start, run.length)
    return run_late(problem, HOLD_OFF, run.channel(problem.n_agents), span, seed, looks)


def measure(run: Bursts, draw: int, seed: int) -> dict[str, float]:
    """Run, and measure demand over the capacity after the start.

    Beyond what can be held responses are cut off at probability 1.
    """
    result = run_one(run, draw, seed, np.arange(run.start, run.length, HOLD_OFF))
    problem, found = result.problem, late(result, run.start)
    times = result.signals_sent.time
    times = times[times >= run.start]
    # A signal that did not suffice is repeated a hold-off later: so long as it is, demand is above.
    again = np.append(False, np.diff(times) <= HOLD_OFF * (1.0 + 1e-9))
    begun = int((again[1:] & ~again[:-1]).sum())
    level = result.observations.total_demand[:, 0] / problem.capacity[0] - 1.0
    turns = (level[1:-1] > _ROUNDING) & (level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])
    return {
        "signals": found.signals,  # per unit of time
        "time_above": found.time_above,
        "excess": found.excess,  # in the mean, while demand is above the capacity
        "high": 1.0 + float(np.quantile(level, 1.0 - _RARE)),
        "peak": found.peak,
        # Mean excess where total demand turns back above the capacity, seen once in a hold-off.
        "run_away_peak": float(level[1:-1][turns].mean()) if turns.any() else np.nan,
        # Mean duration of excursions above the capacity, in units of time.
        "excursion": float(found.time_above * (run.length - run.start) / begun) if begun else np.nan,
        "smallest": share_of_smallest(problem, found.average),
        _OFF: float(distance(problem, found.average)[0]),
    }


def share_of_smallest(problem: Problem, allocation: FloatArray) -> float:
    """Compute what the third of the agents holds that the optimum gives least of the one resource."""
    order = np.argsort(optimum(problem))
    return float(allocation[order[: problem.n_agents // 3], 0].sum() / allocation.sum())


class Answer(NamedTuple):
    """What is run with losses that are spread from 0 to twice a mean, and agents that compensate for them."""

    links: str  # the way, in that column of the table: "nothing", "known loss", or so many bits of a number
    loss: float
    burst: float
    length: float


def answer(run: Answer, draw: int, seed: int) -> dict[str, float]:
    """Run, and measure how far averages are from the optimum for what they use."""
    losses, way = spread(0.0, 2.0 * run.loss), run.links
    model: Loss = GilbertElliott(losses, run.burst) if run.burst > 0.0 else Bernoulli(losses)
    known = KnownLoss(losses) if way == "known loss" else None
    problem = memory_alone(normalization=_GENTLE, draw=draw)
    simulation = sensed(
        problem,
        0.1,
        channel=BroadcastChannel(loss=model),
        compensation=EstimatedLoss(int(way[0])) if way.endswith("bits") else known,
        seed=seed,
        recording=Recording(demand="end", overshoot=False),
    )
    return {_OFF: float(distance(problem, quietly(simulation, run.length).average_at_end)[0])}


_LOSS = 0.2
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
    """How much is run, by default at the full size."""

    draws: int = 10
    losses: tuple[float, ...] = (0.1, 0.2, 0.4)
    # n p alpha B / C, the capacity that is held by links that are bad.
    held: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2, 0.3, 0.45, 0.7)
    bursts: tuple[float, ...] = (0.0, 1.0, 3.0, 10.0, 20.0, 40.0, 80.0)  # of all links together
    start: float = 1000.0
    ends: tuple[float, ...] = (4000.0, 13_000.0)
    ways: tuple[str, ...] = ("nothing", "known loss", "5 bits", "8 bits")
    means: tuple[float, ...] = (0.25, 0.4)
    answered: tuple[float, ...] = (0.0, 10.0, 40.0)  # mean bursts under which agents compensate
    until: float = 5000.0  # of those runs


_QUICK = _Size(
    draws=2,
    losses=(0.1, 0.4),
    held=(0.0, 0.2),
    bursts=(0.0, 20.0),
    start=100.0,
    ends=(400.0,),
    ways=("known loss", "5 bits"),
    means=(0.25,),
    answered=(0.0, 10.0),
    until=400.0,
)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with bursts of loss of many lengths, on each link and on all."""
    size = _QUICK if quick else _Size()
    links = [(OWN, loss, _burst(loss, held)) for loss in size.losses for held in size.held]
    links += [(COMMON, _LOSS, burst) for burst in size.bursts]
    cases = [Bursts(*link, until, size.start) for link in links for until in size.ends]
    answers = [
        Answer(way, mean, burst, size.until)
        for way in size.ways
        for mean in size.means
        for burst in (size.answered if mean == size.means[0] else size.answered[:1])
    ]
    jobs = partial(run_draws, draws=size.draws, replications=1, seed=seed, quick=quick, runs=runs)
    pairs: list[Any] = [*jobs(measure, cases), *jobs(answer, answers)]
    table = table_of(pairs, _LABELS, seed, lambda run, draw: _expected(run.links, run.loss, run.burst, draw))
    settings = {"seed": seed, **size._asdict()}
    printed = shown(table[table["measure"].isin(_PRINTED)], [*_LABELS, "measure"])
    drawn = {"burst_loss": partial(_figure, table, size, seed)}
    return Finding("burst_loss", settings, table, printed, _findings(table, size), drawn)


def _burst(loss: float, held: float) -> float:
    """Compute the mean length of bursts with which bad links hold a part of the capacity."""
    return round(held / (loss * _GROWTH), 6)


@lru_cache(maxsize=1024)
def _expected(links: str, loss: float, burst: float, draw: int) -> dict[str, float]:
    """Predict what there is a formula for, and what does not depend on the length of a run."""
    problem = memory_alone(draw=draw)
    if links == COMMON and burst >= _LONG:
        known = theory.burst_runaway(problem, loss, burst, hold_off=HOLD_OFF, span=_LONG)
        if known is None:
            return {}
        names = ("time_above", "excess", "run_away_peak", "excursion")
        found = {name: getattr(known, name) for name in names}
        return {**found, "smallest": share_of_smallest(problem, known.allocation), _OFF: 0.0}
    if links != OWN:
        return {}
    allocation, signals = theory.burst_shares(problem, loss, burst)
    if not signals * HOLD_OFF < 1.0:  # also where it is not a number
        return {}
    away = float(distance(problem, allocation)[0])
    return {"signals": signals, "smallest": share_of_smallest(problem, allocation), _OFF: away}


def _figure(table: pd.DataFrame, size: _Size, seed: int) -> Figure:
    figure, panels = figures.panels(2, 3, (14.5, 8.4))
    table = table.assign(at=np.maximum(table["burst"], _NONE), held=table["loss"] * _GROWTH * table["burst"])
    longest = table[table["length"] == size.ends[-1]]
    own, common = pick(longest, links=OWN), pick(longest, links=COMMON)
    _draw_demand(panels[0], seed)
    _draw_levels(panels[1], common)
    alike = pick(own, loss=_LOSS if _LOSS in size.losses else size.losses[0], measure=_OFF)
    shares = pd.concat([alike, pick(common, measure=_OFF)])
    figures.curves(panels[2], "at", "links", shares, scale=100.0)
    figures.named(panels[2], "theory")
    _bursts(panels[2], "(c) Shares", "distance from the optimum (%)")
    x = "n p α B / C, the capacity that bad links hold"
    figures.curves(panels[3], "held", "loss", pick(own, measure="time_above"), "loss {:g}", scale=100.0)
    title, y = "(d) Bursts of each link: overload", "time above the capacity (%)"
    figures.dress(panels[3], title, x, y, ylim=(-3.0, 103.0))
    figures.curves(panels[4], "held", "loss", pick(own, measure="smallest"), "loss {:g}", scale=100.0)
    figures.named(panels[4], "theory")
    title, y = "(e) Bursts of each link level the shares", "memory held by the 20 smallest (%)"
    figures.dress(panels[4], title, x, y)
    answers = pick(table[table["links"].isin(size.ways)], loss=size.means[0])
    figures.curves(panels[5], "at", "links", answers, scale=100.0, linestyle="-", linewidth=1.0)
    title = f"(f) Making good for losses from 0 to {2 * size.means[0]:g}"
    _bursts(panels[5], title, "distance from the optimum (%)", ylim=(0.0, None))
    figures.legends(panels)
    return figure


def _draw_demand(axes: Axes, seed: int) -> None:
    """Draw total demand of one run each, with the same random numbers."""
    for place, links in enumerate((OWN, COMMON)):
        run = Bursts(links, _LOSS, _SHOWN, 1200.0, 200.0)
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
    levels = common[common["measure"].isin(names)].copy()
    levels.loc[levels["measure"] == "run_away_peak", ["mean", "theory"]] += 1.0  # it is above the capacity
    figures.curves(axes, "at", "measure", levels.replace({"measure": names}))
    figures.named(axes, "theory")
    figures.level(axes, 1.0)
    _bursts(axes, "(b) In common: demand runs away", "total demand over capacity", ylim=(0.0, None))


def _findings(table: pd.DataFrame, size: _Size) -> list[str]:
    end, some = size.ends[-1], size.held[3] if len(size.held) > 3 else size.held[-1]
    own_links = partial(over_draws, table, links=OWN, length=end)
    all_links = partial(beside_theory, table, links=COMMON, length=end)

    def own(measured: str, held: float) -> str:
        bursts = [(loss, _burst(loss, held)) for loss in size.losses]
        return ", ".join(own_links(100.0, 1, loss=loss, burst=b, measure=measured) for loss, b in bursts)

    def common(measured: str, burst: float, scale: float = 1.0, digits: int = 2, **length: float) -> str:
        return all_links(scale, digits, burst=burst, measure=measured, **length)

    def made_good(mean: float, burst: float) -> str:
        off = partial(over_draws, table, 100.0, 1, loss=mean, burst=burst, measure=_OFF)
        return ", ".join(f"{off(links=way)} with {way}" for way in size.ways)

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
