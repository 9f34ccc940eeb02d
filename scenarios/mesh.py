"""What does a lossy mesh do to cameras far away, and does flooding help?

Along the tree of shortest paths each edge may lose the signal, so cameras far away receive less and take
more. Shares are those of costs weighted by the probability of delivery, a product over the path.
Networks differ in this by factors.  Sending over each edge of the tree three times corrects the shares in
all of them, for half of the transmissions of flooding, which does not help cameras on a single edge.
Knowing the loss is cheapest, where response probabilities can rise.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Recording, solve_optimum, theory, topology
from aimd_des.compensation import KnownLoss
from aimd_des.loss import Bernoulli
from aimd_des.lowlevel import Channel, FloatArray
from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, quietly, rows_of, run_draws, sensed, signal_rate, totals
from scenarios.common.systems import memory_alone
from scenarios.common.tables import number, over_draws, pick, shown, table_of

TREE, OWN = "shortest-path tree", "own links, as lossy as the tree"
THRICE, FLOOD, KNOWN = "tree, every edge sent three times", "flooding", "tree, agents know their loss"
WAYS = (TREE, THRICE, FLOOD, KNOWN, OWN)

N = 60
HOLD_OFF = 0.5
#: Greatest distance of neighbours, in sides of the square.
RADIUS = 0.2
_LATENCY_PER_DISTANCE = 0.5
# So many seeds are tried for each draw of a network in which all agents are within reach.
_SEEDS_A_DRAW = 1_000
_COPIES = 3
# Looks at the total, five of which fall into a hold-off.
_LOOKS = 0.1


@lru_cache
def mesh(draw: int, longest_loss: float) -> Any:
    """Scatter cameras over a square around the control unit, node 0, in a graph of networkx.

    The loss on an edge grows with the square of its length, to `longest_loss` on one as long as the radius.
    """
    for seed in range(_SEEDS_A_DRAW * draw, _SEEDS_A_DRAW * (draw + 1)):
        graph: Any = topology.random_geometric(
            N, RADIUS, latency_per_distance=_LATENCY_PER_DISTANCE, seed=seed
        )
        if nx.is_connected(graph):
            break
    for _, _, edge in graph.edges(data=True):
        edge["loss"] = longest_loss * (edge["latency"] / (_LATENCY_PER_DISTANCE * RADIUS)) ** 2
    return graph


def branches(graph: Any) -> Any:
    """Keep all nodes, and the edges of the tree of shortest paths."""
    paths = nx.single_source_dijkstra_path(graph, 0, weight="latency")
    tree = graph.copy()
    tree.remove_edges_from(list(graph.edges))
    for path in paths.values():
        if len(path) > 1:
            edge = path[-2], path[-1]
            tree.add_edge(*edge, **graph.edges[edge])
    return tree


class Statistics(NamedTuple):
    """How many copies arrive, and how late; arrays have shape (n,)."""

    # Probability of arrival, and the mean latency of what arrives, in units of time: exact for a tree,
    # estimated for a flood.
    delivery: FloatArray
    latency: FloatArray
    transmissions: float  # copies that are sent over edges, for each broadcast


@lru_cache
def statistics(way: str, draw: int, longest_loss: float, broadcasts: int = 4_000) -> Statistics:
    """Compute what becomes of broadcasts; for a flood, estimate it from so many.

    A node sends to all its neighbours in what it forwards over, but not back to the control unit.
    """
    graph = mesh(draw, longest_loss)
    if way == FLOOD:
        known = topology.flood(graph).statistics(broadcasts, seed=0)
        onward = [graph.degree(node) - (0 in graph[node]) for node in graph]
    else:
        copies, used = _COPIES if way == THRICE else 1, branches(graph)
        known = _tree(graph, copies).statistics()
        depth = nx.single_source_shortest_path_length(used, 0)
        onward = [copies * sum(depth[other] > depth[node] for other in used[node]) for node in used]
    delivery = known["delivery"].to_numpy(dtype=np.float64)
    latency = known["latency_mean"].to_numpy(dtype=np.float64)
    return Statistics(delivery, latency, float(np.append(1.0, delivery) @ np.array(onward, dtype=np.float64)))


def _tree(graph: Any, copies: int) -> topology.TreeChannel:
    """Send every copy so many times over each edge: it is lost if all are."""
    return topology.tree(graph, loss=lambda p: Bernoulli(p**copies))


class Case(NamedTuple):
    """How broadcasts travel, the loss as of `mesh`, and the end in units of time."""

    way: str
    longest_loss: float
    until: float

    @property
    def start(self) -> float:
        """From when on the run is measured."""
        return self.until / 4.0

    def heard(self, draw: int) -> FloatArray:
        """Compute what responses have of the signals: all of them where agents know their loss, (n,)."""
        known = self.way == KNOWN
        return np.ones(N) if known else statistics(self.way, draw, self.longest_loss).delivery

    def channel(self, draw: int) -> Channel:
        """Make the channel; own links have the tree's probabilities and latencies, and share nothing."""
        graph = mesh(draw, self.longest_loss)
        if self.way == FLOOD:
            return topology.flood(graph)
        if self.way == OWN:
            known = statistics(TREE, draw, self.longest_loss)
            return BroadcastChannel(latency=known.latency, loss=1.0 - known.delivery)
        return _tree(graph, _COPIES if self.way == THRICE else 1)


def measure(case: Case, draw: int, seed: int) -> dict[str, float]:
    """Run and measure, with a draw of costs and network; after the start but for averages."""
    problem, known = memory_alone(draw=draw), statistics(case.way, draw, case.longest_loss)
    simulation = sensed(
        problem,
        HOLD_OFF,
        channel=case.channel(draw),
        compensation=KnownLoss(1.0 - known.delivery) if case.way == KNOWN else None,
        seed=seed,
        recording=Recording(demand=np.arange(case.start, case.until, _LOOKS), overshoot=False),
    )
    result = quietly(simulation, case.until)
    signals, total, average = signal_rate(result, case.start), totals(result), result.average_at_end
    share = (average / solve_optimum(problem, capacity=average.sum(axis=0)).allocation)[:, 0]
    return {
        "signals": signals,  # per unit of time
        "sent": signals * known.transmissions,  # transmissions over edges per unit of time
        "utilisation": total.mean(),
        "high": np.quantile(
            total, 0.99
        ),  # what total demand is below for 99 % of the time, over the capacity
        "above": (total > 1.0).mean(),  # share of the time above the capacity
        "from_plain": distance(problem, average)[0],
        "from_reweighted": distance(problem, average, case.heard(draw))[0],
        # Of all cameras: share over that of the optimum for what is used, and probability of delivery.
        "least": share.min(),
        "most": share.max(),
        "least_delivery": known.delivery.min(),
        # Share of the responses with a probability above 1.
        "saturated": result.account.saturated.sum() / result.account.responses.sum(),
        "transmissions": known.transmissions,  # copies over edges for each broadcast
    }


def expected(case: Case, draw: int) -> dict[str, float]:
    """Predict what there is a formula for: signals per unit of time, and how far shares are shifted."""
    problem = memory_alone(draw=draw)
    best = theory.reweighted_optimum(problem, case.heard(draw))
    alpha, beta, gamma = problem.increase[0], problem.decrease[0], problem.normalization
    signals = theory.signal_rate(alpha, beta, gamma, best.multipliers)
    return {"signals": float(signals[0]), "from_plain": float(distance(problem, best.allocation)[0])}


_SHOWN = 0.3
_LABELS = ["way", "longest_loss", "until"]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory alone over meshes, along a tree and by flooding, with more and more loss."""
    draws, until = (2, 300.0) if quick else (12, 8000.0)
    lossy = (0.0, _SHOWN) if quick else (0.0, 0.1, 0.2, _SHOWN, 0.5)
    cases = [Case(way, loss, until) for way in WAYS for loss in lossy]
    # What depends on the age of a run is seen in a shorter one.
    cases += [Case(way, _SHOWN, until / 4.0) for way in WAYS]
    pairs = run_draws(measure, cases, draws, 1, seed, quick, runs)
    table = table_of(pairs, _LABELS, seed, expected)
    settings = {"seed": seed, "draws": draws, "until": until}
    printed = shown(pick(table, longest_loss=_SHOWN, until=until), ["way", "measure"], ".3f")
    drawn = {"mesh": partial(_figure, table, pd.DataFrame(rows_of(pairs)), until)}
    return Finding("mesh", settings, table, printed, _findings(table, until), drawn)


def _figure(table: pd.DataFrame, rows: pd.DataFrame, until: float) -> Figure:
    figure, (network, delivery, shift, price) = figures.panels(2, 2, (13.0, 9.4))
    _draw_network(figure, network)
    for place, way in enumerate((TREE, THRICE, FLOOD)):
        known = statistics(way, 0, _SHOWN)
        look: dict[str, Any] = {"color": colour(place), "markersize": 5.5, "label": way}
        delivery.plot(known.latency, known.delivery, figures.MARKS[place], **look)
    title = "(b) Far away less arrives; the network of (a)"
    figures.dress(delivery, title, "mean latency (control periods)", "share of signals that arrive")
    for place, way in enumerate(WAYS):
        part = pick(table, way=way, until=until, measure="from_plain")
        hollow = {"markerfacecolor": "none", "markersize": 10.0} if way == OWN else {}
        draw = figures.curve if way in (TREE, THRICE, FLOOD) else figures.points
        draw(shift, 100 * part["longest_loss"], part, place, way, scale=100.0, **hollow)
        single = pick(rows, way=way, until=until, longest_loss=_SHOWN)
        if way != OWN:
            look = {"color": colour(place), "label": way}
            price.plot(single["sent"], 100 * single["from_plain"], figures.MARKS[place], **look)
    figures.named(shift, "theory: the reweighted optimum")
    away = "distance of the averages from the optimum (%)"
    across = "loss on the longest edges (%)"
    figures.dress(shift, "(c) Three copies over each edge beat flooding", across, away, ylim=(0.0, None))
    sent = "transmissions over edges per control period"
    title = f"(d) What it costs at {100 * _SHOWN:g} %: a point for each network"
    figures.dress(price, title, sent, away, xscale="log", ylim=(0.0, None))
    figures.legends((delivery, shift, price))
    return figure


def _draw_network(figure: Figure, axes: Axes) -> None:
    graph = mesh(0, _SHOWN)
    tree = branches(graph)
    places = {node: np.array(data["pos"]) for node, data in graph.nodes(data=True)}
    for edges, shade, width in ((graph.edges, "0.75", 2.2), (tree.edges, colour(0), 3.4)):
        kept = [1.0 - graph.edges[edge]["loss"] / (1.15 * _SHOWN) for edge in edges]
        lines = [(places[u], places[v]) for u, v in edges]
        axes.add_collection(LineCollection(lines, colors=shade, linewidths=[width * part for part in kept]))
    spots = np.array([places[node] for node in graph if node != 0])
    heard = statistics(TREE, 0, _SHOWN).delivery
    look: dict[str, Any] = {"cmap": "cividis", "edgecolors": "black", "linewidths": 0.6}
    drawn = axes.scatter(spots[:, 0], spots[:, 1], 58.0, heard, zorder=3, **look)
    axes.plot(*places[0], "s", color=colour(1), markersize=11, markeredgecolor="black", zorder=4)
    axes.annotate(
        "control unit",
        tuple(places[0].tolist()),
        (-14, -20),
        textcoords="offset points",
        fontsize="small",
        zorder=5,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85},
    )
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    title = f"(a) A mesh; thin edges lose most (up to {100 * _SHOWN:g} %), blue ones are the tree"
    axes.set_title(title, loc="left", fontsize="medium")
    figure.colorbar(drawn, ax=axes, shrink=0.85, label="share that arrives along the tree")


def _findings(table: pd.DataFrame, until: float) -> list[str]:
    def say(way: str, name: str, scale: float = 1.0, digits: int = 2, **other: float) -> str:
        at = {"longest_loss": _SHOWN, "until": until, **other}
        return over_draws(table, scale, digits, way=way, measure=name, **at)

    def theory(way: str, name: str, scale: float = 1.0) -> float:
        return scale * number(table, "theory", way=way, measure=name, longest_loss=_SHOWN, until=until)

    draws = int(number(table, "draws", way=TREE))
    found = [
        f"{way}: averages are {say(way, 'from_plain', 100.0, 1)} % from the optimum, with "
        f"{say(way, 'transmissions', 1.0, 0)} transmissions a broadcast, {say(way, 'sent', 1.0, 0)} a period "
        f"and {say(way, 'signals')} signals a period (theory {theory(way, 'signals'):.2f})."
        for way in WAYS[:-1]
    ]
    return [
        f"{100 * _SHOWN:g} % on the longest edges, {draws} draws of network and costs, {until:g} periods.",
        *found,
        *sentences(f"""
            - Along the tree the least that arrives at a camera is {say(TREE, "least_delivery")}; shares are
              {say(TREE, "least")} to {say(TREE, "most")} of the optimal ones. Theory has
              {theory(TREE, "from_plain", 100.0):.1f} % for the distance from the optimum, and averages are
              {say(TREE, "from_reweighted", 100.0, 1)} % from the reweighted one, as without loss
              ({say(TREE, "from_plain", 100.0, 1, longest_loss=0.0)} %). After a quarter of the time it is
              {say(TREE, "from_plain", 100.0, 1, until=until / 4)} and, with every edge sent three times,
              {say(THRICE, "from_plain", 100.0, 1, until=until / 4)} %.
            - By flooding the least that arrives is {say(FLOOD, "least_delivery")}, with every edge sent three
              times {say(THRICE, "least_delivery")}.
            - Knowing the loss leaves {say(KNOWN, "saturated", 100.0, 1)} % of the responses at their bound.
            - Links that are shared on the way: above the capacity for {say(TREE, "above", 100.0, 1)} % of the
              time instead of {say(OWN, "above", 100.0, 1)}, with {say(TREE, "signals")} signals instead of
              {say(OWN, "signals")}.
        """),
    ]


main = command("mesh", study, __doc__)

if __name__ == "__main__":
    main()
