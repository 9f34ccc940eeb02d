"""Does it matter that clocks are out of phase, run at different speeds or tick unevenly?

Random phases, and jitter below the latency, leave signals, use and shares as they are; phases take
a quarter off the overshoot. Jitter that exceeds the latency, so that agents answer some signals a
tick earlier than others, takes 12 % more signals. Clocks of different speeds shift the shares: a
fast clock adds more often, and the averages settle where theory puts them.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import Clocks, Sampled, theory
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from aimd_des.study import paired_difference
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import Measures, Run, distance, distances, measure_all
from scenarios.common.systems import memory_alone, spread
from scenarios.common.tables import number, numbers, pick, shown

_PROBLEM = memory_alone()
_IN_PHASE = "in phase"
_BIAS = "misallocation of the mean"


class _Setting(NamedTuple):
    name: str
    phase: bool = False
    drift: float = 0.0
    jitter: float = 0.0

    @property
    def speeds(self) -> FloatArray:
        """Relative errors of the periods, from -drift to drift."""
        return spread(-self.drift, self.drift)

    @property
    def clocks(self) -> Clocks:
        return Clocks(
            phase="random" if self.phase else 0.0,
            drift=self.speeds if self.drift else 0.0,
            jitter=self.jitter,
        )


_SETTINGS = (
    _Setting(_IN_PHASE),
    _Setting("random phases", phase=True),
    _Setting("jitter 0.5", jitter=0.5),
    _Setting("jitter 0.9", jitter=0.9),
    _Setting("drift ±1 %", drift=0.01),
    _Setting("drift ±5 %", drift=0.05),
    _Setting("drift ±20 %", drift=0.2),
    _Setting("all three together", phase=True, drift=0.2, jitter=0.5),
)

_PANELS = (
    ("signals", 1.0, "signals per unit of time", "(a) Signals: long jitter takes more"),
    ("utilisation", 100.0, "averages over capacity (%)", "(b) Utilisation: a point at most"),
    ("peak", 100.0, "highest total over capacity (%)", "(c) Peak: lower out of phase"),
    (_BIAS, 100.0, "distance from the optimum (%)", "(d) Shares: only drift shifts them"),
)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with different clocks and the same random numbers."""
    replications, until = (3, 150.0) if quick else (20, 1500.0)
    cases: list[tuple[dict[str, Any], Run]] = [
        ({"clocks": setting.name}, _run(setting, until)) for setting in _SETTINGS
    ]
    table, outcomes = measure_all(cases, replications, seed, quick, runs)
    table = table[table["measure"] != "saturated"].reset_index(drop=True)
    table["replication_std"] = table["standard_error"] * np.sqrt(replications)
    table[["effect", "effect_error"]] = [
        _effect(row["measure"], _place(row["clocks"]), outcomes) for row in table.to_dict("records")
    ]
    table = pd.concat([table, pd.DataFrame(_pooled(outcomes))], ignore_index=True)
    table["theory"] = [
        _expected(row["measure"], _SETTINGS[place], outcomes[place])
        for row in table.to_dict("records")
        for place in [_place(row["clocks"])]
    ]
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = _shown(table)
    return Finding("clocks", settings, table, printed, _findings(table), {"clocks": partial(_figure, table)})


def _run(setting: _Setting, until: float) -> Run:
    return Run(_PROBLEM, until, until // 3, "discrete", Sampled(), latency=0.5, clocks=setting.clocks)


def _place(name: str) -> int:
    return [setting.name for setting in _SETTINGS].index(name)


def _effect(measure: str, place: int, outcomes: list[list[Measures]]) -> tuple[float, float]:
    """Compare runs of the same seeds: mean difference from clocks in phase, and its standard error."""
    here, there = ([getattr(run, measure)[0] for run in outcomes[which]] for which in (place, 0))
    found = paired_difference(here, there)
    return found.mean, found.standard_error


def _pooled(outcomes: list[list[Measures]]) -> list[dict[str, Any]]:
    """Measure shares without the random error of single runs: by the mean of the averages over all runs."""
    pairs = zip(_SETTINGS, outcomes, strict=True)
    labelled = [({"clocks": setting.name, "resource": "memory"}, runs) for setting, runs in pairs]
    optima = {_BIAS: None}
    return [
        row
        for labels, runs in labelled
        for row in distances(labels, _PROBLEM, [run.average for run in runs], optima)
    ]


@lru_cache
def _predicted() -> theory.Prediction:
    """Follow the walk of clocks in phase, which takes tenths of a second, once for all rows."""
    return theory.predict(_PROBLEM, "discrete", latency=1.0)


def _expected(measure: str, setting: _Setting, runs: list[Measures]) -> float:
    """Predict what there is a formula for, or NaN: in phase, and shares if fast clocks add more often."""
    if measure in ("signals", "utilisation") and setting == _SETTINGS[0]:
        return float(getattr(_predicted(), measure)[0])
    if measure != _BIAS or not setting.drift:
        return np.nan
    signals, repeated = (
        float(np.mean([getattr(run, name)[0] for run in runs])) for name in ("signals", "repeated")
    )
    # An agent adds at all its ticks but those with a signal.  Of two signals a unit apart one is
    # latched twice, and so lost, where no tick of a slow clock comes in between.
    period = 1.0 + setting.speeds
    heard = signals * (1.0 - repeated * np.maximum(period - 1.0, 0.0) / period)
    weights = heard / (1.0 / period - heard)
    used = np.mean([run.average for run in runs], axis=0).sum(axis=0)
    settled = theory.reweighted_optimum(_PROBLEM, weights, capacity=used).allocation
    return float(distance(_PROBLEM, settled)[0])


def _figure(table: pd.DataFrame) -> Figure:
    figure, panels = figures.panels(1, 4, (14.0, 4.4), sharey=True)
    for axes, (measure, factor, label, title) in zip(panels, _PANELS, strict=True):
        _draw(axes, pick(table, measure=measure), factor)
        figures.dress(axes, title, label, numbers="x")
    shared_legend(figure)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, factor: float) -> None:
    height = -np.arange(len(rows))
    middle, noise = factor * rows.iloc[0]["mean"], factor * rows.iloc[0]["replication_std"]
    error = 2.0 * factor * rows["effect_error"].fillna(rows["standard_error"])
    if np.isfinite(noise):
        words = "± std of single runs in phase"
        axes.axvspan(middle - noise, middle + noise, color="0.88", label=words)
    axes.axvline(middle, color=figures.REFERENCE, linewidth=1.0, label="mean in phase")
    look: dict[str, Any] = {"fmt": "o", "color": colour(0), "markersize": 5.0, "capsize": 2.5}
    axes.errorbar(factor * rows["mean"], height, xerr=error, label="mean ± 2 standard errors", **look)
    # Open, so that a mean inside it stays visible, and no upright line, as the mean in phase is one.
    hollow: dict[str, Any] = {"fillstyle": "none", "color": "black", "markersize": 11.0}
    axes.plot(factor * rows["theory"], height, "D", markeredgewidth=1.5, label="theory", **hollow)
    axes.set_yticks(height, rows["clocks"])


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    effects = table["effect"], table["effect_error"]
    texts = ["" if np.isnan(e) else f"{e:+.4f} ± {error:.4f}" for e, error in zip(*effects, strict=True)]
    return shown(table, ["clocks", "measure"]).assign(effect=texts)


def _findings(table: pd.DataFrame) -> list[str]:
    apart = [setting.name for setting in _SETTINGS[1:]]
    shift = {
        measure: max(apart, key=partial(_size, table, measure)) for measure in ("signals", "utilisation")
    }
    effect = {
        measure: number(table, "effect", measure=measure, clocks=name) for measure, name in shift.items()
    }
    noise = {measure: number(table, "replication_std", measure=measure) for measure in shift}
    peak, bias = (numbers(table, measure=measure) for measure in ("peak", _BIAS))
    widest = _place("drift ±20 %")
    still = [name for name in apart if not np.any(_effects(table, name))]
    settled = 100.0 * numbers(table, "theory", measure=_BIAS)[widest]
    lines = sentences(f"""
        - Signals change by at most {effect["signals"]:+.4f} a step ({shift["signals"]}; runs in phase scatter
          by {noise["signals"]:.4f}), utilisation by at most {100 * effect["utilisation"]:+.2f} points
          ({shift["utilisation"]}; scatter {100 * noise["utilisation"]:.2f}).
        - Peaks are {100 * (peak[0] - 1.0):.1f} % above the capacity in phase and {100 * (peak[1] - 1.0):.1f}
          % with random phases: total demand then grows evenly.
        - Shares stay right unless clocks drift: they are {100 * bias[0]:.1f} % off in phase,
          {100 * bias[1]:.1f} % with random phases and {100 * bias[widest]:.1f} % with drift ±20 %, where
          theory has {settled:.1f} %: a fast clock adds more often.
    """)
    lines += [
        f"{name} changes nothing, to the last bit: every signal is still answered at the same tick."
        for name in still
    ]
    return lines


def _effects(table: pd.DataFrame, name: str) -> FloatArray:
    found = numbers(table, "effect", clocks=name)
    return found[~np.isnan(found)]


def _size(table: pd.DataFrame, measure: str, name: str) -> float:
    return abs(number(table, "effect", measure=measure, clocks=name))


main = command("clocks", study, __doc__)

if __name__ == "__main__":
    main()
