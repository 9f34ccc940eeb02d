"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from aimd_des.plots import colour
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_draws
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws
from scenarios.mesh.runs import (
    FLOOD,
    KNOWN,
    OWN,
    THRICE,
    TREE,
    WAYS,
    Case,
    branches,
    expected,
    measure,
    mesh,
    statistics,
)

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
    rows = [
        {**case._asdict(), "draw": draw, **one._asdict()}
        for case, found in pairs
        for draw, (one,) in enumerate(found, seed)
    ]
    known = [
        {**case._asdict(), "draw": draw, **expected(case, draw)}
        for case in cases
        for draw in range(seed, seed + draws)
    ]
    wanted = summarise_draws(known, _LABELS)[[*_LABELS, "measure", "mean"]].rename(columns={"mean": "theory"})
    table = summarise_draws(rows, _LABELS).merge(wanted, "left", on=[*_LABELS, "measure"])
    settings = {"seed": seed, "draws": draws, "until": until}
    printed = shown(pick(table, longest_loss=_SHOWN, until=until), ["way", "measure"], ".3f")
    drawn = {"mesh": partial(_figure, table, pd.DataFrame(rows), until)}
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
        figures.points(shift, 100 * part["longest_loss"], part, place, way, scale=100.0, **hollow)
        if way in (TREE, THRICE, FLOOD):
            figures.theory(shift, 100 * part["longest_loss"], part, place, scale=100.0)
        single = rows[(rows["way"] == way) & (rows["until"] == until) & (rows["longest_loss"] == _SHOWN)]
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
    for axes in (delivery, shift, price):
        axes.legend(frameon=False, fontsize="small")
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


main = command("mesh", study, "What does a lossy mesh do to cameras far away, and does flooding help?")
