"""The network over which broadcasts travel: which nodes are joined, how fast, and how surely."""

from collections.abc import Hashable, Mapping
from typing import Any

import networkx as nx
import numpy as np
from matplotlib import colormaps, patheffects
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap

from aimd_des.channel.topology.attributes import Graph, edge_number, known_node, simple_graph
from aimd_des.plots import style
from aimd_des.plots.panel import panel
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_MOST_NAMES = 30
# Beyond this many nodes, springs between all pairs take too long.
_MOST_SPRINGS = 300
# Up to which loss, with which line, how wide, and what the legend says.
_LOSSES = (
    (0.0, "-", 2.8, "no loss"),
    (0.05, "-", 1.8, "loss up to 5 %"),
    (0.2, "--", 1.8, "loss up to 20 %"),
    (1.0, ":", 1.8, "loss above 20 %"),
)

_NAME: dict[str, Any] = {
    "textcoords": "offset points",
    "fontsize": "x-small",
    "color": "0.25",
    "zorder": 5,
    "path_effects": [patheffects.withStroke(linewidth=2.0, foreground="white")],
}
# The palest colours are left out: on white, thin lines in them are not seen.
_LATENCIES = ListedColormap(colormaps["viridis_r"](np.linspace(0.15, 1.0, 256)))

Places = Mapping[Hashable, FloatArray]


@panel
def network_map(
    axes: Axes, graph: Graph, *, root: Hashable = None, latency: str = "latency", loss: str = "loss"
) -> Axes:
    """Draw a network with its latencies as colours and its losses as kinds of lines.

    Parameters
    ----------
    axes : Axes
        Where to draw; the colour bar takes some of its room.
    graph : networkx.Graph or networkx.DiGraph
        As `aimd_des.topology` takes and makes it.  Both directions between two nodes of a directed graph are
        drawn, each on its right-hand side.
    root : node, optional
        The control unit's; default: ``graph.graph["root"]``.
    latency, loss : str
        The attributes of the edges.

    Raises
    ------
    InputError
        If the graph has no such root, or an edge has no latency or loss.

    Notes
    -----
    Nodes stand where their attribute `pos` says or, in a grid, in their row and column; a tree is drawn in
    circles around its root, anything else as if its edges were springs.  A graph is always drawn alike.
    """
    graph = simple_graph("graph", graph)
    if root is None and "root" not in graph.graph:
        raise InputError("root: not given, and the graph names none; say which node is the control unit's")
    start = graph.graph["root"] if root is None else root
    known_node("root", start, graph)
    axes.set_aspect("equal")
    if not graph.number_of_edges():
        return style.note(axes, "This network has no edges.")
    places = _places(graph, start)
    _draw_edges(axes, graph, places, latency, loss)
    spots = np.array([places[node] for node in graph if node != start]).reshape(-1, 2)
    size = float(np.clip(4000.0 / len(graph), 6.0, 90.0))
    x, y = spots.T
    axes.scatter(x, y, size, "white", edgecolors="black", linewidths=0.8, zorder=3, label="agent or relay")
    x, y = places[start]
    axes.scatter(x, y, 150.0, "black", marker="s", edgecolors="white", zorder=4, label="control unit")
    if len(graph) <= _MOST_NAMES:
        _name_nodes(axes, graph, places, start)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    axes.margins(0.08)
    return axes


def _name_nodes(axes: Axes, graph: Graph, places: Places, start: Hashable) -> None:
    for node in graph:
        if node != start:
            x, y = places[node].tolist()
            axes.annotate(style.plain(str(node)), (x, y), (6, 5), **_NAME)


def _draw_edges(axes: Axes, graph: Graph, places: Places, latency: str, loss: str) -> None:
    """Draw the edges in classes of loss, all with one scale of colours for latency."""
    edges = [
        (u, v, edge_number("", (u, v), data, latency, "latency"), edge_number("", (u, v), data, loss, "loss"))
        for u, v, data in graph.edges(data=True)
    ]
    late = np.array([edge[2] for edge in edges])
    lost = np.array([edge[3] for edge in edges])
    shift = 0.008 * float(np.ptp(list(places.values()), axis=0).max()) if graph.is_directed() else 0.0
    lines = np.array([_line(places[u], places[v], shift) for u, v, _, _ in edges])
    bounds = (float(late.min()), float(late.max()))
    below = -1.0
    for upper, form, width, word in _LOSSES:
        here = (lost > below) & (lost <= upper)
        below = upper
        if not here.any():
            continue
        drawn = LineCollection(
            list(lines[here]), linestyles=form, linewidths=width, cmap=_LATENCIES, zorder=2
        )
        drawn.set_array(late[here])
        drawn.set_clim(*bounds)
        axes.add_collection(drawn)
        axes.plot([], [], form, color="0.35", linewidth=width, label=word)
    style.colour_bar(axes, drawn, "latency of an edge (units of time)")


def _line(tail: FloatArray, head: FloatArray, shift: float) -> FloatArray:
    """Give the two ends of an edge, moved to the right of the way."""
    along = head - tail
    length = float(np.hypot(*along)) or 1.0
    aside = shift / length * np.array([along[1], -along[0]])
    return np.array([tail + aside, head + aside])


def _places(graph: Graph, root: Hashable) -> Places:
    """Say where the nodes stand, always alike."""
    given = nx.get_node_attributes(graph, "pos")
    if len(given) == len(graph) and all(len(place) == 2 for place in given.values()):
        return {node: np.asarray(place, dtype=np.float64) for node, place in given.items()}
    if all(isinstance(node, tuple) and len(node) == 2 for node in graph):
        return {(row, column): np.array([column, -row], dtype=np.float64) for row, column in graph}
    plain: Graph = nx.Graph(graph.edges)
    plain.add_nodes_from(graph)
    if nx.is_tree(plain):
        return _circles(plain, root)
    if len(plain) <= _MOST_SPRINGS:
        return dict(nx.kamada_kawai_layout(plain))
    return dict(nx.spring_layout(plain, seed=0))


def _circles(tree: Graph, root: Hashable) -> Places:
    """Put every level of a tree on a circle around the root, and a node amid the leaves behind it."""
    depth = nx.single_source_shortest_path_length(tree, root)
    angle: dict[Hashable, float] = {}
    leaves = [node for node in nx.dfs_preorder_nodes(tree, root) if tree.degree(node) == 1 and node != root]
    for place, leaf in enumerate(leaves):
        angle[leaf] = 2.0 * np.pi * place / len(leaves)
    for node in nx.dfs_postorder_nodes(tree, root):
        behind = [angle[near] for near in tree[node] if depth[near] > depth[node]]
        if behind:
            angle[node] = (min(behind) + max(behind)) / 2.0
    return {node: depth[node] * np.array([np.sin(angle[node]), np.cos(angle[node])]) for node in tree}
