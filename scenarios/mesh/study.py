"""The study: what is run, and what is made of it."""

from functools import lru_cache, partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from aimd_des import theory
from aimd_des.errors import InputError
from aimd_des.optimum import solve_optimum
from aimd_des.plots import colour, shared_legend
from aimd_des.plots.style import REFERENCE, frame, number_axis
from scenarios.common.command import Study, command
from scenarios.common.measure import distance
from scenarios.common.replicate import jackknife, mean_and_error, replicate, summarise
from scenarios.common.systems import memory_alone
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

__all__ = ["main", "study"]

_PROBLEM = memory_alone()
_HOLD_OFF = 0.5
_WAYS = (TREE, FLOOD, OWN)
_SHOWN = 0.3
# To estimate what arrives by flooding.
_BROADCASTS = 4_000
_MEASURES = ("signals", "utilisation", "peak", "time_above")
_PLAIN, _NEW = "from plain optimum", "from reweighted optimum"


def study(quick: bool = False, seed: int = 0) -> Study:
    """Run memory of the paper's system over a mesh, along a tree and by flooding, with more and more loss.

    Parameters
    ----------
    quick : bool
        Whether to run the small size.
    seed : int
        Of the first replication.

    Returns
    -------
    Study
        A pure function of the arguments.
    """
    replications, until = (2, 300.0) if quick else (20, 4000.0)
    losses = (0.0, _SHOWN) if quick else (0.0, 0.1, 0.2, _SHOWN, 0.4, 0.5)
    runs = [Mesh(_PROBLEM, way, loss, _HOLD_OFF, until, until / 4) for way in _WAYS for loss in losses]
    jobs = [partial(measure, run) for run in runs]
    outcomes = replicate(jobs, replications, seed, workers=1 if quick else None)
    parts = [_totals(run, found) for run, found in zip(runs, outcomes, strict=True)]
    for run, found in zip(runs, outcomes, strict=True):
        if run.longest_loss == _SHOWN and run.way != OWN:
            parts.append(_each(run, found))
    table = pd.concat(parts, ignore_index=True)
    return Study(
        "mesh",
        {"seed": seed, "replications": replications, "until": until},
        table,
        _shown(table),
        _findings(table),
        {"mesh": _figure(table)},
    )


def _known(way: str, loss: float) -> Statistics:
    return _statistics(TREE if way == OWN else way, loss)


@lru_cache
def _statistics(way: str, loss: float) -> Statistics:
    # Of what is shown both ways are sampled; a tree needs it for nothing else.
    sampled = loss > 0.0 and (way == FLOOD or loss == _SHOWN)
    return statistics(mesh(_PROBLEM.n_agents, loss), way, _BROADCASTS if sampled else 2)


def _totals(run: Mesh, found: list[Outcome]) -> pd.DataFrame:
    labels = {"way": run.way, "longest_loss": run.longest_loss, "agent": -1}
    rows = summarise([{**labels, **{m: getattr(one, m) for m in _MEASURES}} for one in found], list(labels))
    known, averages, more = _known(run.way, run.longest_loss), [one.average for one in found], []
    for name, weights in ((_PLAIN, None), (_NEW, known.delivery)):
        value, error = jackknife(averages, partial(distance, _PROBLEM, weights=weights))
        more.append({**labels, "measure": name, "mean": value[0], "standard_error": error[0]})
    fixed = {"mean delivery": known.delivery.mean(), "transmissions": known.transmissions}
    more += [{**labels, "measure": name, "mean": value} for name, value in fixed.items()]
    table = pd.concat([rows, pd.DataFrame(more).assign(replications=len(found))])
    expected = _expected(run, known)
    table["theory"] = [expected.get(name, np.nan) for name in table["measure"]]
    return table


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
            refractory=run.hold_off,
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
    return pd.concat(
        pd.DataFrame(
            {
                **labels,
                "agent": np.arange(_PROBLEM.n_agents),
                "measure": name,
                "mean": mean,
                "standard_error": error,
                "replications": len(found),
                "theory": expected,
            }
        )
        for name, (mean, error, expected) in columns.items()
    )


def _pick(table: pd.DataFrame, way: str, measure: str) -> pd.DataFrame:
    return table[(table["way"] == way) & (table["measure"] == measure)]


def _figure(table: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(13.0, 9.0), layout="constrained")
    (network, delivery), (shares, shift) = figure.subplots(2, 2)
    _draw_network(figure, network)
    _draw_each(delivery, table, "latency", "delivery")
    delivery.set_xlabel("mean latency (control periods)")
    delivery.set_ylabel("share of signals that arrive")
    delivery.set_title("(b) Far away less arrives; by flooding nearly all", loc="left", fontsize="medium")
    _draw_each(shares, table, "delivery", "share over optimal share")
    shares.set_xlabel("share of signals that arrive")
    shares.set_ylabel("share of memory over optimal share")
    shares.set_title("(c) Who hears less takes more", loc="left", fontsize="medium")
    shares.axhline(1.0, color=REFERENCE, linewidth=1.0, linestyle=":")
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
    axes.plot([], [], color=colour(0), linewidth=2.5, label="edge of the tree")
    axes.plot([], [], color="0.75", linewidth=2.0, label="other edge")
    figure.colorbar(drawn, ax=axes, shrink=0.85, label="share that arrives along the tree")


def _draw_each(axes: Axes, table: pd.DataFrame, across: str, up: str) -> None:
    """Draw one point for each camera, and what theory has for it."""
    for place, way in enumerate((TREE, FLOOD)):
        x, y = _pick(table, way, across), _pick(table, way, up)
        axes.plot(x["mean"], y["mean"], "os"[place], color=colour(place), markersize=5.5, label=way)
        if way == TREE or up != "delivery":
            known = x["mean"] if way == FLOOD else x["theory"]
            axes.plot(known, y["theory"], "+", color="black", markersize=9.0, label="theory, for each camera")
    number_axis(axes.xaxis)
    number_axis(axes.yaxis)
    frame(axes)


def _draw_shift(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(_WAYS):
        rows = _pick(table, way, _PLAIN)
        x, bars = 100 * rows["longest_loss"], 200 * rows["standard_error"]
        look: dict[str, Any] = {"fmt": "os^"[place], "color": colour(place), "capsize": 2.5, "label": way}
        if way == OWN:
            look |= {"markerfacecolor": "none", "markersize": 10.0}
        else:
            axes.plot(x, 100 * rows["theory"], color=colour(place), linewidth=1.5)
        axes.errorbar(x, 100 * rows["mean"], bars, **look)
    axes.plot([], [], color=REFERENCE, linewidth=1.5, label="theory: the reweighted optimum")
    axes.set_xlabel("loss on the longest edges (%)")
    axes.set_ylabel("distance of the averages from the optimum (%)")
    axes.set_ylim(bottom=0.0)
    axes.set_title("(d) Flooding brings the optimum back", loc="left", fontsize="medium")
    number_axis(axes.xaxis)
    number_axis(axes.yaxis)
    frame(axes)


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    rows = table[table["agent"] < 0]
    return pd.DataFrame(
        [
            {
                "way": row["way"],
                "loss": f"{row['longest_loss']:g}",
                "measure": row["measure"].replace("_", " "),
                "theory": "" if np.isnan(row["theory"]) else f"{row['theory']:.4f}",
                "simulation": f"{row['mean']:.4f}"
                + ("" if np.isnan(row["standard_error"]) else f" ± {row['standard_error']:.4f}"),
            }
            for row in rows.to_dict("records")
        ]
    )


def _findings(table: pd.DataFrame) -> list[str]:
    def at(way: str, measure: str, column: str = "mean") -> float:
        rows = _pick(table, way, measure)
        return float(rows.loc[rows["longest_loss"] == _SHOWN, column].iloc[0])

    heard = {way: _pick(table, way, "delivery")["mean"] for way in (TREE, FLOOD)}
    shares = {way: _pick(table, way, "share over optimal share")["mean"] for way in (TREE, FLOOD)}
    errors = (_pick(table, TREE, "delivery")["mean"] - _pick(table, TREE, "delivery")["theory"]).abs()
    sent = {way: at(way, "transmissions") for way in (TREE, FLOOD)}
    return [
        *(
            f"{way}, {100 * _SHOWN:g} % on the longest edges: {100 * heard[way].min():.0f} to "
            f"{100 * heard[way].max():.0f} % of the signals arrive, cameras hold {shares[way].min():.2f} to "
            f"{shares[way].max():.2f} of their optimal shares, and averages are "
            f"{100 * at(way, _PLAIN):.1f} % from the optimum (theory {100 * at(way, _PLAIN, 'theory'):.1f}) "
            f"and {100 * at(way, _NEW):.1f} % from the reweighted one; {at(way, 'signals'):.2f} signals per "
            f"unit of time (theory {at(way, 'signals', 'theory'):.2f}), utilisation "
            f"{at(way, 'utilisation'):.3f} (theory {at(way, 'utilisation', 'theory'):.3f})."
            for way in (TREE, FLOOD)
        ),
        f"Deliveries along the tree are those of the formula to within {100 * errors.max():.1f} points.",
        (
            f"Links that are shared on the way: {at(TREE, 'signals'):.2f} signals instead of "
            f"{at(OWN, 'signals'):.2f}, utilisation {at(TREE, 'utilisation'):.3f} instead of "
            f"{at(OWN, 'utilisation'):.3f}, and {100 * at(TREE, 'time_above'):.1f} % of the time above "
            f"capacity instead of {100 * at(OWN, 'time_above'):.1f}."
        ),
        (
            f"Flooding takes {sent[FLOOD]:.0f} transmissions a broadcast instead of {sent[TREE]:.0f}, and "
            f"{sent[FLOOD] * at(FLOOD, 'signals'):.0f} per unit of time instead of "
            f"{sent[TREE] * at(TREE, 'signals'):.0f}, as fewer signals are necessary."
        ),
    ]


main = command("mesh", study, "What does a lossy mesh do to cameras far away, and does flooding help?")
