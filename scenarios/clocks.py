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

from aimd_des import Clocks, theory
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from aimd_des.study import jackknife, paired_difference
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import Measures, Run, distance, measure, run_all
from scenarios.common.systems import memory_alone, spread
from scenarios.common.tables import estimate, number, numbers, pick, shown, summarise

_PROBLEM = memory_alone()
_IN_PHASE = "in phase"
_BIAS = "misallocation of the mean"


class _Setting(NamedTuple):
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


_SETTINGS = {
    _IN_PHASE: _Setting(),
    "random phases": _Setting(phase=True),
    "jitter 0.5": _Setting(jitter=0.5),
    "jitter 0.9": _Setting(jitter=0.9),
    "drift ±1 %": _Setting(drift=0.01),
    "drift ±5 %": _Setting(drift=0.05),
    "drift ±20 %": _Setting(drift=0.2),
    "all three together": _Setting(phase=True, drift=0.2, jitter=0.5),
}
_MEASURES = ("signals", "utilisation", "misallocation", "peak")

_PANELS = (
    ("signals", 1.0, "signals per unit of time", "(a) Signals: long jitter takes more"),
    ("utilisation", 100.0, "averages over capacity (%)", "(b) Utilisation: a point at most"),
    ("peak", 100.0, "highest total over capacity (%)", "(c) Peak: lower out of phase"),
    (_BIAS, 100.0, "distance from the optimum (%)", "(d) Shares: only drift shifts them"),
)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with different clocks and the same random numbers."""
    replications, until = (3, 150.0) if quick else (20, 1500.0)
    cases = [
        Run(_PROBLEM, until, until // 3, latency=0.5, clocks=setting.clocks) for setting in _SETTINGS.values()
    ]
    pairs = run_all(measure, cases, replications, seed, quick, runs)
    found = {name: outcomes for name, (_, outcomes) in zip(_SETTINGS, pairs, strict=True)}
    rows = [
        {**_labels(name), **{key: float(getattr(one, key)[0]) for key in _MEASURES}}
        for name, outcomes in found.items()
        for one in outcomes
    ]
    table = summarise(rows, list(_labels("")))
    table["replication_std"] = table["standard_error"] * np.sqrt(replications)
    table[["effect", "effect_error"]] = [
        _effect(row["measure"], found[row["clocks"]], found[_IN_PHASE]) for row in table.to_dict("records")
    ]
    table = pd.concat([table, pd.DataFrame(_pooled(found))], ignore_index=True)
    table["theory"] = [
        _expected(row["measure"], row["clocks"], found[row["clocks"]]) for row in table.to_dict("records")
    ]
    settings = {"seed": seed, "replications": replications, "until": until}
    printed = _shown(table)
    return Finding("clocks", settings, table, printed, _findings(table), {"clocks": partial(_figure, table)})


def _labels(name: str) -> dict[str, str]:
    return {"clocks": name, "resource": "memory"}


def _effect(key: str, here: list[Measures], there: list[Measures]) -> tuple[float, float]:
    """Compare runs of the same seeds: mean difference from clocks in phase, and its standard error."""
    one, other = ([getattr(run, key)[0] for run in runs] for runs in (here, there))
    found = paired_difference(one, other)
    return found.mean, found.standard_error


def _pooled(found: dict[str, list[Measures]]) -> list[dict[str, Any]]:
    """Measure shares without the random error of single runs: by the mean of the averages over all runs."""
    off = partial(distance, _PROBLEM)
    return [
        estimate(_labels(name), _BIAS, jackknife([run.average for run in runs], off), len(runs))
        for name, runs in found.items()
    ]


@lru_cache
def _predicted() -> theory.Prediction:
    """Follow the walk of clocks in phase, which takes tenths of a second, once for all rows."""
    return theory.predict(_PROBLEM, "discrete", latency=1.0)


def _expected(key: str, name: str, runs: list[Measures]) -> float:
    """Predict what there is a formula for, or NaN: in phase, and shares if fast clocks add more often."""
    setting = _SETTINGS[name]
    if key in ("signals", "utilisation") and name == _IN_PHASE:
        return float(getattr(_predicted(), key)[0])
    if key != _BIAS or not setting.drift:
        return np.nan
    signals, repeated = (
        float(np.mean([getattr(run, each)[0] for run in runs])) for each in ("signals", "repeated")
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
    for axes, (key, factor, label, title) in zip(panels, _PANELS, strict=True):
        _draw(axes, pick(table, measure=key), factor)
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
    apart = list(_SETTINGS)[1:]
    shift = {key: max(apart, key=partial(_size, table, key)) for key in ("signals", "utilisation")}
    effect = {key: number(table, "effect", measure=key, clocks=name) for key, name in shift.items()}
    noise = {key: number(table, "replication_std", measure=key) for key in shift}

    def percent(key: str, name: str, column: str = "mean") -> float:
        return 100.0 * number(table, column, measure=key, clocks=name)

    still = [name for name in apart if not np.any(_effects(table, name))]
    random, widest = "random phases", "drift ±20 %"
    lines = sentences(f"""
        - Signals change by at most {effect["signals"]:+.4f} a step ({shift["signals"]}; runs in phase scatter
          by {noise["signals"]:.4f}), utilisation by at most {100 * effect["utilisation"]:+.2f} points
          ({shift["utilisation"]}; scatter {100 * noise["utilisation"]:.2f}).
        - Peaks are {percent("peak", _IN_PHASE) - 100.0:.1f} % above the capacity in phase and
          {percent("peak", random) - 100.0:.1f} % with random phases: total demand then grows evenly.
        - Shares stay right unless clocks drift: they are {percent(_BIAS, _IN_PHASE):.1f} % off in phase,
          {percent(_BIAS, random):.1f} % with random phases and {percent(_BIAS, widest):.1f} % with drift
          ±20 %, where theory has {percent(_BIAS, widest, "theory"):.1f} %: a fast clock adds more often.
    """)
    lines += [
        f"{name} changes nothing, to the last bit: every signal is still answered at the same tick."
        for name in still
    ]
    return lines


def _effects(table: pd.DataFrame, name: str) -> FloatArray:
    found = numbers(table, "effect", clocks=name)
    return found[~np.isnan(found)]


def _size(table: pd.DataFrame, key: str, name: str) -> float:
    return abs(number(table, "effect", measure=key, clocks=name))


main = command("clocks", study, __doc__)

if __name__ == "__main__":
    main()
