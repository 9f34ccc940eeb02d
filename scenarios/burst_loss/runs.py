"""One run with bursts of loss, on each link for itself or on all together, and what is measured of it."""

from functools import partial
from typing import Any, NamedTuple

import networkx as nx
import numpy as np

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    Problem,
    Recording,
    Result,
    Simulation,
    solve_optimum,
    topology,
)
from aimd_des.compensation import Compensation, EstimatedLoss, KnownLoss
from aimd_des.loss import Bernoulli, CommonMode, GilbertElliott, Loss
from aimd_des.lowlevel import Channel, FloatArray
from scenarios.common.measure import distance, late, quietly, run_late
from scenarios.common.systems import memory_alone, spread

# Of the total, for what is rounding and no excess.
_ROUNDING = 1e-9
# What is exceeded for so much of the time is a high level, however long the run.
_RARE = 0.01
# A Gamma so small that no response saturates, however much an agent makes good for.
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
        """Make the channel: links that are one are a single edge, from which a relay reaches everybody."""
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
    """What is run with losses that are spread from 0 to twice a mean, and agents that make good for them."""

    way: str  # "nothing", "known loss", or so many bits of a running number
    mean: float
    burst: float
    until: float

    @property
    def compensation(self) -> Compensation | None:
        """How agents make good for loss."""
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
    simulation = Simulation(
        problem,
        dynamics="continuous",
        control_unit=Crossing(0.1),
        channel=BroadcastChannel(loss=model),
        compensation=run.compensation,
        agents=Fleet,
        seed=seed,
        recording=Recording(demand="end", overshoot=False),
    )
    return float(distance(problem, quietly(simulation, run.until).average_at_end)[0])
