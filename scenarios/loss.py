"""How much loss does the system survive, and whom does loss cost?

Loss that is the same for all changes no shares, and costs signals until there are no more
opportunities to signal: up to 1 - rho r with hold-off r, up to 1 / (1 + rho) on the clock, where
demand runs away. A short hold-off is what makes loss bearable. Loss that differs moves the averages
to the optimum of reweighted costs: who hears less takes more.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import theory
from aimd_des.checks import FloatArray
from aimd_des.control_unit import Crossing, Sampled
from aimd_des.errors import InputError
from aimd_des.optimum import solve_optimum
from aimd_des.plots import colour, shared_legend
from aimd_des.plots.style import REFERENCE, frame, number_axis
from scenarios.common.command import Study, command
from scenarios.common.measure import Measures, Run, distance, measure_all
from scenarios.common.replicate import jackknife
from scenarios.common.systems import memory_alone, spread

__all__ = ["main", "study"]

_PROBLEM = memory_alone()
# Above this share of the opportunities the control unit signals at practically every one.
_RUN_AWAY = 0.99


class _Way(NamedTuple):
    name: str
    dynamics: Literal["discrete", "continuous"]
    hold_off: float

    @property
    def unit(self) -> Sampled | Crossing:
        return Sampled() if self.dynamics == "discrete" else Crossing(self.hold_off)


_WAYS = (
    _Way("continuous, hold-off 1", "continuous", 1.0),
    _Way("continuous, hold-off 0.25", "continuous", 0.25),
    _Way("discrete clock", "discrete", 1.0),
)


def study(quick: bool = False, seed: int = 0) -> Study:
    """Run memory of the paper's system with losses from 0 to 0.9, the same for all and spread over agents.

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
    replications, until = (2, 200.0) if quick else (12, 1500.0)
    losses = [0.0, 0.3, 0.6, 0.9] if quick else np.round(np.arange(0.0, 0.95, 0.1), 2).tolist()
    tops = [0.4, 0.8] if quick else [0.0, 0.2, 0.4, 0.6, 0.8]
    cases: list[tuple[dict[str, Any], Run]] = [
        (_labels("the same for all", way, loss), _run(way, until, loss)) for way in _WAYS for loss in losses
    ]
    same = len(cases)
    cases += [
        (_labels("spread", way, top / 2), _run(way, until, spread(0.0, top)))
        for way in _WAYS[1:]
        for top in tops
    ]
    table, outcomes = measure_all(cases, replications, seed, workers=1 if quick else None)
    distances = pd.concat(
        [
            _distances(labels, run, found)
            for (labels, run), found in zip(cases[same:], outcomes[same:], strict=True)
        ]
    )
    table = pd.concat([table, distances], ignore_index=True)
    table["theory"] = [_expected(row) for row in table.to_dict("records")]
    return Study(
        "loss",
        {"seed": seed, "replications": replications, "until": until},
        table,
        _shown(table),
        _findings(table),
        {"loss": _figure(table)},
    )


def _labels(kind: str, way: _Way, mean_loss: float) -> dict[str, Any]:
    return {"loss": kind, "way": way.name, "mean_loss": mean_loss}


def _run(way: _Way, until: float, loss: float | FloatArray) -> Run:
    latency = 0.0 if way.dynamics == "continuous" else 1.0
    return Run(_PROBLEM, until, until // 3, way.dynamics, way.unit, latency, loss)


def _distances(labels: dict[str, Any], run: Run, found: list[Measures]) -> pd.DataFrame:
    """Measure how far the mean of the averages is from both optima, in one more pair of measures."""
    share: FloatArray | float = 0.0
    if run.dynamics == "discrete":
        share = np.mean([measures.signals for measures in found], axis=0)
    weights = theory.loss_weights(np.asarray(run.loss)[:, None], share)
    averages, rows = [measures.average for measures in found], []
    for name, given in (("from plain optimum", None), ("from reweighted optimum", weights)):
        value, error = jackknife(averages, partial(distance, _PROBLEM, weights=given))
        rows.append(
            {**labels, "resource": "memory", "measure": name, "mean": value[0], "standard_error": error[0]}
        )
    return pd.DataFrame(rows).assign(replications=len(found))


def _way(name: str) -> _Way:
    return next(way for way in _WAYS if way.name == name)


@lru_cache
def _critical(way: _Way) -> float:
    mu = solve_optimum(_PROBLEM).multipliers
    rho = theory.signal_rate(_PROBLEM.increase[0], _PROBLEM.decrease[0], _PROBLEM.normalization, mu)
    return float(theory.critical_loss(rho, way.dynamics, refractory=way.hold_off)[0])


@lru_cache
def _homogeneous(way: _Way, loss: float) -> tuple[float, float]:
    """Predict signals and mean total demand over capacity, on either side of the critical loss."""
    if loss < _critical(way):
        try:
            expected = theory.predict(
                _PROBLEM, way.dynamics, latency=0.0 if way.dynamics == "continuous" else 1.0, loss=loss
            )
        except InputError:
            return np.nan, np.nan
        if expected.signals[0] * way.hold_off < 1.0:
            return float(expected.signals[0]), float(expected.utilisation[0])
        return np.nan, np.nan
    mu = theory.runaway_multiplier(
        _PROBLEM.increase[0],
        _PROBLEM.decrease[0],
        _PROBLEM.normalization,
        loss,
        way.dynamics,
        refractory=way.hold_off,
    )
    level = theory.allocation_at(_PROBLEM, mu)
    if (_PROBLEM.normalization * mu / level > 1.0).any():
        return 1.0 / way.hold_off, np.nan  # responses are cut off at 1: no formula
    return 1.0 / way.hold_off, float(level.sum() / _PROBLEM.capacity[0])


def _expected(row: dict[Any, Any]) -> float:
    """Predict one number of the table; NaN where there is no formula."""
    if row["loss"] == "spread":
        return 0.0 if row["measure"] == "from reweighted optimum" else _spread_shift(row)
    place = {"signals": 0, "utilisation": 1}.get(row["measure"])
    return np.nan if place is None else _homogeneous(_way(row["way"]), row["mean_loss"])[place]


def _spread_shift(row: dict[Any, Any]) -> float:
    """Predict how far the reweighted optimum is from the plain one."""
    if row["measure"] != "from plain optimum":
        return np.nan
    way, loss = _way(row["way"]), spread(0.0, 2.0 * row["mean_loss"])
    expected = theory.predict(_PROBLEM, way.dynamics, latency=float(way.dynamics == "discrete"), loss=loss)
    return float(distance(_PROBLEM, expected.allocation)[0])


def _pick(table: pd.DataFrame, way: _Way, measure: str, loss: str = "the same for all") -> pd.DataFrame:
    return table[(table["loss"] == loss) & (table["way"] == way.name) & (table["measure"] == measure)]


def _figure(table: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _draw_same(left, table, "signals", "signals, share of the opportunities")
    _draw_same(middle, table, "utilisation", "mean total demand over capacity")
    left.set_title("(a) Signals, until all opportunities are used", loc="left", fontsize="medium")
    middle.set_title("(b) Demand: held, then it runs away", loc="left", fontsize="medium")
    middle.axhline(1.0, color=REFERENCE, linewidth=1.0, linestyle=":")
    _draw_spread(right, table)
    shared_legend(figure)
    return figure


def _draw_same(axes: Axes, table: pd.DataFrame, measure: str, label: str) -> None:
    for place, way in enumerate(_WAYS):
        rows, critical = _pick(table, way, measure), _critical(way)
        scale = way.hold_off if measure == "signals" else 1.0
        grid = np.union1d(np.linspace(0.0, 0.9, 31), [critical - 1e-6, critical])
        line = np.array([_homogeneous(way, loss)[int(measure != "signals")] for loss in grid]) * scale
        for side in (grid < critical, grid >= critical):
            axes.plot(grid[side], line[side], color=colour(place), linewidth=1.4)
        axes.axvline(critical, color=colour(place), linewidth=1.0, linestyle="--")
        axes.errorbar(
            rows["mean_loss"],
            rows["mean"] * scale,
            2.0 * rows["standard_error"] * scale,
            fmt="os^"[place],
            color=colour(place),
            markersize=5.5,
            capsize=2.5,
            label=way.name,
        )
    axes.plot([], [], color=REFERENCE, linewidth=1.4, label="theory")
    axes.plot([], [], color=REFERENCE, linewidth=1.0, linestyle="--", label="critical loss by theory")
    axes.set_xlabel("probability of loss, the same for all")
    axes.set_ylabel(label)
    axes.set_xlim(-0.02, 0.92)
    if measure == "signals":
        axes.set_ylim(0.0, 1.08)
    number_axis(axes.yaxis)
    frame(axes)


def _draw_spread(axes: Axes, table: pd.DataFrame) -> None:
    for place, way in enumerate(_WAYS[1:], start=1):
        for measure, face in (("from plain optimum", colour(place)), ("from reweighted optimum", "white")):
            rows = _pick(table, way, measure, "spread")
            axes.errorbar(
                rows["mean_loss"],
                100 * rows["mean"],
                200 * rows["standard_error"],
                fmt="os^"[place],
                color=colour(place),
                markerfacecolor=face,
                markersize=6.0,
                capsize=2.5,
            )
            axes.plot(rows["mean_loss"], 100 * rows["theory"], color=colour(place), linewidth=1.4)
    for face, name in ((REFERENCE, "from the plain optimum"), ("white", "from the reweighted optimum")):
        axes.plot([], [], "o", color=REFERENCE, markerfacecolor=face, label=name)
    axes.set_xlabel("mean loss, from 0 to twice that over agents")
    axes.set_ylabel("distance of the averages (%)")
    axes.set_title("(c) Loss that differs: a new optimum", loc="left", fontsize="medium")
    number_axis(axes.yaxis)
    frame(axes)


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    wanted = ["signals", "utilisation", "from plain optimum", "from reweighted optimum"]
    rows = table[table["measure"].isin(wanted)]
    spread_out = (rows["loss"] == "spread") & rows["measure"].isin(wanted[:2])
    return pd.DataFrame(
        [
            {
                "loss": row["loss"],
                "way": row["way"],
                "mean loss": f"{row['mean_loss']:.2f}",
                "measure": row["measure"],
                "theory": "" if np.isnan(row["theory"]) else f"{row['theory']:.4f}",
                "simulation": f"{row['mean']:.4f} ± {row['standard_error']:.4f}",
            }
            for row in rows[~spread_out].to_dict("records")
        ]
    )


def _findings(table: pd.DataFrame) -> list[str]:
    found = []
    for way in _WAYS:
        rows = _pick(table, way, "signals")
        away = rows.loc[rows["mean"] * way.hold_off >= _RUN_AWAY, "mean_loss"]
        held = rows.loc[rows["mean"] * way.hold_off < _RUN_AWAY, "mean_loss"]
        span = f"between {held.max():g} and {away.min():g}" if len(away) else f"above {held.max():g}"
        found.append(
            f"{way.name}: from a loss {span} on, signals take up practically all opportunities and demand "
            f"runs away; theory puts the critical loss at {_critical(way):.2f}."
        )
    for way in _WAYS[1:]:
        plain, new = (_pick(table, way, f"from {name} optimum", "spread") for name in ("plain", "reweighted"))
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
