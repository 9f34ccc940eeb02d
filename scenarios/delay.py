"""What does latency do, and what does a longer hold-off do about it?

Every peak rises by n alpha d, the growth over the latency d, and no hold-off changes that. What a
hold-off must not do is starve the agents: it must stay below 1 / rho (1.6 periods here) whatever
the latency. One that is as long as the latency lets demand run away from latency 2 on. A short one
repeats signals that are still on their way, which costs bits and little else.
"""  # noqa: D400 - a question

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import theory
from aimd_des.control_unit import Crossing
from aimd_des.optimum import solve_optimum
from aimd_des.plots import colour, shared_legend
from aimd_des.plots.style import REFERENCE, frame, number_axis
from scenarios.common.command import Study, command
from scenarios.common.measure import Run, measure_all
from scenarios.common.systems import memory_alone

__all__ = ["main", "study"]

_PROBLEM = memory_alone()
_MATCHED = "hold-off = latency"
_HOLD_OFFS = (0.5, 1.0, 5.0)
# Above this share of the opportunities the control unit signals at practically every one.
_RUN_AWAY = 0.99


def study(quick: bool = False, seed: int = 0) -> Study:
    """Run memory of the paper's system with latencies from 0 to 20 periods, for several hold-offs.

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
    replications, until = (2, 240.0) if quick else (12, 1500.0)
    latencies = (0.0, 1.0, 5.0, 20.0) if quick else (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0)
    cases: list[tuple[dict[str, Any], Run]] = []
    for latency in latencies:
        for name, hold_off in _settings(latency):
            labels = {"setting": name, "latency": latency, "hold_off": hold_off}
            unit = Crossing(hold_off)
            cases.append((labels, Run(_PROBLEM, until, until // 3, "continuous", unit, latency)))
    table, _ = measure_all(cases, replications, seed, workers=1 if quick else None)
    table["theory"] = [_expected(row) for row in table.to_dict("records")]
    return Study(
        "delay",
        {"seed": seed, "replications": replications, "until": until},
        table,
        _shown(table),
        _findings(table),
        {"delay": _figure(table)},
    )


def _settings(latency: float) -> list[tuple[str, float]]:
    fixed = [(f"hold-off {value:g}", value) for value in _HOLD_OFFS]
    return [*fixed, (_MATCHED, latency)] if latency > 0.0 else fixed


def _rate() -> float:
    """Compute rho, the signals per unit of time that hold all of the capacity."""
    mu = solve_optimum(_PROBLEM).multipliers
    return float(
        theory.signal_rate(_PROBLEM.increase[0], _PROBLEM.decrease[0], _PROBLEM.normalization, mu)[0]
    )


def _lift(latency: float) -> float:
    lift = theory.peak_lift(_PROBLEM.n_agents, _PROBLEM.increase[0], latency)
    return float(lift[0] / _PROBLEM.capacity[0])


def _expected(row: dict[Any, Any]) -> float:
    """Predict one number of the table; NaN where theory assumes what does not hold."""
    latency, hold_off, measure = row["latency"], row["hold_off"], row["measure"]
    if measure == "peak":
        return 1.0 + _lift(latency)
    if measure not in ("signals", "utilisation"):
        return np.nan
    if _rate() * hold_off >= 1.0:  # signals do not suffice
        return 1.0 / hold_off if measure == "signals" else _level(hold_off)
    if hold_off < latency:  # more than one signal is on its way for one excess
        return np.nan
    expected = theory.predict(_PROBLEM, "continuous", latency=latency)
    if expected.signals[0] * hold_off >= 1.0:
        return np.nan
    return float(getattr(expected, measure)[0])


def _level(hold_off: float) -> float:
    """Predict where demand comes to rest if signals do not suffice; NaN if responses are cut off."""
    mu = theory.runaway_multiplier(
        _PROBLEM.increase[0], _PROBLEM.decrease[0], _PROBLEM.normalization, 0.0, refractory=hold_off
    )
    held = theory.allocation_at(_PROBLEM, mu)
    if (_PROBLEM.normalization * mu / held > 1.0).any():
        return np.nan
    return float(held.sum() / _PROBLEM.capacity[0])


def _names() -> list[str]:
    return [*(f"hold-off {value:g}" for value in _HOLD_OFFS), _MATCHED]


def _pick(table: pd.DataFrame, name: str, measure: str) -> pd.DataFrame:
    return table[(table["setting"] == name) & (table["measure"] == measure)]


_PANELS = (
    ("peak", "highest total demand over capacity", "(a) Every period of latency lifts the peak"),
    ("utilisation", "mean total demand over capacity", "(b) A long hold-off lets demand run away"),
    ("signals", "signals per control period", "(c) Signals"),
)


def _figure(table: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    for axes, (measure, label, title) in zip(figure.subplots(1, 3), _PANELS, strict=True):
        _draw(axes, table, measure)
        axes.set_ylabel(label)
        axes.set_title(title, loc="left", fontsize="medium")
    shared_legend(figure)
    return figure


def _draw(axes: Axes, table: pd.DataFrame, measure: str) -> None:
    for place, name in enumerate(_names()):
        rows = _pick(table, name, measure)
        axes.errorbar(
            rows["latency"],
            rows["mean"],
            2.0 * rows["standard_error"],
            fmt="os^D"[place],
            linestyle=":",
            linewidth=0.8,
            color=colour(place),
            markersize=8.0 - 1.2 * place,
            capsize=2.5,
            label=name,
        )
        if measure != "peak":
            axes.plot(rows["latency"], rows["theory"], color=colour(place), linewidth=1.6)
    if measure == "peak":
        ends = np.array([0.0, 20.0])
        axes.plot(ends, [1.0 + _lift(end) for end in ends], color=REFERENCE, linewidth=1.6)
    axes.plot([], [], color=REFERENCE, linewidth=1.6, label="theory")
    axes.set_xlabel("latency (control periods)")
    number_axis(axes.yaxis)
    frame(axes)


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    rows = table[table["measure"].isin([name for name, *_ in _PANELS])]
    return pd.DataFrame(
        [
            {
                "setting": row["setting"],
                "latency": f"{row['latency']:g}",
                "measure": row["measure"],
                "theory": "" if np.isnan(row["theory"]) else f"{row['theory']:.4f}",
                "simulation": f"{row['mean']:.4f} ± {row['standard_error']:.4f}",
            }
            for row in rows.to_dict("records")
        ]
    )


def _findings(table: pd.DataFrame) -> list[str]:
    peaks = _pick(table, "hold-off 0.5", "peak")
    gap = float((peaks["mean"] - peaks["theory"]).abs().max())
    longest = float(table["latency"].max())
    short, unit = (_pick(table, name, "utilisation")["mean"] for name in ("hold-off 0.5", "hold-off 1"))
    signals = _pick(table, "hold-off 0.5", "signals")
    long = _pick(table, "hold-off 5", "utilisation")["mean"]
    matched = _pick(table, _MATCHED, "utilisation")
    away = matched.loc[matched["hold_off"] * _rate() >= 1.0]
    return [
        (
            f"With hold-off 0.5 the highest peak is 1 + n alpha d / C to within {100 * gap:.1f} points of "
            f"the capacity, up to {peaks['mean'].max():.2f} of it at latency {longest:g}."
        ),
        (
            f"What the hold-off must not do is starve the agents: {_rate():.2f} signals per unit of time "
            f"are needed, so it must stay below {1.0 / _rate():.2f}, whatever the latency. With hold-off "
            f"5 the mean demand is {long.mean():.2f} of the capacity; a hold-off as "
            f"long as the latency runs away from latency {away['latency'].min():g} on, to "
            f"{away['mean'].max():.1f} of the capacity."
        ),
        (
            "A hold-off shorter than the latency repeats signals that are still on their way: with "
            f"hold-off 0.5 up to {signals['mean'].max():.2f} signals per unit of time instead of "
            f"{signals['mean'].iloc[0]:.2f}, and the mean demand lies between {short.min():.2f} and "
            f"{short.max():.2f} of the capacity (hold-off 1: {unit.min():.2f} to {unit.max():.2f})."
        ),
    ]


main = command("delay", study, "What does latency do, and what does a longer hold-off do about it?")

if __name__ == "__main__":
    main()
