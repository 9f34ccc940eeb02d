"""Graphs that are made by a rule: networkx makes the edges, and each gets its latency and its loss."""

import math
from collections.abc import Hashable
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.channel.parameters import LONGEST
from aimd_des.channel.topology.attributes import HIGHEST, Graph, known_node
from aimd_des.utils import rng, validation
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.parts import built_in
from aimd_des.utils.rng import Purpose

# Positions stand apart from the numbers that problems of the same seed are made from.
_LANE = 1


def _finished(graph: Graph, root: Hashable, **quantities: npt.ArrayLike) -> Graph:
    """Give every edge its numbers, and the graph its root."""
    import networkx as nx

    graph.graph["root"] = root
    for name, given in quantities.items():
        value = validation.per_agent(name, given, low=0.0, high=HIGHEST[name])
        validation.fits(name, value, graph.number_of_edges())
        row = np.broadcast_to(value, (graph.number_of_edges(),)).tolist()
        nx.set_edge_attributes(graph, dict(zip(graph.edges, row, strict=True)), name)
    return graph


@built_in("network", "star")
def star(n_agents: int, latency: npt.ArrayLike = 0.0, loss: npt.ArrayLike = 0.0) -> Graph:
    """Join every agent to the control unit by an edge of its own.

    Parameters
    ----------
    n_agents : int
        n; agent i is node i + 1, and the control unit node 0.
    latency : float or array_like, shape (n,)
        Latency of all edges or of each, at least 0, in units of time.
    loss : float or array_like, shape (n,)
        Probability of loss on all edges or on each.

    Returns
    -------
    networkx.Graph
        With n + 1 nodes.
    """
    import networkx as nx

    graph = nx.star_graph(validation.integer("n_agents", n_agents, low=1))
    return _finished(graph, 0, latency=latency, loss=loss)


@built_in("network", "balanced_tree")
def balanced_tree(branching: int, height: int, latency: float = 0.0, loss: float = 0.0) -> Graph:
    """Make a tree in which every node but the leaves has the same number of children.

    Parameters
    ----------
    branching : int
        Children of a node, at least 1; the root is node 0, and levels are numbered one after another.
    height : int
        Levels below the root, at least 1.
    latency : float
        Latency of every edge, at least 0, in units of time.
    loss : float
        Probability of loss on every edge.

    Returns
    -------
    networkx.Graph
        With 1 + branching + branching**2 + ... + branching**height nodes.
    """
    import networkx as nx

    width, depth = (
        validation.integer("branching", branching, low=1),
        validation.integer("height", height, low=1),
    )
    return _finished(nx.balanced_tree(width, depth), 0, **_same(latency, loss))


@built_in("network", "grid")
@described_like(balanced_tree)
def grid(
    rows: int, columns: int, latency: float = 0.0, loss: float = 0.0, *, root: tuple[int, int] = (0, 0)
) -> Graph:
    """Join every node of a rectangle to its two, three or four neighbours.

    Parameters
    ----------
    rows, columns : int
        At least 1 each, and at least 2 nodes; nodes are named (row, column), from (0, 0).
    root : tuple of int
        The control unit's node; default: a corner.

    Returns
    -------
    networkx.Graph
        With rows * columns nodes, row by row.

    Raises
    ------
    InputError
        If a number is outside its range, or the root outside the grid.
    """
    import networkx as nx

    height = validation.integer("rows", rows, low=1)
    width = validation.integer(
        "columns", columns, low=2 if height == 1 else 1, remedy="a node needs a neighbour"
    )
    graph = nx.grid_2d_graph(height, width)
    known_node("root", root, graph)
    return _finished(graph, root, **_same(latency, loss))


@built_in("network", "random_geometric")
@described_like(balanced_tree)
def random_geometric(
    n_agents: int, radius: float, *, latency_per_distance: float, loss: float = 0.0, seed: int
) -> Graph:
    """Scatter agents over the unit square, and join what is near enough.

    The control unit, node 0, stands in the middle; agent i, node i + 1, at random.  The positions of
    the first agents stay what they are when there are more of them.  Some agents may be out of reach:
    a network of n agents is probably connected from a radius of sqrt(2 log(n) / (pi n)) on.

    Parameters
    ----------
    n_agents : int
        n.
    radius : float
        Greatest distance of neighbours, greater than 0; the square has sides of 1.
    latency_per_distance : float
        Latency of an edge over its length, at least 0, in units of time.
    seed : int
        Of the positions, at least 0.

    Returns
    -------
    networkx.Graph
        With n + 1 nodes, each with its place as the attribute `pos`.
    """
    import networkx as nx

    n = validation.integer("n_agents", n_agents, low=1)
    reach = validation.number("radius", radius, low=0.0, low_open=True)
    slowness = validation.number("latency_per_distance", latency_per_distance, low=0.0, high=LONGEST / 2.0)
    key = rng.key(seed, Purpose.PROBLEM)
    x, y = (rng.uniforms(key, 0, axis, n, _LANE).tolist() for axis in (0, 1))
    places = {0: (0.5, 0.5), **dict(enumerate(zip(x, y, strict=True), start=1))}
    graph = nx.random_geometric_graph(n + 1, reach, pos=places)
    # Not math.hypot, whose last bit differs from machine to machine.
    across = [tuple(a - b for a, b in zip(places[u], places[v], strict=True)) for u, v in graph.edges]
    latency = [slowness * math.sqrt(dx * dx + dy * dy) for dx, dy in across]
    return _finished(graph, 0, latency=latency, loss=validation.number("loss", loss, low=0.0, high=1.0))


def _same(latency: float, loss: float) -> dict[str, Any]:
    """Check numbers that all edges share."""
    given = {"latency": latency, "loss": loss}
    return {
        name: validation.number(name, value, low=0.0, high=HIGHEST[name]) for name, value in given.items()
    }
