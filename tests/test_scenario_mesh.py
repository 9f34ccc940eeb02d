"""Meshes: their trees by hand, and at a quarter of the length of the study what eight networks show."""

import networkx as nx
import numpy as np
import pytest

from aimd_des import theory
from aimd_des.study import mean_and_error
from scenarios.common.systems import memory_alone
from scenarios.mesh import (
    FLOOD,
    KNOWN,
    THRICE,
    TREE,
    Case,
    N,
    branches,
    expected,
    measure,
    mesh,
    statistics,
)

LOSS = 0.3
DRAWS = 8
# By Student's t with 7 degrees of freedom a mean is so far off once in 1,000.
Z = 5.4


@pytest.fixture(scope="module")
def runs() -> dict[tuple[str, float], list[dict[str, float]]]:
    cases = [Case(TREE, 0.0, 2000.0), *(Case(way, LOSS, 2000.0) for way in (TREE, THRICE, FLOOD))]
    return {
        (case.way, case.longest_loss): [measure(case, draw, 1000 * draw) for draw in range(DRAWS)]
        for case in cases
    }


def test_the_tree_keeps_the_shortest_paths_and_the_product_of_their_deliveries() -> None:
    graph = mesh(1, LOSS)
    tree = branches(graph)
    assert nx.is_tree(tree)
    known, thrice = (statistics(way, 1, LOSS) for way in (TREE, THRICE))
    for agent, node in enumerate(range(1, N + 1)):
        path = nx.shortest_path(graph, 0, node, weight="latency")
        edges = [graph.edges[edge] for edge in nx.utils.pairwise(path)]
        assert known.delivery[agent] == pytest.approx(np.prod([1.0 - edge["loss"] for edge in edges]))
        assert thrice.delivery[agent] == pytest.approx(np.prod([1.0 - edge["loss"] ** 3 for edge in edges]))
        assert known.latency[agent] == pytest.approx(sum(edge["latency"] for edge in edges))
    # Without loss every edge of the tree is used once.
    assert statistics(TREE, 1, 0.0).transmissions == N
    assert statistics(THRICE, 1, 0.0).transmissions == 3 * N


def test_draws_are_networks_in_which_everybody_is_within_reach() -> None:
    graphs = [mesh(draw, LOSS) for draw in range(3)]
    assert all(nx.is_connected(graph) for graph in graphs)
    assert len({graph.number_of_edges() for graph in graphs}) > 1


def test_theory_of_one_who_knows_its_loss_is_that_without_loss() -> None:
    known, plain = (expected(Case(way, loss, 1.0), 0) for way, loss in ((KNOWN, LOSS), (TREE, 0.0)))
    assert known == plain
    assert plain["from_plain"] == pytest.approx(0.0, abs=1e-9)
    assert plain["signals"] == pytest.approx(float(theory.needed_rate(memory_alone())[0]))


@pytest.mark.slow
def test_the_tree_shifts_shares_as_theory_says_and_three_copies_bring_them_back(
    runs: dict[tuple[str, float], list[dict[str, float]]],
) -> None:
    def differences(name: str, one: tuple[str, float], other: tuple[str, float]) -> list[float]:
        return [a[name] - b[name] for a, b in zip(runs[one], runs[other], strict=True)]

    still, tree, thrice, flood = (TREE, 0.0), (TREE, LOSS), (THRICE, LOSS), (FLOOD, LOSS)
    # As far from the reweighted optimum as without loss from the plain one: that is luck of the same size.
    pairs = zip(runs[tree], runs[still], strict=True)
    mean, error = mean_and_error([one["from_reweighted"] / other["from_plain"] - 1.0 for one, other in pairs])
    assert abs(mean) < Z * error
    # Networks differ by factors, so that every one counts: eight of eight are luck once in 256.
    assert min(differences("from_plain", tree, thrice)) > 0.0
    assert min(differences("sent", flood, thrice)) > 0.0
    # What three copies leave is not more than the shift that theory has for them, beside luck.
    mean, error = mean_and_error(differences("from_plain", thrice, still))
    shift = [expected(Case(THRICE, LOSS, 2000.0), draw)["from_plain"] for draw in range(DRAWS)]
    assert mean < np.mean(shift) + Z * error
    # Negative control: without reweighting averages are far off in every network.
    assert min(differences("from_plain", tree, still)) > 0.03
