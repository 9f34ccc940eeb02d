"""Networks as data: how broadcasts go over a graph, and how large a graph will be."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from aimd_des.channel import Channel, topology
from aimd_des.channel.latency import Constant, Exponential
from aimd_des.channel.loss import Bernoulli, GilbertElliott
from aimd_des.channel.topology.attributes import Graph
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

# A row of a list of edges has about so many bytes.
_BYTES_PER_EDGE = 16

_MOST_EDGES = 10_000_000

# What the size of a graph is made of.
_SIZES = {"n_agents", "branching", "height", "rows", "columns", "radius"}


def over_network(
    graph: Graph,
    over: Literal["tree", "flood"] = "tree",
    agents: Sequence[str | int | Sequence[int]] | None = None,
    latency_model: Literal["constant", "exponential"] = "constant",
    mean_burst: float | None = None,
) -> Channel:
    """Send broadcasts over a graph.

    Parameters
    ----------
    graph : networkx.Graph
        Every edge has a latency and a loss.
    over : {"tree", "flood"}
        Along the tree of shortest paths, or by flooding.
    agents : list of nodes, optional
        In the order of the agents' index. Default: all nodes except the control unit's.
        The other nodes are relays.
    latency_model : {"constant", "exponential"}
        What an edge's latency is: the same for every broadcast, or the mean of exponential ones.
    mean_burst : float, optional
        Mean duration of bursts in which an edge loses everything, in units of time; default: losses are
        independent.

    Returns
    -------
    Channel
        Along the tree, or by flooding.

    Raises
    ------
    InputError
        If there is no such node, or an agent cannot be reached.
    """
    loss: Any = Bernoulli
    if mean_burst is not None:
        burst = validation.number("mean_burst", mean_burst, low=0.0, low_open=True)
        loss = partial(GilbertElliott, mean_burst=burst)
    return {"tree": topology.tree, "flood": topology.flood}[over](
        graph,
        agents=None
        if agents is None
        else [tuple(node) if isinstance(node, list) else node for node in agents],
        latency={"constant": Constant, "exponential": Exponential}[latency_model],
        loss=loss,
    )


def refuse_vast(kind: str, parameters: Mapping[str, Any]) -> float:
    """Estimate how many edges a graph will have, and refuse what no machine can hold."""
    edges = max(_edges(kind, parameters), 0.0)
    if edges > _MOST_EDGES:
        allowed = f"at most {_MOST_EDGES:,} edges, and these are about {edges:.1e}"
        raise InputError.of("size of the network", kind, allowed)
    return edges


def _edges(kind: str, given: Mapping[str, Any]) -> float:
    if kind in ("graphml", "edges"):
        try:
            return Path(given["path"]).stat().st_size / _BYTES_PER_EDGE
        except (OSError, ValueError):  # which is refused when it is read
            return 0.0
    size = {name: float(value) for name, value in given.items() if name in _SIZES}
    if kind == "grid":
        return 2.0 * size["rows"] * size["columns"]
    if kind == "balanced_tree":
        growth = math.log(max(size["branching"], 1.0))
        return max(size["height"], math.exp(min(size["height"] * growth, 100.0)))
    n = size["n_agents"]
    if kind == "star":
        return n
    # There are no neighbours beyond the square.
    return n + 0.5 * n * n * min(math.pi * min(abs(size["radius"]), 1.0) ** 2, 1.0)
