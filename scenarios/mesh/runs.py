"""A mesh of cameras with losses on its edges, its channels, and what is measured of one run over it."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import networkx as nx
import numpy as np

from aimd_des import BroadcastChannel, Problem, topology
from aimd_des.lowlevel import Channel, FloatArray
from scenarios.common.measure import late, run_late

TREE, FLOOD, OWN = "shortest-path tree", "flooding", "own links, as lossy as the tree"

#: Greatest distance of neighbours, in sides of the square.
RADIUS = 0.2
_LATENCY_PER_DISTANCE = 0.5
# The first of the random networks with this radius in which everybody is within reach.
_NETWORK_SEED = 0


def mesh(n_agents: int, longest_loss: float) -> Any:
    """Scatter cameras over a square around the control unit, node 0, in a graph of networkx.

    The loss on an edge grows with the square of its length, to `longest_loss` on one as long as the radius.
    """
    graph: Any = topology.random_geometric(
        n_agents, RADIUS, latency_per_distance=_LATENCY_PER_DISTANCE, seed=_NETWORK_SEED
    )
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
    # The same from draws.
    sampled_delivery: FloatArray
    sampled_latency: FloatArray
    transmissions: float  # copies that are sent over edges, for each broadcast


def statistics(graph: Any, way: str, broadcasts: int) -> Statistics:
    """Compute, or estimate from so many broadcasts, the statistics of `TREE` or `FLOOD`.

    A node sends to all its neighbours in what it forwards over, but not back to the control unit.
    """
    used = graph if way == FLOOD else branches(graph)
    drawn = topology.flood(used).statistics(broadcasts, seed=0)
    known = drawn if way == FLOOD else topology.tree(graph).statistics()
    delivery = known["delivery"].to_numpy(dtype=np.float64)
    reached = np.append(1.0, delivery)
    if way == FLOOD:
        onward = [used.degree(node) - (0 in used[node]) for node in used]
    else:
        depth = nx.single_source_shortest_path_length(used, 0)
        onward = [sum(depth[other] > depth[node] for other in used[node]) for node in used]
    return Statistics(
        delivery,
        known["latency_mean"].to_numpy(dtype=np.float64),
        drawn["delivery"].to_numpy(dtype=np.float64),
        drawn["latency_mean"].to_numpy(dtype=np.float64),
        float(reached @ np.array(onward, dtype=np.float64)),
    )


@dataclass(frozen=True, eq=False)
class Mesh:
    """What is run."""

    problem: Problem  # one resource
    way: str  # how broadcasts travel
    longest_loss: float  # as of `mesh`
    # Of the control unit; the end, and the time from which the run is measured; in units of time.
    hold_off: float
    until: float
    start: float

    def channel(self) -> Channel:
        """Make the channel; own links have the tree's probabilities and latencies, and share nothing."""
        graph = mesh(self.problem.n_agents, self.longest_loss)
        if self.way == FLOOD:
            return topology.flood(graph)
        tree = topology.tree(graph)
        if self.way == TREE:
            return tree
        known = tree.statistics()
        return BroadcastChannel(
            latency=known["latency_mean"].to_numpy(), loss=1.0 - known["delivery"].to_numpy()
        )


class Outcome(NamedTuple):
    """What is measured of one run after its start."""

    # Signals per unit of time; mean and highest of total demand over the capacity, and the share of time
    # above it.
    signals: float
    utilisation: float
    peak: float
    time_above: float
    average: FloatArray  # (n, 1): in units of the resource
    delivery: FloatArray  # (n,): share of the copies that arrived, over all of the run


def measure(run: Mesh, seed: int) -> Outcome:
    """Run and measure."""
    result = run_late(run.problem, run.hold_off, run.channel(), (run.start, run.until), seed, "end")
    found, account = late(result, run.start), result.account
    delivery = account.delivered[0] / (account.delivered[0] + account.lost[0])
    return Outcome(found.signals, found.utilisation, found.peak, found.time_above, found.average, delivery)
