"""Nodes and edges of a graph that the user has given: looked up by name, and their numbers checked."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from aimd_des.channel.parameters import LONGEST
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

if TYPE_CHECKING:
    import networkx as nx

    Graph = nx.Graph[Any]
else:  # networkx is slow to import: it is there as soon as there is a graph
    Graph = Any

#: The attributes of every edge, and the largest number that each may hold.
HIGHEST = {"latency": LONGEST, "loss": 1.0}


def simple_graph(field: str, graph: object, remedy: str = "keep one, as networkx.Graph(graph) does") -> Graph:
    """Refuse what is no graph, or has several edges between the same nodes."""
    import networkx as nx

    validation.instance(field, graph, nx.Graph, "a networkx.Graph or networkx.DiGraph")
    clean: Graph = graph  # type: ignore[assignment]  # it has been looked at
    if clean.is_multigraph():
        edges = ((u, v, clean.number_of_edges(u, v)) for u, v in clean.edges())
        several = next((f" = {many} between {u!r} and {v!r}" for u, v, many in edges if many > 1), "")
        raise InputError(f"edges of {field}{several}: must be one between two nodes at most; {remedy}")
    return clean


def known_node(field: str, node: object, graph: Graph) -> None:
    """Refuse a node that the graph does not have."""
    validation.known(field, node, graph, f"one of the {len(graph)} nodes of the graph")


def edge_number(
    place: str, edge: tuple[Any, Any], data: Mapping[str, Any], attribute: str, quantity: str
) -> float:
    """Read the latency or the loss of an edge."""
    try:
        value = data[attribute]
    except KeyError:
        have = f"{edge[0]!r} -- {edge[1]!r} has {', '.join(map(repr, data)) or 'no attributes'}"
        anew = "give every edge one, for example by networkx.set_edge_attributes"
        if place:  # of a file, and the attribute is one that the reader has named
            anew = f"give every edge one, or name by {quantity} = ... the one that holds it"
        remedy = validation.nearest(attribute, data) or anew
        raise InputError(f"{place}edge {have} and no {attribute!r}; {remedy}") from None
    high = HIGHEST[quantity]
    # The common case at once: graphs may have 100,000s of edges.
    if type(value) is float and 0.0 <= value <= high:
        return value
    field = f"{place}{attribute} of edge {edge[0]!r} -- {edge[1]!r}"
    return validation.number(field, value, low=0.0, high=high)
