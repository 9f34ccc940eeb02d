"""Networks that were measured: GraphML files, and lists of edges as CSV."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from aimd_des.channel.csv_columns import read_columns
from aimd_des.channel.topology.attributes import HIGHEST, Graph, edge_number, known_node, simple_graph
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in

# Of attributes in GraphML, as far as networkx reads them.
_TYPES = {"boolean", "int", "integer", "long", "float", "double", "string"}

# What is no XML is a SyntaxError; what networkx does not know is an error of its own or a KeyError, and
# what it does not find one of the last two.
_UNREADABLE = (OSError, SyntaxError, ValueError, LookupError, TypeError, AttributeError)


@built_in("network", "graphml")
def from_graphml(
    path: str | Path, *, root: str, latency: str = "latency", loss: str = "loss", scale: float = 1.0
) -> Graph:
    """Read a network from a GraphML file.

    Parameters
    ----------
    path : str or Path
        The file.
    root : str
        Name of the control unit's node, its `id` in the file.
    latency : str
        Name of the attribute that holds the latency of an edge, in units of time; its ``<default>`` holds
        where an edge has none.
    loss : str
        Name of the attribute that holds the probability of loss on an edge; likewise.
    scale : float
        Multiplies every latency, at least 0: 0.001 makes seconds of milliseconds.

    Returns
    -------
    networkx.Graph or networkx.DiGraph
        As the file says, with all its attributes; nodes are named by strings.

    Raises
    ------
    InputError
        If the file cannot be read, has parallel edges (naming their nodes) or no such root, or an edge
        lacks an attribute (naming the nearest one) or has one out of range.
    """
    import networkx as nx

    file, named = validation.path("path", path), {"latency": latency, "loss": loss}
    scale = validation.number("scale", scale, low=0.0, high=HIGHEST["latency"])
    for quantity, attribute in named.items():
        validation.instance(quantity, attribute, str, "the name of an attribute of the edges")
    try:
        read: Any = nx.parse_graphml(_with_known_keys(file))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (*_UNREADABLE, nx.NetworkXException) as error:
        raise InputError(f"{path}: cannot be read as GraphML ({str(error).strip()})") from None
    graph = simple_graph(f"{path}", read, "leave one of them in the file")
    known_node(f"{path}: root", root, graph)
    graph.graph["root"] = root
    for *edge, data in graph.edges(data=True):
        for attribute, value in graph.graph["edge_default"].items():
            data.setdefault(attribute, value)
        place, ends = f"{path}: ", (edge[0], edge[1])
        numbers = {
            quantity: edge_number(place, ends, {**data, **_as_number(data, attribute)}, attribute, quantity)
            for quantity, attribute in named.items()
        }
        data.update(numbers, latency=scale * numbers["latency"])
    return graph


def _with_known_keys(file: Path) -> str:
    """Read a GraphML file, with its keys as networkx wants them: named, and of a type that it knows.

    A key may lack name and type, and programs write types of their own for lists. Values of unknown types
    are kept as text. A key for all elements is one for edges, too.
    """
    root = ET.parse(file).getroot()  # noqa: S314 - networkx reads it the same way
    for key in root:
        if key.tag.rpartition("}")[2] == "key" and "yfiles.type" not in key.attrib:
            key.attrib.setdefault("attr.name", key.get("id", ""))
            if key.get("attr.type") not in _TYPES:
                key.set("attr.type", "string")
            if key.get("for", "all") == "all":
                key.set("for", "edge")
    return ET.tostring(root, encoding="unicode")


def _as_number(data: Mapping[str, Any], attribute: str) -> dict[str, float]:
    """Read the number that an attribute without a type holds as text."""
    try:
        return {attribute: float(data[attribute])} if isinstance(data.get(attribute), str) else {}
    except ValueError:
        return {}


@built_in("network", "edges")
def from_edges(
    path: str | Path,
    *,
    root: str,
    source: str = "source",
    target: str = "target",
    latency: str = "latency",
    loss: str = "loss",
    scale: float = 1.0,
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
    scale : float
        Multiplies every latency, at least 0: 0.001 makes seconds of milliseconds.
    directed : bool
        Whether a row is the way from source to target only; if not, it is both ways.

    Returns
    -------
    networkx.Graph or networkx.DiGraph
        Nodes are named by strings, and stand in the order in which the file names them first.

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing or a cell is out of range, an edge is listed
        twice, or there is no such root. The message names the nearest column or the rows, counted from 1
        below the names.
    """
    import networkx as nx

    directed = validation.flag("directed", directed)
    scale = validation.number("scale", scale, low=0.0, high=HIGHEST["latency"])
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
        graph.add_edge(u, v, latency=scale * late, loss=lossy)
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
