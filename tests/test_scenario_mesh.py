"""The mesh: a fifth of the size of the study, seeds 0 to 5, and its network by hand."""

from functools import partial

import networkx as nx
import numpy as np
import pytest

from aimd_des import theory
from aimd_des.study import mean_and_error, replicate
from scenarios.common.systems import memory_alone
from scenarios.mesh.runs import FLOOD, TREE, Mesh, Outcome, branches, measure, mesh, statistics

PROBLEM = memory_alone()
LOSS = 0.4
REPLICATIONS = 6
# By Student's t with 5 degrees of freedom |z| is above this once in 250.
Z = 5.0


def runs(way: str) -> list[Outcome]:
    run = Mesh(PROBLEM, way, LOSS, 0.5, 1500.0, 500.0)
    (found,) = replicate([partial(measure, run)], REPLICATIONS, seed=0, workers=1)
    return found


def held_by_the_deafest(found: list[Outcome]) -> tuple[float, float]:
    """Share of the twenty cameras that hear least along the tree: mean and standard error."""
    mean, error = mean_and_error([one.average[deafest(), 0].sum() / one.average.sum() for one in found])
    return float(mean), float(error)


def deafest() -> np.ndarray:
    return np.argsort(statistics(mesh(PROBLEM.n_agents, LOSS), TREE, 2).delivery)[:20]


def predicted(weights: np.ndarray) -> float:
    allocation = theory.reweighted_optimum(PROBLEM, weights).allocation
    return float(allocation[deafest()].sum() / allocation.sum())


def test_the_tree_keeps_the_shortest_paths_and_the_product_of_their_deliveries() -> None:
    graph = mesh(PROBLEM.n_agents, LOSS)
    tree = branches(graph)
    assert nx.is_tree(tree)
    known = statistics(graph, TREE, 2000)
    for agent, node in enumerate(range(1, PROBLEM.n_agents + 1)):
        path = nx.shortest_path(graph, 0, node, weight="latency")
        edges = [graph.edges[edge] for edge in nx.utils.pairwise(path)]
        assert known.delivery[agent] == pytest.approx(np.prod([1.0 - edge["loss"] for edge in edges]))
        assert known.latency[agent] == pytest.approx(sum(edge["latency"] for edge in edges))
    # 60 frequencies from 2,000 broadcasts each, dependent as links are shared: below 4.5 standard errors.
    error = np.sqrt(known.delivery * (1.0 - known.delivery) / 2000)
    assert (np.abs(known.sampled_delivery - known.delivery) < 4.5 * error).all()
    assert known.sampled_latency == pytest.approx(known.latency)


@pytest.mark.slow
def test_who_hears_less_takes_what_theory_says_and_flooding_gives_it_back() -> None:
    graph = mesh(PROBLEM.n_agents, LOSS)
    tree, tree_error = held_by_the_deafest(runs(TREE))
    flood, flood_error = held_by_the_deafest(runs(FLOOD))
    plain = predicted(np.ones(PROBLEM.n_agents))
    # A hundredth of the share is left to what theory neglects: teeth, and the way to the averages.
    for mean, error, way in ((tree, tree_error, TREE), (flood, flood_error, FLOOD)):
        expected = predicted(statistics(graph, way, 2000).delivery)
        assert abs(mean - expected) <= 0.01 * expected + Z * error
    # Negative control: with equal weights.
    assert tree - plain > 0.05 * plain + Z * tree_error
    assert flood < 0.5 * (tree + plain) - Z * np.hypot(tree_error, flood_error)
