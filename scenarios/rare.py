"""How likely is demand 10, 20 or 30 % above the capacity, and what makes it rarer?

Of ten cameras behind latency 0.5 and loss 0.3, within 20 periods: 0.21, 0.0075 and 0.00016. That depends on
the loss, and hardly on the latency. With half of the hold-off 20 % has a probability of 1e-9. A lower
threshold helps against low peaks alone, and with fractional cuts splitting found none of these peaks.
"""  # noqa: D400 - a question

from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, InputError, SimulationError, theory
from aimd_des.loss import GilbertElliott
from aimd_des.plots import colour
from aimd_des.responses import Derandomised, Randomised, Response
from aimd_des.study import rare_event
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import run_all, sensed
from scenarios.common.systems import lowered, memory_alone
from scenarios.common.tables import pick

_N = 10
WITHIN = 20.0
#: Over the capacity.
LEVELS = (1.1, 1.2, 1.3)
_PAPER, _FRACTIONAL, _FULL = "the paper's", "fractional cuts", "full cuts"
_RESPONSES: dict[str, Response] = {
    _PAPER: Randomised(),
    _FRACTIONAL: Derandomised("events"),
    _FULL: Derandomised("events", full=True),
}
# Below this theory has next to no walk: 200 of them with 300 signals each.
_LEAST_SHARE = 1e-4
_GRID = np.linspace(1.02, 1.3, 57)


class Setting(NamedTuple):
    """What is varied; `burst` is the mean duration of a loss on one link, and 0 for independent losses."""

    latency: float = 0.5
    loss: float = 0.3
    burst: float = 0.0
    threshold: float = 1.0
    hold_off: float = 0.5
    response: str = _PAPER

    @property
    def channel(self) -> BroadcastChannel:
        """What carries the signals."""
        loss = GilbertElliott(self.loss, self.burst) if self.burst else self.loss
        return BroadcastChannel(self.latency, loss)


class Size(NamedTuple):
    """How much is run: from when on peaks count, paths from each level, and independent estimates."""

    after: float
    trials: int
    repetitions: int
    levels: tuple[float, ...]


_BASE = Setting()
_USUAL = Size(200.0, 120, 6, LEVELS)
_QUICK = Size(200.0, 20, 3, LEVELS[:1])
# What is varied in each panel, by its field.
_LATENCY, _LOSS, _CONTROL, _RESPONSE = "latency", "loss", "control unit", "response"
_PANELS: dict[str, dict[str, Setting]] = {
    _LATENCY: {f"latency {value:g}": _BASE._replace(latency=value) for value in (0.0, 0.5, 1.0, 2.0)},
    _LOSS: {
        **{f"loss {value:g}": _BASE._replace(loss=value) for value in (0.0, 0.15, 0.3, 0.45)},
        "loss 0.3 in bursts of 20": _BASE._replace(burst=20.0),
    },
    _CONTROL: {
        "threshold 1, hold-off 0.5": _BASE,
        "threshold 0.9": _BASE._replace(threshold=0.9),
        "hold-off 0.25": _BASE._replace(hold_off=0.25),
    },
    _RESPONSE: {name: _BASE._replace(response=name) for name in _RESPONSES},
}
_TITLES = {
    _LATENCY: "(a) Latency",
    _LOSS: "(b) Loss, and its bursts",
    _CONTROL: "(c) Threshold and hold-off",
    _RESPONSE: "(d) Responses",
}


def estimate(setting: Setting, seed: int, size: Size) -> list[dict[str, float]]:
    """Estimate how likely peaks are, a row for each level at which paths were split, ascending.

    Levels that splitting does not come to are left out.  The gain, of the highest level, is the work of plain
    runs over that of splitting.
    """
    simulation = sensed(
        lowered(memory_alone(_N), setting.threshold),
        setting.hold_off,
        channel=setting.channel,
        response=_RESPONSES[setting.response],
        seed=seed,
    )
    paths = size._asdict()
    levels = paths.pop("levels")
    for count in range(len(levels), 0, -1):
        *via, level = levels[:count]
        try:
            found = rare_event(simulation, level=level, via=via, within=WITHIN, **paths)
        except SimulationError:
            continue
        names, walk = ("mean", "standard_error", "low", "high"), expected(setting, found.levels)
        rows = [
            {"level": level, **{name: getattr(each, name) for name in names}, "theory": known, "gain": np.nan}
            for level, each, known in zip(found.levels, found.reached, walk, strict=True)
        ]
        rows[-1]["gain"] = found.gain
        return rows
    return []


@lru_cache
def expected(setting: Setting, levels: tuple[float, ...]) -> tuple[float, ...]:
    """Predict how likely peaks are from the share of time that the walk of theory is above levels.

    The total is cut at the next signal that arrives, so that it stays above a level for half a hold-off in
    the mean; stays within the time come independently.  NaN where the walk has next to no time there, and for
    bursts and other responses than the paper's, which the walk does not know.
    """
    unknown = (np.nan,) * len(levels)
    if setting.burst or setting.response != _PAPER:
        return unknown
    problem = lowered(memory_alone(_N), setting.threshold)
    try:
        share = theory.time_above(
            problem,
            levels,
            "continuous",
            latency=setting.latency,
            loss=setting.loss,
            hold_off=setting.hold_off,
        )[:, 0]
    except (InputError, SimulationError):  # signals do not suffice
        return unknown
    chance = -np.expm1(-share * WITHIN / (0.5 * setting.hold_off))
    return tuple(np.where(share < _LEAST_SHARE, np.nan, chance).tolist())


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Estimate the peaks of ten cameras behind channels, control units and responses."""
    size = _QUICK if quick else _USUAL
    every = (setting for panel in _PANELS.values() for setting in panel.values())
    shown = [_BASE, _PANELS[_LOSS]["loss 0.45"]] if quick else list(dict.fromkeys(every))
    pairs = run_all(partial(estimate, size=size), shown, 1, seed, quick, runs)
    found = {setting: rows for setting, (rows,) in pairs}
    table = pd.DataFrame(
        [
            {"panel": panel, "setting": name, **row}
            for panel, settings in _PANELS.items()
            for name, setting in settings.items()
            for row in found.get(setting, [])
        ]
    )
    settings = {"seed": seed, "after": size.after, "trials": size.trials, "repetitions": size.repetitions}
    drawn = {"rare": partial(_figure, table, shown)}
    return Finding("rare", settings, table, _printed(table), _findings(table), drawn)


def _printed(table: pd.DataFrame) -> pd.DataFrame:
    rows = table[table["level"].isin(LEVELS)]
    return pd.DataFrame(
        {
            "panel": rows["panel"],
            "setting": rows["setting"],
            "above the capacity": [f"{_percents([level])} %" for level in rows["level"]],
            "probability": [f"{mean:.2g}" for mean in rows["mean"]],
            "95 % interval": [
                f"{low:.2g} to {high:.2g}" for low, high in zip(rows["low"], rows["high"], strict=True)
            ],
            **{
                name: ["" if np.isnan(value) else f"{value:.2g}" for value in rows[name]]
                for name in ("theory", "gain")
            },
        }
    )


def _figure(table: pd.DataFrame, shown: list[Setting]) -> Figure:
    figure, panels = figures.panels(2, 2, (11.0, 8.4), sharex=True, sharey=True)
    for axes, (panel, settings) in zip(panels, _PANELS.items(), strict=True):
        for place, (name, setting) in enumerate(settings.items()):
            if setting not in shown:
                continue
            _draw(axes, pick(table, panel=panel, setting=name), place, name)
            walk = expected(setting, tuple(_GRID.tolist()))
            axes.plot(100.0 * _GRID - 100.0, walk, ":", color=colour(place), linewidth=1.3)
        figures.named(axes, "theory's walk", ":", linewidth=1.3)
        axes.set_yscale("log")
        x, y = "peak above the capacity (%)", f"probability within {WITHIN:g} periods"
        figures.dress(axes, _TITLES[panel], x, y, numbers="x", xlim=(0.0, 31.0), ylim=(1e-10, 2.0))
        axes.label_outer()
    # Where tails leave room: below on the left, but for those that fall fast.
    figures.legends(panels[:2], loc="lower left")
    figures.legends(panels[2:], loc="upper right")
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, place: int, name: str) -> None:
    """Draw a tail, with intervals at the levels that are asked for."""
    above = 100.0 * rows["level"] - 100.0
    axes.plot(above, rows["mean"], color=colour(place), linewidth=1.2)
    asked = rows["level"].isin(LEVELS)
    mean = rows["mean"][asked]
    reach = [mean - rows["low"][asked], rows["high"][asked] - mean]
    look: dict[str, Any] = {"fmt": figures.MARKS[place], "color": colour(place), "capsize": 2.5}
    label = f"{name} (not reached)" if rows.empty else name
    axes.errorbar(above[asked], mean, reach, label=label, markersize=5.5, **look)


def _findings(table: pd.DataFrame) -> list[str]:
    asked = [level for level in LEVELS if level in set(table["level"])]
    middle = asked[len(asked) // 2]

    def say(rows: pd.DataFrame) -> str:
        return ", ".join(
            f"{row['mean']:.2g} ({row['low']:.2g} to {row['high']:.2g})" for row in rows.to_dict("records")
        )

    def tail(name: str) -> str:
        rows = pick(table, panel=_LOSS, setting=name)
        return say(rows[rows["level"].isin(LEVELS)])

    def each(panel: str) -> str:
        rows = pick(table, panel=panel, level=middle)
        return "; ".join(f"{name} {say(one)}" for name, one in rows.groupby("setting", sort=False))

    best = table.nlargest(1, "gain").iloc[0]
    beside = table[table["level"].isin(LEVELS) & table["theory"].notna()]
    ratio = beside["theory"] / beside["mean"]
    rarest, gain, rare = table["mean"].min(), best["gain"], best["mean"]
    first, last = sentences(f"""
        - Within {WITHIN:g} periods demand is {_percents(asked)} % above the capacity with probability
          {tail("loss 0.3")}, at latency {_BASE.latency:g} and loss {_BASE.loss:g}.
        - The rarest estimate is {rarest:.2g}. For a probability of {rare:.2g} plain runs would have to
          simulate {gain:.2g} times as much for the same relative error. From its time above a level,
          theory's walk puts probabilities at {ratio.min():.2g} to {ratio.max():.2g} times those found.
    """)
    high = f"{_percents([middle])} % above the capacity"
    return [first, *(f"{high}, by {panel}: {each(panel)}." for panel in _PANELS), last]


def _percents(levels: list[float]) -> str:
    return ", ".join(f"{100.0 * level - 100.0:.0f}" for level in levels)


main = command("rare", study, __doc__)

if __name__ == "__main__":
    main()
