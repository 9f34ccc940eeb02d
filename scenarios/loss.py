"""How much loss is survived, how much is usable, and which agents does loss cost?

Loss that is the same for all changes no shares, and makes signals more frequent while there are
opportunities to signal. Demand runs away beyond 1 - rho r with hold-off r, and beyond 1 / (1 + rho) on
the clock. Long before, demand is often above the capacity: the loss at which that is 1 % of the time is
far less for a long hold-off. Loss that differs moves the averages to the optimum of reweighted costs:
agents that receive less take more. The rest is random error, and the bias of the rule, which is less than
without loss.
"""  # noqa: D400 - a question

from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Crossing, Fleet, Recording, Sampled, Simulation, theory
from aimd_des.interventions import CapacityStep
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, late, quietly, run_draws
from scenarios.common.systems import critical, held, memory_alone, spread, usable
from scenarios.common.tables import (
    number,
    over_draws,
    pick,
    reached,
    shown,
    summarise_draws,
    theory_of,
    with_theory,
)

_SAME, _SPREAD = "the same for all", "spread"
_PLAIN, _NEW = "from plain optimum", "from reweighted optimum"
_EARLY, _LATE = "time above, first stretch", "time above"
_CRITICAL, _USABLE = "critical loss", "usable loss"
# The share of time above the capacity up to which a loss is usable.
_ALLOWED = 0.01
_LABELS = ["loss", "way", "mean_loss", "length"]


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


class _Case(NamedTuple):
    way: _Way
    kind: str
    mean: float
    # Measures are of the stretches that begin at the first two times; the run ends at the last.
    times: tuple[float, float, float]

    @property
    def loss(self) -> float | FloatArray:
        return self.mean if self.kind == _SAME else spread(0.0, 2.0 * self.mean)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with losses from 0 to 0.9, the same for all and spread over agents."""
    draws, step, tops = (2, 0.3, [0.0, 0.8]) if quick else (12, 0.05, [0.0, 0.4, 0.8])
    short, long = ((50.0, 100.0, 300.0),) * 2 if quick else ((500, 2000, 6000), (1000, 9000, 90_000))
    losses = np.round(np.arange(0.0, 0.95, step), 2).tolist()
    cases = [_Case(way, _SAME, loss, short) for way in _WAYS for loss in losses]
    cases += [_Case(way, _SPREAD, 0.5 * top, long) for way in _WAYS[1:] for top in tops]
    found = run_draws(_measured, cases, draws, 1, seed, quick, runs)
    rows = [
        {"loss": case.kind, "way": case.way.name, "mean_loss": case.mean, "draw": draw, **row}
        for case, outcomes in found
        for draw, (one,) in enumerate(outcomes, seed)
        for row in one
    ]
    rows += [
        {"loss": _SAME, "way": way.name, "mean_loss": np.nan, "length": short[2], "draw": draw, **limits}
        for way in _WAYS
        for draw in range(seed, seed + draws)
        for limits in [_limits(way, draw, pick(pd.DataFrame(rows), loss=_SAME, way=way.name, draw=draw))]
    ]
    table = with_theory(summarise_draws(rows, _LABELS), _LABELS)
    of_one = pd.Series([_expected(row, seed) for row in table.to_dict("records")], dtype=float)
    table["theory"] = table["theory"].fillna(of_one)
    settings = {"seed": seed, "draws": draws, "until": short[2], "until_spread": long[2]}
    printed = shown(table[~table["measure"].isin(["signals", _EARLY])], [*_LABELS, "measure"])
    drawn = {"loss": partial(_figure, table, seed)}
    return Finding("loss", settings, table, printed, _findings(table), drawn)


def _measured(case: _Case, draw: int, seed: int) -> list[dict[str, float]]:
    """Run, and measure: where losses differ, averages at two times, and what theory has for them."""
    problem, (early, start, until) = memory_alone(draw=draw), case.times
    simulation = Simulation(
        problem,
        dynamics=case.way.dynamics,
        control_unit=case.way.unit,
        channel=BroadcastChannel(case.way.latency, case.loss),
        agents=Fleet,
        # The capacity is set to what it is: totals are integrated exactly from there on.
        interventions=[CapacityStep("memory", time, float(problem.capacity[0])) for time in (early, start)],
        seed=seed,
        recording=Recording(demand="end", allocations=[start]),
    )
    result = quietly(simulation, until)
    found, seen = late(result, start), result.observations
    if case.kind == _SAME:
        measures = {"length": until, "signals": found.signals, "utilisation": found.utilisation}
        return [{**measures, _EARLY: seen.stretches[-2].overshoot().time[0], _LATE: found.time_above}]
    share = found.signals if case.way.dynamics == "discrete" else 0.0
    optima = {_PLAIN: None, _NEW: theory.loss_weights(np.asarray(case.loss)[:, None], share)}
    settled, rows = _settled(case, draw), []
    for length, average in zip((start, until), seen.average, strict=True):
        row = {"length": length}
        for name, weights in optima.items():
            row[name] = distance(problem, average.T, weights)[0]
            row[theory_of(name)] = distance(problem, settled, weights)[0]
        rows.append(row)
    return rows


def _settled(case: _Case, draw: int) -> FloatArray:
    """Compute where averages settle with losses that are spread, (n, 1)."""
    way, problem = case.way, memory_alone(draw=draw)
    return theory.convergence(problem, way.dynamics, latency=way.latency, loss=case.loss).steady.average


def _limits(way: _Way, draw: int, rows: pd.DataFrame) -> dict[str, float]:
    """Find the loss that is usable and the critical one, of one draw."""
    limits = {_CRITICAL: critical(memory_alone(draw=draw), way.hold_off, way.dynamics)}
    if way.dynamics == "continuous":
        limits[_USABLE] = reached(rows["mean_loss"].to_numpy(), rows[_LATE].to_numpy(), _ALLOWED)
    return limits


def _expected(row: dict[Any, Any], seed: int) -> float:
    """Predict what is the same for all draws but for some per cent, for the first of them."""
    way, measure = next(way for way in _WAYS if way.name == row["way"]), row["measure"]
    if measure in {"signals", "utilisation"}:
        return _held(way, row["mean_loss"], seed)[int(measure == "utilisation")]
    return usable(memory_alone(draw=seed), way.hold_off) if measure == _USABLE else np.nan


def _held(way: _Way, loss: float, draw: int) -> theory.SteadyTotal:
    setting = {"hold_off": way.hold_off, "latency": way.latency, "loss": loss}
    return held(memory_alone(draw=draw), way.dynamics, **setting)


def _figure(table: pd.DataFrame, seed: int) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (13.0, 4.6))
    _draw_same(left, table, _LATE, seed)
    _draw_same(middle, table, "utilisation", seed)
    _draw_spread(right, table)
    x = "probability of loss, the same for all"
    figures.level(left, 100 * _ALLOWED)
    title, label = "(a) Usable loss is less than critical loss", "time above the capacity (%)"
    figures.dress(left, title, x, label, numbers="", xlim=(-0.02, 0.92), yscale="symlog", ylim=(0.0, 130.0))
    left.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
    figures.level(middle, 1.0)
    title, label = "(b) Demand: held, then it runs away", "mean total demand over capacity"
    figures.dress(middle, title, x, label, numbers="y", xlim=(-0.02, 0.92))
    x, label = "mean loss, from 0 to twice that over agents", "distance of the averages (%)"
    figures.dress(right, "(c) Loss that differs: a new optimum", x, label, numbers="y")
    shared_legend(figure)
    return figure


def _draw_same(axes: Axes, table: pd.DataFrame, measure: str, seed: int) -> None:
    for place, way in enumerate(_WAYS):
        rows = pick(table, loss=_SAME, way=way.name, measure=measure)
        turn = number(table, way=way.name, measure=_CRITICAL)
        axes.axvline(turn, color=colour(place), linewidth=1.0, linestyle="--")
        if measure == "utilisation":
            turn = critical(memory_alone(draw=seed), way.hold_off, way.dynamics)
            grid = np.union1d(rows["mean_loss"], [turn - 1e-6, turn])
            line = np.array([_held(way, loss, seed).utilisation for loss in grid])
            for side in (grid < turn, grid >= turn):
                axes.plot(grid[side], line[side], color=colour(place), linewidth=1.5)
        elif way.dynamics == "continuous":
            known = number(table, "theory", way=way.name, measure=_USABLE)
            axes.axvline(known, color=colour(place), linewidth=1.8, linestyle=":")
        scale = 1.0 if measure == "utilisation" else 100.0
        figures.points(axes, rows["mean_loss"], rows, place, way.name, scale=scale)
    figures.named(axes, "theory")
    figures.named(axes, "critical loss by theory", "--", linewidth=1.0)
    figures.named(axes, "usable loss by theory", ":", linewidth=1.8)


def _draw_spread(axes: Axes, table: pd.DataFrame) -> None:
    longest = table.loc[table["loss"] == _SPREAD, "length"].max()
    for place, way in enumerate(_WAYS[1:], start=1):
        for measure, face in ((_PLAIN, colour(place)), (_NEW, "white")):
            rows = pick(table, loss=_SPREAD, way=way.name, measure=measure, length=longest)
            figures.curve(axes, rows["mean_loss"], rows, place, scale=100.0, markerfacecolor=face)
    figures.named(axes, "from the plain optimum", "o")
    figures.named(axes, "from the reweighted optimum", "o", markerfacecolor="white")


def _findings(table: pd.DataFrame) -> list[str]:
    found = []
    for way in _WAYS:
        survived = over_draws(table, way=way.name, measure=_CRITICAL)
        text = f"{way.name}: the critical loss is {survived} by theory"
        if way.dynamics == "continuous":
            known = number(table, "theory", way=way.name, measure=_USABLE)
            text += (
                f"; demand is above the capacity for 1 % of the time at a loss of"
                f" {over_draws(table, way=way.name, measure=_USABLE)}, theory {known:.2f}"
            )
        found.append(text + ".")
    rows = pick(table, loss=_SPREAD)
    lengths, top = np.unique(rows["length"]), rows["mean_loss"].max()
    for way in _WAYS[1:]:
        off, bias = (partial(say, pick(rows, way=way.name)) for say in (_off, _bias))
        new, none = (" and ".join(off(_NEW, loss, length) for length in lengths) for loss in (top, 0.0))
        found.append(
            f"{way.name}, loss spread from 0 to {2 * top:g}: averages are {off(_PLAIN, top, lengths[-1])}"
            f" from the plain optimum ({bias(_PLAIN, top)}), and from that of the reweighted costs {new}"
            f" ({bias(_NEW, top)}). Without loss they are {none} from the optimum ({bias(_NEW, 0.0)})."
        )
    return sentences("- " + "\n- ".join(found))


def _off(rows: pd.DataFrame, measure: str, loss: float, length: float) -> str:
    return f"{over_draws(rows, 100.0, measure=measure, mean_loss=loss, length=length)} % after {length:g}"


def _bias(rows: pd.DataFrame, measure: str, loss: float) -> str:
    return f"{100 * number(rows, 'theory', measure=measure, mean_loss=loss):.2f} % in the end by theory"


main = command("loss", study, __doc__)

if __name__ == "__main__":
    main()
