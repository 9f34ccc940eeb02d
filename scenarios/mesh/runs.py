"""Meshes of cameras with losses on their edges, their channels, and what is measured of one run over one."""

from functools import lru_cache
from typing import Any, NamedTuple

import networkx as nx
import numpy as np

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    Recording,
    Simulation,
    solve_optimum,
    theory,
    topology,
)
from aimd_des.compensation import KnownLoss
from aimd_des.loss import Bernoulli
from aimd_des.lowlevel import Channel, FloatArray
from scenarios.common.measure import distance, quietly
from scenarios.common.systems import memory_alone

TREE, OWN = "shortest-path tree", "own links, as lossy as the tree"
THRICE, FLOOD, KNOWN = "tree, every edge sent three times", "flooding", "tree, agents know their loss"
WAYS = (TREE, THRICE, FLOOD, KNOWN, OWN)

N = 60
HOLD_OFF = 0.5
#: Greatest distance of neighbours, in sides of the square.
RADIUS = 0.2
_LATENCY_PER_DISTANCE = 0.5
# So many seeds are tried for each draw of a network in which everybody is within reach.
_SEEDS_A_DRAW = 1_000
_COPIES = 3
# Looks at the total, five of which fall into a hold-off.
_LOOKS = 0.1


@lru_cache
def mesh(draw: int, longest_loss: float) -> Any:
    """Scatter cameras over a square around the control unit, node 0, in a graph of networkx.

    The loss on an edge grows with the square of its length, to `longest_loss` on one as long as the radius.
    """
    for seed in range(_SEEDS_A_DRAW * draw, _SEEDS_A_DRAW * (draw + 1)):
        graph: Any = topology.random_geometric(
            N, RADIUS, latency_per_distance=_LATENCY_PER_DISTANCE, seed=seed
        )
        if nx.is_connected(graph):
            break
    for _, _, edge in graph.edges(data=True):
        edge["loss"] = longest_loss * (edge["latency"] / (_LATENCY_PER_DISTANCE * RADIUS)) ** 2
    return graph


def branches(graph: Any) -> Any:
    """Keep all nodes, and the edges of the tree of shortest paths."""
    paths = nx.single_source_dijkstra_path(graph, 0, weight="latency")
    tree = graph.copy()
    tree.remove_edges_from(list(graph.edges))
    for path in paths.values():
        if len(path) > 1:
            edge = path[-2], path[-1]
            tree.add_edge(*edge, **graph.edges[edge])
    return tree


class Statistics(NamedTuple):
    """How many copies arrive, and how late; arrays have shape (n,)."""

    # Probability of arrival, and the mean latency of what arrives, in units of time: exact for a tree,
    # estimated for a flood.
    delivery: FloatArray
    latency: FloatArray
    transmissions: float  # copies that are sent over edges, for each broadcast


@lru_cache
def statistics(way: str, draw: int, longest_loss: float, broadcasts: int = 4_000) -> Statistics:
    """Compute what becomes of broadcasts; for a flood, estimate it from so many.

    A node sends to all its neighbours in what it forwards over, but not back to the control unit.
    """
    graph = mesh(draw, longest_loss)
    if way == FLOOD:
        known = topology.flood(graph).statistics(broadcasts, seed=0)
        onward = [graph.degree(node) - (0 in graph[node]) for node in graph]
    else:
        copies, used = _COPIES if way == THRICE else 1, branches(graph)
        known = _tree(graph, copies).statistics()
        depth = nx.single_source_shortest_path_length(used, 0)
        onward = [copies * sum(depth[other] > depth[node] for other in used[node]) for node in used]
    delivery = known["delivery"].to_numpy(dtype=np.float64)
    latency = known["latency_mean"].to_numpy(dtype=np.float64)
    return Statistics(delivery, latency, float(np.append(1.0, delivery) @ np.array(onward, dtype=np.float64)))


def _tree(graph: Any, copies: int) -> topology.TreeChannel:
    """Send every copy so many times over each edge: it is lost if all are."""
    return topology.tree(graph, loss=lambda p: Bernoulli(p**copies))


class Case(NamedTuple):
    """How broadcasts travel, the loss as of `mesh`, and the end in units of time."""

    way: str
    longest_loss: float
    until: float

    @property
    def start(self) -> float:
        """From when on the run is measured."""
        return self.until / 4.0

    def channel(self, draw: int) -> Channel:
        """Make the channel; own links have the tree's probabilities and latencies, and share nothing."""
        graph = mesh(draw, self.longest_loss)
        if self.way == FLOOD:
            return topology.flood(graph)
        if self.way == OWN:
            known = statistics(TREE, draw, self.longest_loss)
            return BroadcastChannel(latency=known.latency, loss=1.0 - known.delivery)
        return _tree(graph, _COPIES if self.way == THRICE else 1)


class Outcome(NamedTuple):
    """What is measured of one run, after its start but for averages."""

    signals: float  # per unit of time
    sent: float  # transmissions over edges per unit of time
    utilisation: float
    high: float  # what total demand is below for 99 % of the time, over the capacity
    above: float  # share of the time above the capacity
    from_plain: float
    from_reweighted: float
    # Of all cameras: share over that of the optimum for what is used, and probability of delivery.
    least: float
    most: float
    least_delivery: float
    saturated: float  # share of the responses with a probability above 1
    transmissions: float  # copies over edges for each broadcast


def measure(case: Case, draw: int, seed: int) -> Outcome:
    """Run and measure, with a draw of costs and network."""
    problem, known = memory_alone(draw=draw), statistics(case.way, draw, case.longest_loss)
    simulation = Simulation(
        problem,
        dynamics="continuous",
        control_unit=Crossing(HOLD_OFF),
        channel=case.channel(draw),
        agents=Fleet,
        compensation=KnownLoss(1.0 - known.delivery) if case.way == KNOWN else None,
        seed=seed,
        recording=Recording(demand=np.arange(case.start, case.until, _LOOKS), overshoot=False),
    )
    result = quietly(simulation, case.until)
    signals = float((result.signals_sent.time >= case.start).sum() / (case.until - case.start))
    total = result.observations.total_demand[:, 0] / problem.capacity[0]
    average = result.average_at_end
    share = (average / solve_optimum(problem, capacity=average.sum(axis=0)).allocation)[:, 0]
    heard = np.ones(N) if case.way == KNOWN else known.delivery
    return Outcome(
        signals,
        signals * known.transmissions,
        float(total.mean()),
        float(np.quantile(total, 0.99)),
        float((total > 1.0).mean()),
        float(distance(problem, average)[0]),
        float(distance(problem, average, heard)[0]),
        float(share.min()),
        float(share.max()),
        float(known.delivery.min()),
        float(result.account.saturated.sum() / result.account.responses.sum()),
        known.transmissions,
    )


def expected(case: Case, draw: int) -> dict[str, float]:
    """Predict what there is a formula for: signals per unit of time, and how far shares are shifted."""
    problem, known = memory_alone(draw=draw), statistics(case.way, draw, case.longest_loss)
    best = theory.reweighted_optimum(problem, np.ones(N) if case.way == KNOWN else known.delivery)
    alpha, beta, gamma = problem.increase[0], problem.decrease[0], problem.normalization
    signals = theory.signal_rate(alpha, beta, gamma, best.multipliers)
    return {"signals": float(signals[0]), "from_plain": float(distance(problem, best.allocation)[0])}
