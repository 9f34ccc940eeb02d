"""One run with bursts of loss, on each link for itself or on all together, and what is measured of it."""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import networkx as nx
import numpy as np

from aimd_des import BroadcastChannel, Problem, Result, solve_optimum, topology
from aimd_des.loss import Bernoulli, CommonMode, GilbertElliott
from aimd_des.lowlevel import Channel, FloatArray
from scenarios.common.measure import late, run_late

# Of the total, for what is rounding and no excess.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Bursts:
    """What is run: losses with a mean and a mean length of bursts, 0 for none."""

    problem: Problem  # one resource
    common: bool  # whether all links are one
    # p, and B in units of time.
    loss: float
    burst: float
    hold_off: float  # r, in units of time
    # The end, and the time from which the run is measured.
    until: float
    start: float

    def channel(self) -> Channel:
        """Make the channel: links that are one are a single edge, from which a relay reaches everybody."""
        if self.burst == 0.0:
            model = CommonMode(self.loss) if self.common else Bernoulli(self.loss)
            return BroadcastChannel(loss=model)
        if not self.common:
            return BroadcastChannel(loss=GilbertElliott(self.loss, self.burst))
        n = self.problem.n_agents
        graph: Any = nx.Graph()
        graph.add_edge("unit", "relay", latency=0.0, loss=self.loss)
        graph.add_edges_from((("relay", agent) for agent in range(n)), latency=0.0, loss=0.0)
        bursty = partial(GilbertElliott, mean_burst=self.burst)
        return topology.tree(graph, root="unit", agents=list(range(n)), loss=bursty)


class Outcome(NamedTuple):
    """What is measured of one run after its start; demand is over the capacity."""

    # Signals per unit of time, mean of total demand, its highest, share of time above the capacity, and
    # mean of what is above it.
    signals: float
    utilisation: float
    peak: float
    time_above: float
    excess: float
    # Mean excess where total demand turns back above the capacity, seen once in a hold-off; NaN if it
    # never did.
    run_away_peak: float
    # Mean duration of excursions above the capacity, in units of time; NaN if there were none.
    excursion: float
    # Share of the total that the third of the agents with the smallest optimal allocations holds.
    smallest: float
    average: FloatArray  # (n, 1): in units of the resource


def run_one(run: Bursts, seed: int, looks: FloatArray) -> Result:
    """Run, with total demand recorded at `looks`."""
    span = run.start, run.until
    return run_late(run.problem, run.hold_off, run.channel(), span, seed, looks)


def measure(run: Bursts, seed: int) -> Outcome:
    """Run and measure; beyond what can be held responses are cut off at probability 1."""
    result = run_one(run, seed, np.arange(run.start, run.until, run.hold_off))
    found = late(result, run.start)
    times = result.signals_sent.time
    times = times[times >= run.start]
    # A signal that did not suffice is repeated a hold-off later: so long as it is, demand is above.
    again = np.append(False, np.diff(times) <= run.hold_off * (1.0 + 1e-9))
    begun = int((again[1:] & ~again[:-1]).sum())
    level = result.observations.total_demand[:, 0] / run.problem.capacity[0] - 1.0
    turns = (level[1:-1] > _ROUNDING) & (level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])
    return Outcome(
        **found._asdict(),
        run_away_peak=float(level[1:-1][turns].mean()) if turns.any() else np.nan,
        excursion=float(found.time_above * (run.until - run.start) / begun) if begun else np.nan,
        smallest=share_of_smallest(run.problem, found.average),
    )


def share_of_smallest(problem: Problem, allocation: FloatArray) -> float:
    """Compute what the third of the agents holds that the optimum gives least of the one resource."""
    order = np.argsort(solve_optimum(problem).allocation[:, 0])
    return float(allocation[order[: problem.n_agents // 3], 0].sum() / allocation.sum())
