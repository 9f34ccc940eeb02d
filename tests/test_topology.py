"""Broadcasts over networks, held against closed forms, exact enumeration and networkx.

Statistical tests name seed and number of broadcasts; their standard errors come from the exact
values, and |z| must stay below 4.5, which a right model exceeds once in 150,000 comparisons.  Beside each
stands a model that is slightly wrong and must be rejected.
"""

import csv
import math
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networkx.readwrite.graphml import GraphML

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Recording,
    Simulation,
    SimulationError,
    latency,
    loss,
    topology,
)
from aimd_des.channel import Broadcast, CompiledLink, Draws
from aimd_des.channel.transmit_kernel import transmit
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose
from tests.conftest import (
    assert_same_run,
    quietly,
    random_problem,
    refusal,
)

HIGHEST_Z = 4.5
KEYS = {purpose: rng.key(11, purpose) for purpose in Purpose}


def arrivals(channel: Any, broadcasts: int = 1, departure: float = 0.0, spacing: float = 0.0) -> Any:
    """When the copies of broadcasts 0, 1, ... arrive, shape (broadcasts, n)."""
    agents = channel.routes.agents
    link = channel.open(len(agents), KEYS)
    sent = ((Broadcast(0, k, 0.0), departure + k * spacing) for k in range(broadcasts))
    return np.array([link.transmit(broadcast, time).arrival for broadcast, time in sent])


def weighted(*edges: tuple[Any, Any, float, float], root: Any = "r", directed: bool = False) -> Any:
    """A graph from edges with latency and loss."""
    graph: Any = nx.DiGraph() if directed else nx.Graph()
    graph.graph["root"] = root
    for u, v, late, lossy in edges:
        graph.add_edge(u, v, latency=late, loss=lossy)
    return graph


def uneven_tree() -> Any:
    """A tree of 13 nodes, each edge with numbers of its own."""
    graph = topology.balanced_tree(3, 2)
    for k, (u, v) in enumerate(graph.edges):
        graph.edges[u, v].update(latency=0.1 + 0.07 * k, loss=0.02 + 0.013 * k)
    return graph


def meshed(directed: bool = False) -> Any:
    """Five nodes with circles, one of them a relay ("w")."""
    return weighted(
        ("r", "a", 1.0, 0.3),
        ("r", "w", 0.4, 0.4),
        ("a", "w", 0.3, 0.2),
        ("w", "b", 0.5, 0.25),
        ("a", "c", 0.9, 0.35),
        ("b", "c", 0.2, 0.15),
        directed=directed,
    )


# -- what tree and flood are -------------------------------------------------------------------------------


@st.composite
def graphs(draw: st.DrawFn) -> Any:
    """A connected graph of two to nine nodes, directed or not, with ties and edges that cost nothing."""
    n = draw(st.integers(2, 9))
    pairs = {(draw(st.integers(0, v - 1)), v) for v in range(1, n)}
    pairs |= draw(st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=14))
    numbers = st.sampled_from([0.0, 0.1, 0.2, 0.3, 1.0]) | st.floats(0.0, 3.0)
    chances = st.sampled_from([0.0, 0.2, 0.5])
    edges = [(u, v, draw(numbers), draw(chances)) for u, v in sorted(pairs)]
    graph = weighted(*edges, root=0, directed=draw(st.booleans()))
    ordered = type(graph)()
    ordered.add_nodes_from(draw(st.permutations(range(n))))
    ordered.update(graph)
    ordered.graph["root"] = 0
    return ordered


MODELS: dict[str, Callable[[Any], Any]] = {
    "constant": latency.Constant,
    "exponential": latency.Exponential,
    "gamma": lambda row: latency.ShiftedGamma(2.0, row / 2.0),
}


def drawn_digraph(channel: Any, link: Any) -> tuple[Any, dict[int, Any]]:
    """The arcs that have survived the last broadcast, with their latencies, and the names of nodes."""
    routes, table = channel.routes, link.table
    graph: Any = nx.DiGraph()
    graph.add_node(0)
    for arc in np.flatnonzero(~table.lost).tolist():
        late = float(table.network.latency[arc])
        graph.add_edge(int(routes.tail[arc]), int(routes.head[arc]), latency=late)
    return graph, {0: 0} | dict(zip(routes.node.tolist(), routes.agents, strict=True))


@settings(max_examples=75)
@given(graphs(), st.sampled_from(sorted(MODELS)))
def test_a_flood_takes_the_shortest_path_that_survives(graph: Any, model: str) -> None:
    channel = topology.flood(graph, latency=MODELS[model])
    link = channel.open(len(graph) - 1, KEYS)
    for number in range(4):
        arrival = link.transmit(Broadcast(0, number, 0.0), 0.0).arrival
        survived, names = drawn_digraph(channel, link)
        shortest = nx.single_source_dijkstra_path_length(survived, 0, weight="latency")
        exact = [shortest.get(node, math.inf) for node in channel.routes.node.tolist()]
        assert arrival.tolist() == exact
        if model == "constant":
            for u, v, data in survived.edges(data=True):
                assert data["latency"] == graph.edges[names[u], names[v]]["latency"]


@settings(max_examples=75)
@given(graphs(), st.sampled_from(sorted(MODELS)))
def test_a_tree_adds_up_one_path_and_loses_with_any_of_its_arcs(graph: Any, model: str) -> None:
    channel = topology.tree(graph, latency=MODELS[model])
    routes, link = channel.routes, channel.open(len(graph) - 1, KEYS)
    into = {head: arc for arc, head in enumerate(routes.head.tolist())}
    assert len(into) == len(routes.head) == len(graph) - 1
    nominal = nx.single_source_dijkstra_path_length(graph, 0, weight="latency")
    lossless = {0: 0.0}
    for arc in np.argsort(routes.tail, kind="stable").tolist():
        lossless[int(routes.head[arc])] = lossless[int(routes.tail[arc])] + float(routes.latency[arc])
    assert lossless == {0: 0.0} | {
        int(node): nominal[name] for node, name in zip(routes.node, routes.agents, strict=True)
    }
    for number in range(4):
        arrival = link.transmit(Broadcast(0, number, 0.0), 2.5).arrival
        for i, node in enumerate(routes.node.tolist()):
            path, at = [], node
            while at:
                path.append(into[at])
                at = int(routes.tail[into[at]])
            time = 2.5
            for arc in reversed(path):
                time = math.inf if link.table.lost[arc] else time + float(link.table.network.latency[arc])
            assert arrival[i] == time
            assert len(path) == routes.hops[i]


def test_a_loss_upstream_silences_the_branch_but_not_a_flood() -> None:
    graph = weighted(("r", "a", 1.0, 1.0), ("a", "b", 1.0, 0.0), ("r", "c", 3.0, 0.0), ("c", "b", 1.0, 0.0))
    assert arrivals(topology.tree(graph), departure=1.0).tolist() == [[math.inf, math.inf, 4.0]]
    assert arrivals(topology.flood(graph), departure=1.0).tolist() == [[6.0, 5.0, 4.0]]


def test_equal_paths_are_decided_by_hops_and_then_by_the_order_of_nodes() -> None:
    def parents(*nodes: str, edges: Any) -> list[int]:
        graph: Any = nx.Graph()
        graph.add_nodes_from(nodes)
        graph.update(weighted(*edges))
        graph.graph["root"] = "r"
        routes = topology.tree(graph, agents=["z"]).routes
        return routes.hops.tolist() + routes.loss.tolist()

    diamond = [("r", "a", 1.0, 0.1), ("r", "b", 1.0, 0.2), ("a", "z", 1.0, 0.3), ("b", "z", 1.0, 0.4)]
    assert parents("r", "a", "b", "z", edges=diamond) == [2, 0.3, 0.1]
    assert parents("z", "b", "a", "r", edges=diamond) == [2, 0.4, 0.2]
    direct = [*diamond, ("r", "z", 2.0, 0.5)]
    assert parents("r", "a", "b", "z", edges=direct) == [1, 0.5]
    free = [(u, v, 0.0, p) for u, v, _, p in direct]
    assert parents("r", "a", "b", "z", edges=free) == [1, 0.5]


def test_the_order_of_edges_does_not_matter() -> None:
    graph = meshed()
    other: Any = nx.Graph(**graph.graph)
    other.add_nodes_from(graph)
    other.add_edges_from([(v, u, data) for u, v, data in reversed(list(graph.edges(data=True)))])
    for make in (topology.tree, topology.flood):
        one, two = (arrivals(make(g, latency=latency.Exponential), 50) for g in (graph, other))
        assert one.tobytes() == two.tobytes()


def test_relays_forward_and_agents_are_numbered_as_they_are_named() -> None:
    graph = meshed()
    for make in (topology.tree, topology.flood):
        few = make(graph, agents=["c", "a"], loss=lambda row: loss.Bernoulli(0.0 * row))
        assert arrivals(few)[0].tolist() == [0.4 + 0.5 + 0.2, 0.4 + 0.3]
    assert topology.tree(graph, agents=["w"]).routes.head.tolist() == [1]  # what leads nowhere is not drawn
    from_b = topology.tree(graph, root="b", agents=["r"])
    assert from_b.statistics()["hops"].tolist() == [2]


def test_edges_of_a_directed_graph_lead_one_way() -> None:
    one_way = meshed(directed=True)
    channel = topology.flood(one_way, agents=["c"], loss=lambda row: loss.Bernoulli(0.0 * row))
    assert arrivals(channel).tolist() == [[0.4 + 0.5 + 0.2]]
    with pytest.raises(InputError, match="agents 'r': no path leads there from the root 'c'"):
        topology.flood(one_way, root="c", agents=["r"])


def test_a_flood_over_a_tree_is_that_tree() -> None:
    agents = [3, 7, 12, 1]  # nodes that lead nowhere are drawn by one of them only
    one, two = (
        arrivals(make(uneven_tree(), agents=agents, latency=latency.Exponential), 200)
        for make in (topology.tree, topology.flood)
    )
    assert one.tobytes() == two.tobytes()


def test_a_flood_is_never_later_than_the_tree_over_the_same_graph() -> None:
    graph = topology.grid(4, 5, latency=0.3, loss=0.1)
    along, over = (
        arrivals(make(graph, latency=latency.Exponential), 300) for make in (topology.tree, topology.flood)
    )
    assert (over <= along).all()
    assert (over < along).mean() > 0.3


# -- a star, and other ways to say the same ----------------------------------------------------------------


@pytest.mark.parametrize("make", [topology.tree, topology.flood])
@pytest.mark.parametrize("model", sorted(MODELS))
@pytest.mark.parametrize("bursts", [False, True])
def test_a_star_is_a_broadcast_channel(make: Any, model: str, bursts: bool) -> None:
    late, lossy = np.linspace(1.0, 0.2, 9), np.linspace(0.1, 0.5, 9)
    kind: Any = (lambda row: loss.GilbertElliott(row, 2.0)) if bursts else loss.Bernoulli
    channel = make(topology.star(9, late, lossy), latency=MODELS[model], loss=kind)
    plain = BroadcastChannel(MODELS[model](late), kind(lossy)).open(9, KEYS)
    link = channel.open(9, KEYS)
    for k in range(60):
        broadcast, departure = Broadcast(k % 3, k // 3, 0.7 * k), 0.7 * k + 0.1
        one, two = (each.transmit(broadcast, departure) for each in (link, plain))
        assert one.arrival.tobytes() == two.arrival.tobytes()
        assert one.second is None


class OwnLatency:
    """A user's model, of which the framework knows nothing but that it draws."""

    def __init__(self, model: Any) -> None:
        self.check = model.check
        self._model = model

    def draw(self, draws: Draws) -> Any:
        return self._model.draw(draws)


class OwnLoss:
    """A user's model likewise."""

    def __init__(self, model: Any) -> None:
        self._model = model

    def start(self, n_agents: int) -> Any:
        draw = self._model.start(n_agents).draw
        return type("Process", (), {"draw": lambda _, draws: draw(draws)})()


@pytest.mark.parametrize("make", [topology.tree, topology.flood])
def test_users_own_models_draw_what_built_in_ones_draw(make: Any) -> None:
    def bursty(row: Any) -> Any:
        return loss.Combined(loss.GilbertElliott(row, 3.0), loss.Bernoulli(0.1 * row))

    graph = meshed()
    built_in = make(graph, latency=latency.Exponential, loss=bursty)
    own = make(
        graph,
        latency=lambda row: OwnLatency(latency.Exponential(row)),
        loss=lambda row: OwnLoss(bursty(row)),
    )
    n = len(own.routes.agents)
    assert isinstance(built_in.open(n, KEYS), CompiledLink)
    assert not isinstance(own.open(n, KEYS), CompiledLink)
    assert arrivals(built_in, 100, spacing=0.5).tobytes() == arrivals(own, 100, spacing=0.5).tobytes()


def test_networks_are_of_the_compiled_type_of_all_channels() -> None:
    BroadcastChannel().open(2, KEYS).transmit(Broadcast(0, 0, 0.0), 0.0)
    arrivals(topology.flood(meshed(), latency=latency.Exponential))
    assert len(transmit.dispatcher.signatures) == 1  # type: ignore[attr-defined]


# -- statistics --------------------------------------------------------------------------------------------


def highest_z(found: Any, exact: Any, error: Any) -> float:
    return float(np.max(np.abs(np.asarray(found) - exact) / error))


@pytest.mark.parametrize("wrong", [False, True])
def test_trees_deliver_as_often_and_as_late_as_their_formulas_say(wrong: bool) -> None:
    """40,000 broadcasts of seed 11; a model with a tenth more of loss or latency on each edge is rejected."""
    broadcasts, graph = 40_000, uneven_tree()
    drawn = arrivals(topology.tree(graph, latency=latency.Exponential), broadcasts)
    for _, _, data in graph.edges(data=True):
        data.update({name: (1.1 if wrong else 1.0) * value for name, value in data.items()})
    exact = topology.tree(graph, latency=latency.Exponential).statistics()
    here = drawn < np.inf
    counts, p = here.sum(axis=0), exact["delivery"]
    delivered = highest_z(here.mean(axis=0), p, np.sqrt(p * (1.0 - p) / broadcasts))
    late = np.where(here, drawn, np.nan)
    mean, std = exact["latency_mean"], exact["latency_std"]
    timely = highest_z(np.nanmean(late, axis=0), mean, std / np.sqrt(counts))
    # The fourth cumulant of an exponential latency is 6 mean**4, and cumulants add up along a path.
    edge = nx.get_edge_attributes(graph, "latency")
    paths = nx.single_source_shortest_path(graph, 0)
    fourth = np.array(
        [sum(6.0 * edge[pair] ** 4 for pair in nx.utils.pairwise(paths[i])) for i in range(1, 13)]
    )
    spread = highest_z(np.nanvar(late, axis=0), std**2, np.sqrt((2.0 * std**4 + fourth) / counts))
    assert (max(delivered, timely, spread) < HIGHEST_Z) is not wrong
    assert not wrong or min(delivered, timely, spread) > HIGHEST_Z


def test_a_trees_statistics_by_hand() -> None:
    graph = weighted(("r", "w", 1.0, 0.2), ("w", "b", 2.0, 0.5), ("r", "a", 4.0, 1.0))
    channel = topology.tree(graph, agents=["b", "a"], latency=latency.Exponential)
    frame = channel.statistics()
    assert frame.columns.tolist() == ["agent", "hops", "delivery", "latency_mean", "latency_std"]
    assert frame["agent"].tolist() == ["b", "a"]
    assert frame["hops"].tolist() == [2, 1]
    assert frame["delivery"].tolist() == [0.8 * 0.5, 0.0]
    assert frame["latency_mean"][0] == 3.0
    assert frame["latency_std"][0] == math.sqrt(1.0 + 4.0)
    assert frame.loc[1, ["latency_mean", "latency_std"]].isna().all()
    heavy = topology.tree(graph, latency=lambda row: latency.Pareto(1.5, row))
    assert np.isinf(heavy.statistics()["latency_std"][:2]).all()


def test_a_flood_over_a_tree_is_estimated_to_be_the_tree() -> None:
    """5,000 broadcasts of seed 3, with bursts that last far longer than broadcasts are apart."""
    kinds: Any = {"latency": latency.Exponential, "loss": lambda row: loss.GilbertElliott(row, 50.0)}
    exact = topology.tree(uneven_tree(), **kinds).statistics()
    found = topology.flood(uneven_tree(), **kinds).statistics(broadcasts=5_000, seed=3)
    assert found.columns.tolist() == [*exact.columns, "delivery_error", "latency_mean_error"]
    pd.testing.assert_frame_equal(found[["agent", "hops"]], exact[["agent", "hops"]])
    p = exact["delivery"]
    error = np.sqrt(p * (1.0 - p) / 5_000)
    timely = exact["latency_std"] / np.sqrt(5_000 * p)
    assert highest_z(found["delivery"], p, error) < HIGHEST_Z
    assert highest_z(found["latency_mean"], exact["latency_mean"], timely) < HIGHEST_Z
    # An error that is itself estimated from 5,000 broadcasts is good to some per cent.
    assert np.allclose(found["delivery_error"], error, rtol=0.1)
    assert np.allclose(found["latency_mean_error"], timely, rtol=0.1)
    one_less = topology.tree(uneven_tree(), latency=latency.Exponential).statistics()["delivery"] * 0.95
    assert highest_z(found["delivery"], one_less, error) > HIGHEST_Z


def enumerated(graph: Any, agents: list[Any]) -> tuple[Any, Any, Any]:
    """Delivery, mean and standard deviation of a flood with constant latencies, over all sets of arcs."""
    root = graph.graph["root"]
    arcs = [(u, v, data) for u, v, data in graph.to_directed().edges(data=True) if v != root]
    sums = np.zeros((3, len(agents)))
    for kept in product((False, True), repeat=len(arcs)):
        survived: Any = nx.DiGraph()
        survived.add_node(root)
        chance = 1.0
        for keep, (u, v, data) in zip(kept, arcs, strict=True):
            chance *= 1.0 - data["loss"] if keep else data["loss"]
            if keep:
                survived.add_edge(u, v, latency=data["latency"])
        times = nx.single_source_dijkstra_path_length(survived, root, weight="latency")
        for i, node in enumerate(agents):
            if node in times:
                sums[:, i] += chance * np.array([1.0, times[node], times[node] ** 2])
    delivery, first, second = sums
    mean = first / delivery
    return delivery, mean, np.sqrt(second / delivery - mean * mean)


def independent_paths(graph: Any, agents: list[Any]) -> Any:
    """What delivery would be if paths did not share edges."""

    def missed(node: Any) -> Iterator[float]:
        for path in nx.all_simple_edge_paths(graph, graph.graph["root"], node):
            yield 1.0 - math.prod(1.0 - graph.edges[pair]["loss"] for pair in path)

    return np.array([1.0 - math.prod(missed(node)) for node in agents])


@pytest.mark.parametrize("directed", [False, True])
def test_floods_are_those_of_exact_enumeration(directed: bool) -> None:
    """20,000 broadcasts of seed 5 over 1,024 or 64 sets of arcs; paths that share no edge are rejected."""
    graph, broadcasts = meshed(directed), 20_000
    agents = ["a", "b", "c"]
    delivery, mean, std = enumerated(graph, agents)
    found = topology.flood(graph, agents=agents).statistics(broadcasts, seed=5)
    error = np.sqrt(delivery * (1.0 - delivery) / broadcasts)
    assert highest_z(found["delivery"], delivery, error) < HIGHEST_Z
    spread = np.maximum(std, 1e-12)  # of agents that are reached in one way only
    assert highest_z(found["latency_mean"], mean, spread / np.sqrt(broadcasts * delivery)) < HIGHEST_Z
    assert highest_z(found["delivery"], independent_paths(graph, agents), error) > HIGHEST_Z
    if not directed:
        shortest = topology.tree(graph, agents=agents).statistics()["latency_mean"]
        assert highest_z(found["latency_mean"], shortest, spread / np.sqrt(broadcasts * delivery)) > HIGHEST_Z


def test_statistics_of_what_never_or_always_arrives() -> None:
    graph = weighted(("r", "a", 1.0, 1.0), ("r", "b", 2.0, 0.0))
    frame = topology.flood(graph).statistics(broadcasts=10)
    assert frame["delivery"].tolist() == [0.0, 1.0]
    assert frame.loc[0, ["latency_mean", "latency_std", "latency_mean_error"]].isna().all()
    assert frame.loc[1, ["latency_mean", "latency_std", "latency_mean_error"]].tolist() == [2.0, 0.0, 0.0]


# -- processes and the fleet -------------------------------------------------------------------------------

CHANNELS: dict[str, dict[str, Any]] = {
    "constant": {},
    "random and bursty": {
        "latency": latency.Exponential,
        "loss": lambda row: loss.GilbertElliott(row, 5.0),
    },
    "users own": {"latency": lambda row: OwnLatency(latency.Exponential(row))},
}


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
@pytest.mark.parametrize("models", sorted(CHANNELS))
@pytest.mark.parametrize("make", [topology.tree, topology.flood])
def test_processes_and_a_fleet_are_the_same(make: Any, models: str, dynamics: str) -> None:
    channel = make(topology.grid(3, 4, latency=0.3, loss=0.3), **CHANNELS[models])
    parts: dict[str, Any] = {"dynamics": dynamics, "channel": channel, "seed": 8}
    if dynamics == "continuous":
        parts["control_unit"] = Crossing(0.5)
    problem = random_problem(3, 11, 2)
    for recording in (Recording(), Recording(events=True)):
        one, two = (
            quietly(Simulation(problem, agents=agents, recording=recording, **parts).run, 60.0)
            for agents in (AgentProcess, Fleet)
        )
        assert_same_run(one, two)
        assert one.account.lost.sum() > 20
        assert one.account.responses.sum() > 20


def test_other_topologies_are_other_runs() -> None:
    graph, problem = topology.grid(3, 4, latency=0.3, loss=0.1), random_problem(3, 11, 2)
    digests = {
        quietly(Simulation(problem, agents=Fleet, channel=make(graph), seed=8).run, 60.0).digest
        for make in (topology.tree, topology.flood)
    }
    assert len(digests) == 2


def test_a_broadcast_that_bursts_of_loss_refuse_is_the_same_error() -> None:
    link = topology.tree(topology.star(2), loss=lambda row: loss.GilbertElliott(row, 1.0)).open(2, KEYS)
    link.transmit(Broadcast(0, 0, 2.0), 2.0)
    with pytest.raises(SimulationError, match="earlier than the one before it"):
        link.transmit(Broadcast(0, 1, 1.0), 1.0)


# -- generators --------------------------------------------------------------------------------------------


def test_generators_are_networkx_graphs_with_numbers_on_every_edge() -> None:
    made = {
        "star": (topology.star(4, [1.0, 2.0, 3.0, 4.0], 0.1), 0, 5, 4),
        "balanced": (topology.balanced_tree(2, 3, 0.5, 0.1), 0, 15, 14),
        "grid": (topology.grid(2, 3, 0.5), (0, 0), 6, 7),
        "centre": (topology.grid(3, 3, 0.5, root=(1, 1)), (1, 1), 9, 12),
        "line": (topology.grid(1, 4), (0, 0), 4, 3),
    }
    for graph, root, nodes, edges in made.values():
        assert (graph.graph["root"], len(graph), graph.number_of_edges()) == (root, nodes, edges)
        assert all({"latency", "loss"} == set(data) for *_, data in graph.edges(data=True))
    assert [made["star"][0].edges[0, i]["latency"] for i in range(1, 5)] == [1.0, 2.0, 3.0, 4.0]


def test_random_geometric_graphs_join_what_is_near() -> None:
    graph = topology.random_geometric(60, 0.3, latency_per_distance=2.0, loss=0.1, seed=4)
    places = nx.get_node_attributes(graph, "pos")
    assert places[0] == (0.5, 0.5)
    for u, v in nx.complete_graph(61).edges:
        distance = math.dist(places[u], places[v])
        assert graph.has_edge(u, v) == (distance <= 0.3)
        if graph.has_edge(u, v):
            assert graph.edges[u, v]["latency"] == pytest.approx(2.0 * distance, rel=1e-15)
    more = topology.random_geometric(80, 0.3, latency_per_distance=2.0, seed=4)
    assert [more.nodes[i]["pos"] for i in range(61)] == [places[i] for i in range(61)]
    other = topology.random_geometric(60, 0.3, latency_per_distance=2.0, seed=5)
    assert other.nodes[1]["pos"] != places[1]
    # Not the numbers that a problem of the same seed is made from.
    assert places[1][0] != rng.generator(4, Purpose.PROBLEM).random()


# -- files -------------------------------------------------------------------------------------------------


def test_graphml_and_csv_round_trips(tmp_path: Path) -> None:
    graph = meshed()
    nx.write_graphml(graph, tmp_path / "net.graphml")
    renamed: Any = nx.Graph(graph)
    for *_, data in renamed.edges(data=True):
        data["delay"], data["p"] = data.pop("latency"), data.pop("loss")
    nx.write_graphml(renamed, tmp_path / "renamed.graphml")
    # So that nodes are first named in the order of the graph.
    edges = sorted(graph.edges(data=True), key=lambda edge: max(map(list(graph).index, edge[:2])))
    with (tmp_path / "net.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["from", "to", "comment", "delay", "p"])
        rows.writerows([u, v, "", repr(data["latency"]), data["loss"]] for u, v, data in edges)
    names: Any = {"latency": "delay", "loss": "p"}
    read = [
        topology.from_graphml(tmp_path / "net.graphml", root="r"),
        topology.from_graphml(str(tmp_path / "renamed.graphml"), root="r", **names),
        topology.from_edges(tmp_path / "net.csv", root="r", source="from", target="to", **names),
    ]
    for make in (topology.tree, topology.flood):
        kinds = {"latency": latency.Exponential, "agents": ["c", "a", "b"]}
        original = arrivals(make(graph, **kinds), 20)
        for other in read:
            assert arrivals(make(other, **kinds), 20).tobytes() == original.tobytes()


def test_latencies_of_files_may_have_another_unit(tmp_path: Path) -> None:
    (tmp_path / "net.csv").write_text("source,target,latency,loss\nr,a,250,0\na,b,500,0.5\n")
    read = topology.from_edges(tmp_path / "net.csv", root="r", scale=0.001)
    nx.write_graphml(topology.from_edges(tmp_path / "net.csv", root="r"), tmp_path / "net.graphml")
    for graph in (read, topology.from_graphml(tmp_path / "net.graphml", root="r", scale=0.001)):
        assert graph.edges["r", "a"] == {"latency": 0.25, "loss": 0.0}
        assert graph.edges["a", "b"] == {"latency": 0.5, "loss": 0.5}


def test_directed_files(tmp_path: Path) -> None:
    graph = meshed(directed=True)
    nx.write_graphml(graph, tmp_path / "net.graphml")
    (tmp_path / "net.csv").write_text("source,target,latency,loss\nr,a,1,0\na,r,2,0.5\na,b,1,0\n")
    assert topology.from_graphml(tmp_path / "net.graphml", root="r").is_directed()
    read = topology.from_edges(tmp_path / "net.csv", root="r", directed=True)
    assert read.edges["a", "r"]["latency"] == 2.0
    assert arrivals(topology.tree(read)).tolist() == [[1.0, 2.0]]


# -- errors ------------------------------------------------------------------------------------------------


def broken(**changes: Any) -> Any:
    """A graph with one edge that is changed; None takes an attribute away."""
    graph = meshed()
    data = graph.edges["a", "w"]
    data.update(changes)
    for name in [name for name, value in data.items() if value is None]:
        del data[name]
    return graph


def unnamed() -> Any:
    graph = meshed()
    del graph.graph["root"]
    return graph


class Backwards:
    """A latency that a user has made wrong."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def check(self, n_agents: int) -> None:
        pass

    def draw(self, draws: Draws) -> Any:
        return self.value


class Nowhere:
    """A loss that a user has made wrong."""

    def start(self, n_agents: int) -> Any:
        return type("Process", (), {"draw": lambda _, draws: np.zeros(1)})()


ISLANDS = weighted(("r", "a", 1.0, 0.0), ("b", "c", 1.0, 0.0))
MANY = nx.Graph([(0, 1, {"latency": 1.0, "loss": 0.0})], root=0)
MANY.add_nodes_from(range(2, 15))

CHANNEL_ERRORS: dict[str, tuple[Callable[[], object], list[str]]] = {
    "no graph": (lambda: topology.tree({"a": "b"}), ["graph = {'a': 'b'}: must be a networkx.Graph"]),
    "parallel edges": (
        lambda: topology.flood(nx.MultiGraph([(0, 1), (1, 0)])),
        ["edges of graph = 2 between 0 and 1: must be one", "networkx.Graph(graph)"],
    ),
    "no root": (
        lambda: topology.tree(unnamed()),
        ["root = None: must be one of the 5 nodes", 'graph.graph["root"]'],
    ),
    "unknown root": (
        lambda: topology.tree(topology.star(12), root="11"),
        ["root = '11': must be one of the 13 nodes of the graph; did you mean 11?"],
    ),
    "unknown agent": (
        lambda: topology.tree(meshed(), agents=["a", "bb"]),
        ["agents[1] = 'bb'", "did you mean 'b'?"],
    ),
    "no agents": (lambda: topology.tree(meshed(), agents=[]), ["agents = []: must be at least one node"]),
    "the root": (
        lambda: topology.flood(meshed(), agents=["a", "r"]),
        ["agents[1] = 'r': must be another node"],
    ),
    "twice": (lambda: topology.tree(meshed(), agents=["a", "b", "a"]), ["agents[2] = 'a'", "than agents[0]"]),
    "no latency": (
        lambda: topology.tree(broken(latency=None, latncy=1.0)),
        ["edge 'a' -- 'w' has 'loss', 'latncy' and no 'latency'; did you mean 'latncy'?"],
    ),
    "no loss": (
        lambda: topology.tree(broken(loss=None)),
        ["'a' -- 'w' has 'latency' and no 'loss'", "set_edge_attributes"],
    ),
    "loss above 1": (
        lambda: topology.flood(broken(loss=1.5)),
        ["loss of edge 'a' -- 'w' = 1.5: must be a finite number at least 0 and at most 1"],
    ),
    "negative latency": (
        lambda: topology.tree(broken(latency=-1)),
        ["latency of edge 'a' -- 'w' = -1.0", "at least 0"],
    ),
    "text": (lambda: topology.tree(broken(latency="1 ms")), ["latency of edge 'a' -- 'w' = '1 ms'"]),
    "infinite": (lambda: topology.tree(broken(latency=math.inf)), ["latency of edge 'a' -- 'w' = inf"]),
    "not a number": (lambda: topology.tree(broken(loss=math.nan)), ["loss of edge 'a' -- 'w' = nan"]),
    "out of reach": (
        lambda: topology.tree(ISLANDS),
        ["agents 'b', 'c': no path leads there from the root 'r'; join them", "leave them out by `agents`"],
    ),
    "many out of reach": (
        lambda: topology.flood(MANY),
        ["agents 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 and 3 more: no path"],
    ),
    "a model as it is": (
        lambda: topology.tree(meshed(), latency=latency.Exponential(0.5)),
        ["must be a function that makes a model of the latency of all arcs; give, for example, latency.Exp"],
    ),
    "no model": (
        lambda: topology.tree(meshed(), loss=lambda row: row),
        ["what loss returns", "a model of loss"],
    ),
    "common mode": (
        lambda: topology.tree(meshed(), loss=lambda row: loss.Combined(row, loss.CommonMode(0.1))),
        [
            "loss = CommonMode(probability=0.1)",
            "arcs are independent",
            "one edge between the root and the rest",
        ],
    ),
    "trace": (
        lambda: topology.flood(meshed(), loss=lambda row: loss.Trace([0], repeat=True)),
        ["loss = Trace("],
    ),
    "arrays of agents": (
        lambda: topology.flood(meshed(), latency=lambda row: latency.Exponential([1.0, 2.0])),
        ["shape of Exponential.mean", "(10,)"],
    ),
    "number of agents": (
        lambda: topology.tree(meshed()).open(3, KEYS),
        ["agents of the network = 4: must be 3; name the agents among the nodes by `agents`"],
    ),
    "moments": (
        lambda: topology.tree(
            meshed(), latency=lambda row: OwnLatency(latency.Exponential(row))
        ).statistics(),
        ["statistics: latency: OwnLatency has no attribute `mean`"],
    ),
    "broadcasts": (lambda: topology.flood(meshed()).statistics(1), ["broadcasts = 1", "at least 2"]),
    "own latency": (
        lambda: arrivals(topology.flood(meshed(), latency=lambda row: Backwards(-row))),
        ["Backwards.draw()[0] = -", "at least 0"],
    ),
    "own shape": (
        lambda: arrivals(topology.flood(meshed(), latency=lambda row: Backwards(row[:3]))),
        ["shape of Backwards.draw() = (3,): must be (10,)"],
    ),
    "own loss": (
        lambda: arrivals(topology.flood(meshed(), loss=lambda row: Nowhere())),
        ["shape of Process.draw() = (1,): must be (10,), one for each arc"],
    ),
}


@pytest.mark.parametrize("case", CHANNEL_ERRORS)
def test_what_channels_refuse(case: str) -> None:
    build, words = CHANNEL_ERRORS[case]
    message = refusal(build)
    for word in words:
        assert word in message


def test_a_copy_that_a_users_latency_never_delivers_is_lost() -> None:
    graph = topology.star(2)
    channel = topology.tree(graph, latency=lambda row: Backwards(np.array([math.inf, 1.0])))
    assert arrivals(channel).tolist() == [[math.inf, 1.0]]


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: topology.star(0), ["n_agents = 0", "at least 1"]),
        (lambda: topology.star(3, [1.0, 2.0]), ["shape of latency = (2,): must be (3,)"]),
        (lambda: topology.star(3, 1.0, [0.0, 0.0, 1.5]), ["loss[2] = 1.5", "at most 1"]),
        (lambda: topology.balanced_tree(0, 2), ["branching = 0"]),
        (lambda: topology.balanced_tree(2, 0), ["height = 0"]),
        (lambda: topology.balanced_tree(2, 2, -1.0), ["latency = -1.0"]),
        (lambda: topology.grid(0, 2), ["rows = 0"]),
        (lambda: topology.grid(1, 1), ["columns = 1", "at least 2", "a node needs a neighbour"]),
        (lambda: topology.grid(2, 2, loss=2.0), ["loss = 2.0"]),
        (lambda: topology.grid(2, 2, root=(2, 2)), ["root = (2, 2): must be one of the 4 nodes"]),
        (lambda: topology.random_geometric(5, 0.0, latency_per_distance=1.0, seed=0), ["radius = 0.0"]),
        (
            lambda: topology.random_geometric(5, 0.5, latency_per_distance=-1.0, seed=0),
            ["latency_per_distance"],
        ),
        (lambda: topology.random_geometric(5, 0.5, latency_per_distance=1.0, seed=-1), ["seed = -1"]),
        (
            lambda: topology.random_geometric(5, 0.5, latency_per_distance=1.0, loss=2.0, seed=1),
            ["loss = 2.0"],
        ),
    ],
)
def test_what_generators_refuse(build: Callable[[], object], words: list[str]) -> None:
    message = refusal(build)
    for word in words:
        assert word in message


HEADER = "source,target,latency,loss\n"


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (
            HEADER + "r,a,1,0\nr,b,fast,0\n",
            {},
            ["net.csv: column 'latency', row 2 = 'fast': must be a number from 0 to 1e+100"],
        ),
        (HEADER + "r,a,1,0\nr,b,1,1.5\n", {}, ["column 'loss', row 2 = '1.5': must be a number from 0 to 1"]),
        (HEADER + "r,a,nan,0\n", {}, ["column 'latency', row 1 = 'nan'"]),
        (HEADER + "r, ,1,0\n", {}, ["column 'target', row 1", "the name of a node"]),
        (HEADER + "r,a,1,0\n", {"latency": "latencies"}, ["column = 'latencies'", "did you mean 'latency'?"]),
        (
            HEADER + "r,a,1,0\n",
            {"source": "from"},
            ["column = 'from'", "one of source, target, latency, loss"],
        ),
        (
            HEADER + "r,a,1,0\na,b,1,0\na,r,1,0\n",
            {},
            ["rows 1 and 3 are the same edge, 'a' -- 'r'", "directed=True"],
        ),
        (
            HEADER + "r,a,1,0\na,r,1,0\nr,a,2,0\n",
            {"directed": True},
            ["rows 1 and 3", "'r' -- 'a'; keep one of them"],
        ),
        (HEADER + "root,a,1,0\n", {}, ["net.csv: root = 'r'", "one of the 2 nodes"]),
        (HEADER, {}, ["has no rows"]),
    ],
)
def test_what_lists_of_edges_refuse(text: str, options: Any, words: list[str], tmp_path: Path) -> None:
    (tmp_path / "net.csv").write_text(text)
    message = refusal(lambda: topology.from_edges(tmp_path / "net.csv", root="r", **options))
    for word in words:
        assert word in message


def graphml(attributes: str, more: str = "") -> str:
    return f"""<graphml xmlns="{GraphML.NS_GRAPHML}">
    <key id="d" for="edge" attr.name="delay" attr.type="double"/>
    <key id="p" for="edge" attr.name="loss" attr.type="string"/>
    <graph edgedefault="undirected"><node id="root"/><node id="a"/>
    <edge source="root" target="a">{attributes}</edge>{more}</graph></graphml>"""


GOOD = '<data key="d">0.5</data>'
LATE = {"latency": "delay"}


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("nonsense", {}, ["net.graphml: cannot be read as GraphML (syntax error"]),
        ("<a/>", {}, ["cannot be read as GraphML"]),
        (graphml('<data key="d">fast</data>'), {}, ["cannot be read as GraphML", "fast"]),
        (graphml('<data key="x">1</data>'), {}, ["cannot be read as GraphML", "x"]),
        (graphml(GOOD), {"latency": "dela"}, ["edge 'root' -- 'a' has 'delay' and no 'dela'; did you mean"]),
        (graphml(GOOD), LATE, ["edge 'root' -- 'a' has 'delay' and no 'loss'", "or name by loss = ..."]),
        (graphml(GOOD), {"scale": -1}, ["scale = -1.0: must be a finite number at least 0"]),
        (graphml(GOOD + '<data key="p">low</data>'), LATE, ["loss of edge 'root' -- 'a' = 'low'"]),
        (graphml('<data key="d">-1</data>'), LATE, ["net.graphml: delay of edge 'root' -- 'a' = -1.0"]),
        (graphml(GOOD), {"root": "roof"}, ["net.graphml: root = 'roof'", "did you mean 'root'?"]),
        (graphml(GOOD, '<edge source="a" target="root"/>'), {},
            ["graphml = 2 between 'root' and 'a'", "in the file"]),
    ],
)  # fmt: skip
def test_what_graphml_files_refuse(text: str, options: Any, words: list[str], tmp_path: Path) -> None:
    (tmp_path / "net.graphml").write_text(text)
    message = refusal(lambda: topology.from_graphml(tmp_path / "net.graphml", **{"root": "root"} | options))
    for word in words:
        assert word in message


def test_files_that_are_not_there(tmp_path: Path) -> None:
    readers: tuple[Any, ...] = (topology.from_graphml, topology.from_edges)
    for read in readers:
        assert "none.x: there is no such file" in refusal(
            lambda read=read: read(tmp_path / "none.x", root="r")
        )


WITHOUT = """<graphml xmlns="{space}">
    <key id="{key}" for="{scope}" {named}{typed}>{default}</key>
    <key id="p" for="edge" attr.name="loss" attr.type="double"><default>0.25</default></key>
    <key id="w" for="edge" attr.name="widths" attr.type="vector_float"/>
    <graph edgedefault="undirected"><node id="root"/><node id="a"/><node id="b"/>
    <edge source="root" target="a"><data key="{key}">2</data><data key="w">1, 2</data></edge>
    <edge source="a" target="b"><data key="p">0.5</data></edge></graph></graphml>"""


@pytest.mark.parametrize("scope", ["edge", "all"])
@pytest.mark.parametrize("typed", ['attr.type="double"', 'attr.type="float128"', ""])
@pytest.mark.parametrize(("key", "named"), [("late", 'attr.name="latency" '), ("latency", "")])
def test_keys_of_graphml_may_do_without_name_type_and_data(
    key: str, named: str, typed: str, scope: str, tmp_path: Path
) -> None:
    """Defaults hold where an edge says nothing, and what networkx cannot read, such as lists, is text."""
    text = WITHOUT.format(
        space=GraphML.NS_GRAPHML,
        key=key,
        named=named,
        typed=typed,
        scope=scope,
        default="<default>3.5</default>",
    )
    (tmp_path / "net.graphml").write_text(text)
    graph = topology.from_graphml(tmp_path / "net.graphml", root="root")
    assert graph.edges["root", "a"] == {"latency": 2.0, "loss": 0.25, "widths": "1, 2"}
    assert graph.edges["a", "b"] == {"latency": 3.5, "loss": 0.5}
    with pytest.raises(InputError, match=r"widths of edge 'root' -- 'a' = '1, 2': must be a finite number"):
        topology.from_graphml(str(tmp_path / "net.graphml"), root="root", latency="widths")
