"""Channels over a network: along the tree of shortest paths, or by flooding."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from aimd_des.channel.broadcast import Broadcast, CompiledLink, Copies, Link, compiled_models
from aimd_des.channel.latency import Constant, Latency
from aimd_des.channel.latency.own_latency import draw_latency
from aimd_des.channel.loss import Bernoulli, Combined, CommonMode, Loss, LossProcess, Trace
from aimd_des.channel.loss.own_loss import draw_loss, start_loss
from aimd_des.channel.memory import memory_of, remember
from aimd_des.channel.network_kernel import NetworkTable, spread
from aimd_des.channel.random_draws import Draws
from aimd_des.channel.topology.attributes import Graph
from aimd_des.channel.topology.routes import Routes, find_routes
from aimd_des.channel.topology.statistics import estimated_statistics, tree_statistics
from aimd_des.channel.transmit_kernel import channel_table
from aimd_des.utils import returned_values
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Key, Purpose
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray

if TYPE_CHECKING:
    import pandas as pd


@brief
@dataclass(frozen=True, eq=False)
class _NetworkChannel:
    """What both channels share: arcs, and a model of latency and one of loss for all of them."""

    routes: Routes
    latency: Latency
    loss: Loss

    def __post_init__(self) -> None:
        _independent(self.loss)
        returned_values.check(self.latency, len(self.routes.head))

    def open(self, n_agents: int, keys: Mapping[Purpose, Key]) -> Link:
        """Begin a run; refuse a network without n agents, and values for arcs that are too few or many."""
        if len(self.routes.agents) != n_agents:
            remedy = "name the agents among the nodes by `agents`; the others are relays"
            raise InputError.of("agents of the network", len(self.routes.agents), f"{n_agents}", remedy)
        n_arcs, network = len(self.routes.head), self.routes.table()
        loss = start_loss(self.loss, n_arcs)
        if tables := compiled_models(self.latency, loss, n_arcs, keys):
            return CompiledLink(channel_table(*tables, 0.0, False, keys, network))
        return _OpenNetwork(self.latency, loss, network, keys)


class TreeChannel(_NetworkChannel):
    """A channel in which broadcasts go along the tree of shortest paths; made by `tree`.

    Parameters
    ----------
    routes : Routes
        The arcs of the tree.
    latency : Latency
        The model of latency, for each arc.
    loss : Loss
        The model of loss, for each arc.

    Raises
    ------
    InputError
        If edges would not be independent of each other.
    """

    def statistics(self) -> "pd.DataFrame":
        """Compute how many copies arrive, and how late, in the long run.

        Returns
        -------
        DataFrame
            One row for each agent: `agent`, its node; `hops` on the way to it; `delivery`, the
            probability that a copy arrives. `latency_mean` and `latency_std` are of copies that arrive,
            in units of time; not a number where none does.

        Raises
        ------
        InputError
            If a model does not say its mean or its variance.
        """
        return tree_statistics(self.routes, self.latency, self.loss)


@described_like(TreeChannel)
class FloodChannel(_NetworkChannel):
    """A channel in which every node forwards the first copy that it gets to all neighbours; made by `flood`.

    Parameters
    ----------
    routes : Routes
        All arcs over which a copy may come.
    """

    def statistics(self, broadcasts: int = 10_000, seed: int = 0) -> "pd.DataFrame":
        """Estimate how many copies arrive, and how late, in the long run.

        Parameters
        ----------
        broadcasts : int
            How many are sent, at least 2, each over links that begin as in the long run.
        seed : int
            Of the draws, at least 0; a run of the same seed draws from the same numbers.

        Returns
        -------
        DataFrame
            As of a tree, where `hops` are those of the shortest path, with the standard errors of two
            columns: `delivery_error` and `latency_mean_error`.
        """
        return estimated_statistics(self.routes, self.open, broadcasts, seed)


def tree(
    graph: Graph,
    *,
    root: Hashable = None,
    agents: Sequence[Any] | None = None,
    latency: Callable[[FloatArray], Latency] = Constant,
    loss: Callable[[FloatArray], Loss] = Bernoulli,
) -> TreeChannel:
    """Send broadcasts along the tree of shortest paths: a loss upstream silences the whole branch.

    Paths are shortest by the attribute `latency`.  Of several, the one with fewest hops is taken; of
    several such, the one whose last node but one comes first in the graph.

    Parameters
    ----------
    graph : networkx.Graph or networkx.DiGraph
        Every edge has attributes `latency`, at least 0 and in units of time, and `loss`, a probability.
        Edges of a directed graph lead in their direction only.
    root : node, optional
        The control unit's node; default: ``graph.graph["root"]``.
    agents : sequence of nodes, optional
        In the order of the agents' index; default: all nodes except the root, in the graph's order.
        The other nodes are relays, which forward and do not respond.
    latency : callable
        Gets the latencies of all arcs as one array, shape (a,), and returns a model for arcs as a
        `BroadcastChannel` has one for agents, such as `latency.Exponential`.
    loss : callable
        Gets the probabilities of loss likewise, and returns a model of loss in which arcs are independent.

    Returns
    -------
    TreeChannel
        The channel.

    Raises
    ------
    InputError
        If there is no such node, an edge lacks an attribute or has one out of range, an agent
        cannot be reached, or `latency` or `loss` does not return such a model.
    """
    routes = find_routes(graph, root, agents, only_tree=True)
    return TreeChannel(routes, *_models(routes, latency, loss))


@described_like(tree)
def flood(
    graph: Graph,
    *,
    root: Hashable = None,
    agents: Sequence[Any] | None = None,
    latency: Callable[[FloatArray], Latency] = Constant,
    loss: Callable[[FloatArray], Loss] = Bernoulli,
) -> FloodChannel:
    """Let every node forward the first copy that reaches it to all its neighbours.

    A copy arrives over the fastest of the paths that lose nothing.  Both directions of an edge are
    arcs of their own, with draws of their own.

    Returns
    -------
    FloodChannel
        The channel.
    """
    routes = find_routes(graph, root, agents, only_tree=False)
    return FloodChannel(routes, *_models(routes, latency, loss))


def _models(routes: Routes, latency: object, loss: object) -> tuple[Latency, Loss]:
    late = _made("latency", latency, routes.latency, "latency.Exponential")
    lossy = _made("loss", loss, routes.loss, "lambda p: loss.GilbertElliott(p, 5.0)")
    for name, model, kind in (("latency", late, Latency), ("loss", lossy, Loss)):
        if not isinstance(model, kind):
            raise InputError.of(f"what {name} returns", model, f"a model of {name}")
    return late, lossy


def _made(name: str, make: object, row: FloatArray, example: str) -> Any:
    if not callable(make):
        allowed = f"a function that makes a model of the {name} of all arcs"
        raise InputError.of(name, make, allowed, f"give, for example, {example}")
    given = row.copy()
    given.setflags(write=False)
    return make(given)


def _independent(loss: Loss) -> None:
    for part in loss.losses if isinstance(loss, Combined) else (loss,):
        if isinstance(part, CommonMode | Trace):
            raise InputError.of(
                "loss",
                part,
                "a model in which arcs are independent of each other, such as Bernoulli or GilbertElliott",
                "for what all agents lose together, put one edge between the root and the rest",
            )


@dataclass(frozen=True, eq=False)
class _OpenNetwork:
    """A channel over a network with the user's own models, in one run."""

    latency: Latency
    loss: LossProcess
    network: NetworkTable
    keys: Mapping[Purpose, Key]

    def attach(self, system: object) -> None:
        """Give the run in progress to a loss that reads it."""
        returned_values.attach(self.loss, system)

    def state(self) -> dict[str, Any]:
        """Return what it remembers."""
        return {"loss": memory_of(self.loss)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        remember(self.loss, state["loss"])

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        """Draw loss and latency of every arc, and say when copies arrive."""
        draws = Draws(self.keys, broadcast.resource, broadcast.number, departure, len(self.network.latency))
        lost = draw_loss(self.loss, draws, "arc")
        # A negative latency might send a copy round in circles for ever.
        self.network.latency[:] = draw_latency(self.latency, draws, "arc")
        arrival = np.empty(len(self.network.agent))
        spread(self.network, lost, departure, arrival)
        return Copies(arrival)
