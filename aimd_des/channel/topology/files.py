"""Networks that were measured: GraphML files, and lists of edges as CSV."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import networkx as nx

from aimd_des.channel.measured import read_columns
from aimd_des.channel.topology.attributes import HIGHEST, Graph, edge_number, known_node, simple_graph
from aimd_des.errors import InputError

__all__ = ["from_edges", "from_graphml"]


def from_graphml(path: str | Path, *, root: str, latency: str = "latency", loss: str = "loss") -> Graph:
    """Read a network from a GraphML file.

    Parameters
    ----------
    path : str or Path
        The file.
    root : str
        Name of the control unit's node, its `id` in the file.
    latency : str
        Name of the attribute that holds the latency of an edge, in units of time.
    loss : str
        Name of the attribute that holds the probability of loss on an edge.

    Returns
    -------
    networkx.Graph or networkx.DiGraph
        As the file says, with all its attributes; nodes are named by strings.

    Raises
    ------
    InputError
        If the file cannot be read, has parallel edges or no such root, or an edge lacks an attribute
        (naming the nearest one) or has one out of range.
    """
    try:
        read: Any = nx.read_graphml(path)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    # What is no XML is a SyntaxError, what networkx does not know a KeyError or one of its own.
    except (OSError, SyntaxError, ValueError, LookupError, nx.NetworkXException) as error:
        raise InputError(f"{path}: cannot be read as GraphML ({str(error).strip()})") from None
    graph = simple_graph(f"{path}", read)
    known_node(f"{path}: root", root, graph)
    graph.graph["root"] = root
    for *edge, data in graph.edges(data=True):
        ends = edge[0], edge[1]
        named = {"latency": latency, "loss": loss}
        numbers = {
            quantity: edge_number(f"{path}: ", ends, data, attribute, quantity)
            for quantity, attribute in named.items()
        }
        data.update(numbers)
    return graph


def from_edges(
    path: str | Path,
    *,
    root: str,
    source: str = "source",
    target: str = "target",
    latency: str = "latency",
    loss: str = "loss",
    directed: bool = False,
) -> Graph:
    """Read a network from a CSV file with one edge in each row.

    Parameters
    ----------
    path : str or Path
        The file; its first line holds the names of the columns.
    root : str
        Name of the control unit's node.
    source, target : str
        Columns with the names of the two nodes of an edge.
    latency : str
        Column with its latency, at least 0 and in units of time.
    loss : str
        Column with its probability of loss.
    directed : bool
        Whether a row is the way from source to target only; if not, it is both ways.

    Returns
    -------
    networkx.Graph or networkx.DiGraph
        Nodes are named by strings, and stand in the order in which the file names them first.

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing (naming the nearest one), a cell is out of range,
        an edge stands there twice (naming the rows, counted from 1 below the names), or there is no
        such root.
    """
    sources, targets = read_columns(path, [source, target], _name, "the name of a node")
    quantities = [
        read_columns(path, [column], _up_to(HIGHEST[name]), f"a number from 0 to {HIGHEST[name]:g}")[0]
        for column, name in ((latency, "latency"), (loss, "loss"))
    ]
    graph: Graph = nx.DiGraph() if directed else nx.Graph()
    graph.graph["root"] = root
    seen: dict[frozenset[str] | tuple[str, str], int] = {}
    for row, (u, v, late, lossy) in enumerate(zip(sources, targets, *quantities, strict=True), start=1):
        before = seen.setdefault((u, v) if directed else frozenset((u, v)), row)
        if before != row:
            remedy = "keep one of them" if directed else "keep one of them, or give directed=True"
            raise InputError(f"{path}: rows {before} and {row} are the same edge, {u!r} -- {v!r}; {remedy}")
        graph.add_edge(u, v, latency=late, loss=lossy)
    known_node(f"{path}: root", root, graph)
    return graph


def _name(cell: str) -> str:
    name = cell.strip()
    if not name:
        raise ValueError
    return name


def _up_to(high: float) -> Callable[[str], float]:
    def parse(cell: str) -> float:
        value = float(cell)
        if math.isnan(value) or not 0.0 <= value <= high:
            raise ValueError
        return value

    return parse
