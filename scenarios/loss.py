"""How much loss does the system survive, and whom does loss cost?

Loss that is the same for all changes no shares, and costs signals until there are no more
opportunities to signal: up to 1 - rho r with hold-off r, up to 1 / (1 + rho) on the clock, where
demand runs away. A short hold-off is what makes loss bearable. Loss that differs moves the averages
to the optimum of reweighted costs: who hears less takes more.
"""  # noqa: D400 - a question

from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import Crossing, Sampled, theory
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from scenarios.common import figures
from scenarios.common.command import Finding, command
from scenarios.common.measure import Measures, Run, distance, distances, measure_all
from scenarios.common.systems import critical, held, memory_alone, spread
from scenarios.common.tables import pick, shown

_PROBLEM = memory_alone()
# Above this share of the opportunities the control unit signals at practically every one.
_RUN_AWAY = 0.99
_SAME = "the same for all"
_PLAIN, _NEW = "from plain optimum", "from reweighted optimum"


class _Way(NamedTuple):
    name: str
    dynamics: Literal["discrete", "continuous"]
    hold_off: float
    latency: float = 0.0

    @property
    def unit(self) -> Sampled | Crossing:
        return Sampled() if self.dynamics == "discrete" else Crossing(self.hold_off)


_WAYS = (
    _Way("continuous, hold-off 1", "continuous", 1.0),
    _Way("continuous, hold-off 0.25", "continuous", 0.25),
    _Way("discrete clock", "discrete", 1.0, latency=1.0),
)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with losses from 0 to 0.9, the same for all and spread over agents."""
    replications, until = (2, 200.0) if quick else (12, 1500.0)
    losses = [0.0, 0.3, 0.6, 0.9] if quick else np.round(np.arange(0.0, 0.95, 0.1), 2).tolist()
    tops = [0.4, 0.8] if quick else [0.0, 0.2, 0.4, 0.6, 0.8]
    given: list[tuple[str, _Way, float, float | FloatArray]] = [
        (_SAME, way, loss, loss) for way in _WAYS for loss in losses
    ]
    same = len(given)
    given += [("spread", way, top / 2, spread(0.0, top)) for way in _WAYS[1:] for top in tops]
    cases: list[tuple[dict[str, Any], Run]] = [
        (
            {"loss": kind, "way": way.name, "mean_loss": mean},
            Run(_PROBLEM, until, until // 3, way.dynamics, way.unit, way.latency, loss),
        )
        for kind, way, mean, loss in given
    ]
    table, outcomes = measure_all(cases, replications, seed, quick, runs)
    pairs = zip(cases[same:], outcomes[same:], strict=True)
    rows = [row for (labels, run), found in pairs for row in _distances(labels, run, found)]
    table = pd.concat([table, pd.DataFrame(rows)], ignore_index=True)
    table["theory"] = [_expected(row) for row in table.to_dict("records")]
    same_measures = (table["loss"] == _SAME) & table["measure"].isin(["signals", "utilisation"])
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = shown(
        table[same_measures | table["measure"].isin([_PLAIN, _NEW])],
        ["loss", "way", "mean_loss", "measure"],
    )
    return Finding("loss", settings, table, printed, _findings(table), {"loss": partial(_figure, table)})


def _distances(labels: dict[str, Any], run: Run, found: list[Measures]) -> list[dict[str, Any]]:
    """Measure how far the mean of the averages is from both optima, in one more pair of measures."""
    share: FloatArray | float = 0.0
    if run.dynamics == "discrete":
        share = np.mean([measures.signals for measures in found], axis=0)
    weights = theory.loss_weights(np.asarray(run.loss)[:, None], share)
    averages, labels = [measures.average for measures in found], {**labels, "resource": "memory"}
    return distances(labels, _PROBLEM, averages, {_PLAIN: None, _NEW: weights})


def _critical(way: _Way) -> float:
    return critical(_PROBLEM, way.hold_off, way.dynamics)


def _held(way: _Way, loss: float) -> theory.SteadyTotal:
    return held(_PROBLEM, way.dynamics, hold_off=way.hold_off, latency=way.latency, loss=loss)


def _expected(row: dict[Any, Any]) -> float:
    """Predict one number of the table; NaN where there is no formula."""
    way, measure = next(way for way in _WAYS if way.name == row["way"]), row["measure"]
    if row["loss"] == _SAME:
        place = {"signals": 0, "utilisation": 1}.get(measure)
        return np.nan if place is None else _held(way, row["mean_loss"])[place]
    if measure != _PLAIN:
        return 0.0 if measure == _NEW else np.nan
    loss = spread(0.0, 2.0 * row["mean_loss"])
    expected = theory.predict(_PROBLEM, way.dynamics, latency=way.latency, loss=loss)
    return float(distance(_PROBLEM, expected.allocation)[0])


def _figure(table: pd.DataFrame) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (13.0, 4.6))
    _draw_same(left, table, "signals")
    _draw_same(middle, table, "utilisation")
    _draw_spread(right, table)
    x = "probability of loss, the same for all"
    title, label = "(a) Signals, until all opportunities are used", "signals, share of the opportunities"
    figures.dress(left, title, x, label, numbers="y", xlim=(-0.02, 0.92), ylim=(0.0, 1.08))
    figures.level(middle, 1.0)
    title, label = "(b) Demand: held, then it runs away", "mean total demand over capacity"
    figures.dress(middle, title, x, label, numbers="y", xlim=(-0.02, 0.92))
    x, label = "mean loss, from 0 to twice that over agents", "distance of the averages (%)"
    figures.dress(right, "(c) Loss that differs: a new optimum", x, label, numbers="y")
    shared_legend(figure)
    return figure


def _draw_same(axes: Axes, table: pd.DataFrame, measure: str) -> None:
    for place, way in enumerate(_WAYS):
        rows, turn = pick(table, loss=_SAME, way=way.name, measure=measure), _critical(way)
        scale = way.hold_off if measure == "signals" else 1.0
        grid = np.union1d(np.linspace(0.0, 0.9, 31), [turn - 1e-6, turn])
        line = np.array([_held(way, loss)[int(measure != "signals")] for loss in grid]) * scale
        for side in (grid < turn, grid >= turn):
            axes.plot(grid[side], line[side], color=colour(place), linewidth=1.5)
        axes.axvline(turn, color=colour(place), linewidth=1.0, linestyle="--")
        figures.points(axes, rows["mean_loss"], rows, place, way.name, scale=scale)
    figures.named(axes, "theory")
    figures.named(axes, "critical loss by theory", "--", linewidth=1.0)


def _draw_spread(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(_WAYS[1:], start=1):
        for measure, face in ((_PLAIN, colour(place)), (_NEW, "white")):
            rows = pick(table, loss="spread", way=way.name, measure=measure)
            figures.points(axes, rows["mean_loss"], rows, place, scale=100.0, markerfacecolor=face)
            figures.theory(axes, rows["mean_loss"], rows, place, scale=100.0)
    figures.named(axes, "from the plain optimum", "o")
    figures.named(axes, "from the reweighted optimum", "o", markerfacecolor="white")


def _findings(table: pd.DataFrame) -> list[str]:
    found = []
    for way in _WAYS:
        rows = pick(table, loss=_SAME, way=way.name, measure="signals")
        away = rows.loc[rows["mean"] * way.hold_off >= _RUN_AWAY, "mean_loss"]
        held = rows.loc[rows["mean"] * way.hold_off < _RUN_AWAY, "mean_loss"]
        span = f"between {held.max():g} and {away.min():g}" if len(away) else f"above {held.max():g}"
        found.append(
            f"{way.name}: from a loss {span} on, signals take up practically all opportunities and demand "
            f"runs away; theory puts the critical loss at {_critical(way):.2f}."
        )
    for way in _WAYS[1:]:
        plain, new = (pick(table, loss="spread", way=way.name, measure=name) for name in (_PLAIN, _NEW))
        found.append(
            f"{way.name}, loss spread from 0 to {2 * plain['mean_loss'].iloc[-1]:g}: averages are "
            f"{100 * plain['mean'].iloc[-1]:.1f} % from the plain optimum and "
            f"{100 * new['mean'].iloc[-1]:.1f} % from that of the reweighted costs: who hears less takes "
            "more."
        )
    return found


main = command("loss", study, "How much loss does the system survive, and whom does loss cost?")

if __name__ == "__main__":
    main()
