"""The study: what is run, and what is made of it."""

from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from aimd_des import InputError, solve_optimum, theory
from aimd_des.plots import colour, shared_legend
from aimd_des.study import mean_and_error
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, run_all, table_of
from scenarios.common.systems import memory_alone
from scenarios.common.tables import estimate, number, pick, shown
from scenarios.mesh.runs import (
    FLOOD,
    OWN,
    TREE,
    Mesh,
    Outcome,
    Statistics,
    branches,
    measure,
    mesh,
    statistics,
)

_PROBLEM = memory_alone()
_HOLD_OFF = 0.5
_WAYS = (TREE, FLOOD, OWN)
_SHOWN = 0.3
# To estimate what arrives by flooding.
_BROADCASTS = 4_000
_MEASURES = ("signals", "utilisation", "peak", "time_above")
_PLAIN, _NEW = "from plain optimum", "from reweighted optimum"


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system over a mesh, along a tree and by flooding, with more and more loss."""
    replications, until = (2, 300.0) if quick else (20, 4000.0)
    losses = (0.0, _SHOWN) if quick else (0.0, 0.1, 0.2, _SHOWN, 0.4, 0.5)
    cases = [Mesh(_PROBLEM, way, loss, _HOLD_OFF, until, until / 4) for way in _WAYS for loss in losses]
    pairs = run_all(measure, cases, replications, seed, quick, runs)
    parts = [_totals(case, found) for case, found in pairs]
    parts += [_each(case, found) for case, found in pairs if case.longest_loss == _SHOWN and case.way != OWN]
    table = pd.concat(parts, ignore_index=True)
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = shown(table[table["agent"] < 0], ["way", "longest_loss", "measure"])
    return Finding("mesh", settings, table, printed, _findings(table), {"mesh": partial(_figure, table)})


@lru_cache
def _known(way: str, loss: float) -> Statistics:
    # Of what is shown both ways are sampled; a tree needs it for nothing else.
    many = _BROADCASTS if loss > 0.0 and (way == FLOOD or (way == TREE and loss == _SHOWN)) else 2
    return statistics(mesh(_PROBLEM.n_agents, loss), TREE if way == OWN else way, many)


def _totals(run: Mesh, found: list[Outcome]) -> pd.DataFrame:
    labels = {"way": run.way, "longest_loss": run.longest_loss, "agent": -1}
    known = _known(run.way, run.longest_loss)
    optima = {_PLAIN: None, _NEW: known.delivery}
    table = table_of(labels, _PROBLEM, found, _MEASURES, optima, _expected(run, known))
    fixed = {"mean delivery": known.delivery.mean(), "transmissions": known.transmissions}
    more = [estimate(labels, name, (value, np.nan), len(found)) for name, value in fixed.items()]
    return pd.concat([table, pd.DataFrame(more)])


def _expected(run: Mesh, known: Statistics) -> dict[str, float]:
    """Predict what there is a formula for, with the mean of the latencies for all."""
    weighted = theory.reweighted_optimum(_PROBLEM, known.delivery).allocation
    shift = {_PLAIN: float(distance(_PROBLEM, weighted)[0]), _NEW: 0.0}
    try:
        # In balance everybody gives back alpha, however little of it hears: latencies count alike.
        made = theory.predict(
            _PROBLEM,
            "continuous",
            latency=float(known.latency.mean()),
            loss=1.0 - known.delivery,
            hold_off=run.hold_off,
        )
    except InputError:
        return shift
    return {**shift, "signals": float(made.signals[0]), "utilisation": float(made.utilisation[0])}


def _each(run: Mesh, found: list[Outcome]) -> pd.DataFrame:
    """List delivery, latency and share of every agent."""
    known = _known(run.way, run.longest_loss)
    plain = solve_optimum(_PROBLEM).allocation[:, 0] / _PROBLEM.capacity[0]
    new = theory.reweighted_optimum(_PROBLEM, known.delivery).allocation[:, 0] / _PROBLEM.capacity[0]
    shares = [one.average[:, 0] / one.average.sum() / plain for one in found]
    nothing = np.full(_PROBLEM.n_agents, np.nan)
    columns = {
        "delivery": (*mean_and_error([one.delivery for one in found]), known.delivery),
        "latency": (known.sampled_latency, nothing, known.latency if run.way == TREE else nothing),
        "share over optimal share": (*mean_and_error(shares), new / plain),
    }
    labels = {"way": run.way, "longest_loss": run.longest_loss}
    return pd.DataFrame(
        [
            estimate({**labels, "agent": agent}, name, (at, wrong), len(found), float(wanted))
            for name, (mean, error, expected) in columns.items()
            for agent, (at, wrong, wanted) in enumerate(zip(mean, error, expected, strict=True))
        ]
    )


def _figure(table: pd.DataFrame) -> Figure:
    figure, (network, delivery, shares, shift) = figures.panels(2, 2, (13.0, 9.0))
    _draw_network(figure, network)
    _draw_each(delivery, table, "latency", "delivery")
    title, heard = "(b) Far away less arrives; by flooding nearly all", "share of signals that arrive"
    figures.dress(delivery, title, "mean latency (control periods)", heard)
    _draw_each(shares, table, "delivery", "share over optimal share")
    figures.level(shares, 1.0)
    figures.dress(shares, "(c) Who hears less takes more", heard, "share of memory over optimal share")
    _draw_shift(shift, table)
    shared_legend(figure)
    return figure


def _draw_network(figure: Figure, axes: Axes) -> None:
    graph = mesh(_PROBLEM.n_agents, _SHOWN)
    tree = branches(graph)
    places = {node: np.array(data["pos"]) for node, data in graph.nodes(data=True)}
    for edges, shade, width in ((graph.edges, "0.75", 2.2), (tree.edges, colour(0), 3.4)):
        kept = [1.0 - graph.edges[edge]["loss"] / (1.15 * _SHOWN) for edge in edges]
        lines = [(places[u], places[v]) for u, v in edges]
        axes.add_collection(LineCollection(lines, colors=shade, linewidths=[width * part for part in kept]))
    spots = np.array([places[node] for node in graph if node != 0])
    heard = _known(TREE, _SHOWN).delivery
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
    axes.set_title("(a) The mesh; thin edges lose most (up to 30 %)", loc="left", fontsize="medium")
    figures.named(axes, "edge of the tree", color=colour(0), linewidth=2.5)
    figures.named(axes, "other edge", color="0.75", linewidth=2.0)
    figure.colorbar(drawn, ax=axes, shrink=0.85, label="share that arrives along the tree")


def _draw_each(axes: Axes, table: pd.DataFrame, across: str, up: str) -> None:
    """Draw one point for each camera, and what theory has for it."""
    for place, way in enumerate((TREE, FLOOD)):
        x, y = (pick(table, way=way, measure=name) for name in (across, up))
        axes.plot(x["mean"], y["mean"], figures.MARKS[place], color=colour(place), markersize=5.5, label=way)
        if way == TREE or up != "delivery":
            known = x["mean"] if way == FLOOD else x["theory"]
            axes.plot(known, y["theory"], "+", color="black", markersize=9.0, label="theory, for each camera")


def _draw_shift(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(_WAYS):
        rows = pick(table, way=way, measure=_PLAIN)
        x, hollow = 100 * rows["longest_loss"], {"markerfacecolor": "none", "markersize": 10.0}
        figures.points(axes, x, rows, place, way, scale=100.0, **(hollow if way == OWN else {}))
        if way != OWN:
            figures.theory(axes, x, rows, place, scale=100.0)
    figures.named(axes, "theory: the reweighted optimum")
    across, up = "loss on the longest edges (%)", "distance of the averages from the optimum (%)"
    figures.dress(axes, "(d) Flooding brings the optimum back", across, up, ylim=(0.0, None))


def _findings(table: pd.DataFrame) -> list[str]:
    def at(way: str, measure: str, column: str = "mean") -> float:
        return number(table, column, way=way, measure=measure, longest_loss=_SHOWN)

    heard = {way: pick(table, way=way, measure="delivery")["mean"] for way in (TREE, FLOOD)}
    held = "share over optimal share"
    shares = {way: pick(table, way=way, measure=held)["mean"] for way in (TREE, FLOOD)}
    along = pick(table, way=TREE, measure="delivery")
    errors = (along["mean"] - along["theory"]).abs()
    sent = {way: at(way, "transmissions") for way in (TREE, FLOOD)}
    found = [
        f"{way}, {100 * _SHOWN:g} % on the longest edges: {100 * heard[way].min():.0f} to "
        f"{100 * heard[way].max():.0f} % of the signals arrive, cameras hold {shares[way].min():.2f} to "
        f"{shares[way].max():.2f} of their optimal shares, and averages are "
        f"{100 * at(way, _PLAIN):.1f} % from the optimum (theory {100 * at(way, _PLAIN, 'theory'):.1f}) "
        f"and {100 * at(way, _NEW):.1f} % from the reweighted one; {at(way, 'signals'):.2f} signals per "
        f"unit of time (theory {at(way, 'signals', 'theory'):.2f}), utilisation "
        f"{at(way, 'utilisation'):.3f} (theory {at(way, 'utilisation', 'theory'):.3f})."
        for way in (TREE, FLOOD)
    ]
    return found + sentences(f"""
        - Deliveries along the tree are those of the formula to within {100 * errors.max():.1f} points.
        - Links that are shared on the way: {at(TREE, "signals"):.2f} signals instead of
          {at(OWN, "signals"):.2f}, utilisation {at(TREE, "utilisation"):.3f} instead of
          {at(OWN, "utilisation"):.3f}, and {100 * at(TREE, "time_above"):.1f} % of the time above capacity
          instead of {100 * at(OWN, "time_above"):.1f}.
        - Flooding takes {sent[FLOOD]:.0f} transmissions a broadcast instead of {sent[TREE]:.0f}, and
          {sent[FLOOD] * at(FLOOD, "signals"):.0f} per unit of time instead of
          {sent[TREE] * at(TREE, "signals"):.0f}, as fewer signals are necessary.
    """)


main = command("mesh", study, "What does a lossy mesh do to cameras far away, and does flooding help?")
