"""From a graph to the arcs over which broadcasts travel, and their numbers.

An arc is one direction of an edge; its number is the address of its draws.  First come the arcs of the
shortest-path tree: those into agents 0, 1, ..., n - 1, then those into the relays on the way to them.
The other arcs follow.  So a tree and a flood over the same graph draw the same numbers for the arcs
that they share, and the arc into agent i draws what agent i draws in a `BroadcastChannel`.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np

from aimd_des.channel.network_kernel import NetworkTable, network_table
from aimd_des.channel.topology.attributes import Graph, edge_number, known_node, simple_graph
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray, IntArray

Arc = tuple[int, int]

# So many agents out of reach are named, of more the first ones.
_NAMED = 10


@dataclass(frozen=True, eq=False)
class Routes:
    """The part of a graph over which a channel sends."""

    agents: tuple[Any, ...]  # the node of each agent, as the graph names it
    hops: IntArray  # (n,): edges on the shortest path to each agent
    # (a,): from which node each arc leads to which; nodes are numbered in the order of their distance from
    # the control unit, which is node 0.
    tail: IntArray
    head: IntArray
    node: IntArray  # (n,): number of each agent's node
    # (a,): attributes of each arc's edge, in units of time and as a probability.
    latency: FloatArray
    loss: FloatArray

    def __repr__(self) -> str:
        agents, arcs = len(self.agents), len(self.head)
        return f"<{agents:,} agents, {arcs:,} arcs, at most {self.hops.max(initial=0):,} hops>"

    def table(self) -> NetworkTable:
        """Lay out the network for compiled code."""
        return network_table(self.tail, self.head, self.node)


class _Reached(NamedTuple):
    """How the shortest-path tree reaches a node."""

    parent: int
    hops: int


def find_routes(graph: object, root: Hashable, agents: Sequence[Any] | None, *, only_tree: bool) -> Routes:
    """Find the arcs that broadcasts can take."""
    clean = simple_graph("graph", graph)
    names = list(clean)
    position = {name: place for place, name in enumerate(names)}
    start = position[_root(clean, root)]
    wanted = [position[name] for name in _agents(clean, names[start], agents)]
    arcs = _arcs(clean, position)
    reached = _shortest_paths(arcs, start)
    unreached = [names[node] for node in wanted if node not in reached]
    if unreached:
        raise _out_of_reach(unreached, names[start])
    branches = _branches(reached, wanted)
    rest: list[Arc] = []
    if not only_tree:
        taken = set(branches)
        rest = sorted(arc for arc in arcs if arc[0] in reached and arc[1] != start and arc not in taken)
    chosen = [*branches, *rest]
    used = {start, *(head for _, head in chosen)}
    rank = {node: number for number, node in enumerate(node for node in reached if node in used)}
    return Routes(
        agents=tuple(names[node] for node in wanted),
        hops=np.array([reached[node].hops for node in wanted]),
        tail=np.array([rank[tail] for tail, _ in chosen]),
        head=np.array([rank[head] for _, head in chosen]),
        node=np.array([rank[node] for node in wanted]),
        latency=np.array([arcs[arc][0] for arc in chosen]),
        loss=np.array([arcs[arc][1] for arc in chosen]),
    )


def _root(graph: Graph, given: Hashable) -> Any:
    root = graph.graph.get("root") if given is None else given
    if root is None:
        remedy = 'name the control unit\'s node, or set graph.graph["root"]'
        raise InputError.of("root", root, f"one of the {len(graph)} nodes of the graph", remedy)
    known_node("root", root, graph)
    return root


def _agents(graph: Graph, root: Hashable, given: Sequence[Any] | None) -> list[Any]:
    agents = (
        [node for node in graph if node != root]
        if given is None
        else validation.elements("agents", given, "a list of nodes")
    )
    if not agents:
        raise InputError.of("agents", agents, "at least one node")
    seen: dict[Any, int] = {}
    for i, node in enumerate(agents):
        known_node(f"agents[{i}]", node, graph)
        if node == root:
            raise InputError.of(
                f"agents[{i}]", node, "another node than the root, which is the control unit's"
            )
        if seen.setdefault(node, i) != i:
            raise InputError.of(f"agents[{i}]", node, f"another node than agents[{seen[node]}]")
    return agents


def _arcs(graph: Graph, position: dict[Any, int]) -> dict[Arc, tuple[float, float]]:
    """Read latency and loss of both directions of every edge, or of the one that it has."""
    arcs = {}
    for u, v, data in graph.edges(data=True):
        numbers = (
            edge_number("", (u, v), data, "latency", "latency"),
            edge_number("", (u, v), data, "loss", "loss"),
        )
        # An edge from a node to itself brings no copy earlier.
        if u != v:
            arcs[position[u], position[v]] = numbers
            if not graph.is_directed():
                arcs[position[v], position[u]] = numbers
    return arcs


def _shortest_paths(arcs: dict[Arc, tuple[float, float]], start: int) -> dict[int, _Reached]:
    """Find the tree of shortest paths; nodes come in the order of their distance.

    Of paths of equal latency the one with fewest hops is taken, of several such the one whose last node
    but one comes first in the graph.  With hops, edges without latency make no circles.
    """
    out: dict[int, list[tuple[int, float]]] = {}
    for (tail, head), (latency, _) in arcs.items():
        out.setdefault(tail, []).append((head, latency))
    reached: dict[int, _Reached] = {}
    heap = [(0.0, 0, -1, start)]
    while heap:
        distance, hops, parent, node = heappop(heap)
        if node in reached:
            continue
        reached[node] = _Reached(parent, hops)
        for head, latency in out.get(node, ()):
            if head not in reached:
                heappush(heap, (distance + latency, hops + 1, node, head))
    return reached


def _branches(reached: dict[int, _Reached], agents: list[int]) -> list[Arc]:
    """Return the arcs of the tree that lead to an agent: those into agents, then those into relays."""
    used: set[int] = set()
    for agent in agents:
        node = agent
        while node not in used and reached[node].hops:
            used.add(node)
            node = reached[node].parent
    return [(reached[node].parent, node) for node in [*agents, *sorted(used.difference(agents))]]


def _out_of_reach(agents: list[Any], root: Hashable) -> InputError:
    named = ", ".join(map(repr, agents[:_NAMED]))
    more = f" and {len(agents) - _NAMED} more" if len(agents) > _NAMED else ""
    return InputError(
        f"agents {named}{more}: no path leads there from the root {root!r}; "
        "join them to the rest by edges, or leave them out by `agents`"
    )
