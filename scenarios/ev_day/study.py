"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour, shared_legend
from aimd_des.study import mean_and_error, replicate
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.tables import number, numbers, shown, summarise
from scenarios.ev_day.runs import LOOKS, LOSS, SHARES, SPAN, TIMES, Case, Night, night

_PERFECT, _LOSSY, _LOWERED = "perfect", "late and lossy", "late and lossy, lower threshold"
_LATE_ALONE, _LOST_ALONE = "late alone", "lossy alone"
_STAY, _FORGET, _NOBODY = "all of the stay", "forgetting", "uncontrolled"
_CASES = {
    (_PERFECT, _STAY): Case(late=False, lossy=False),
    (_LOSSY, _STAY): Case(late=True, lossy=True),
    (_LOSSY, _FORGET): Case(late=True, lossy=True, forgets=True),
    (_LOWERED, _STAY): Case(late=True, lossy=True, lowered=True),
    (_LATE_ALONE, _STAY): Case(late=True, lossy=False),
    (_LOST_ALONE, _STAY): Case(late=False, lossy=True),
}
_BAD, _OTHER, _LOW = "lossy minus perfect", "forgetting minus all of the stay", "lower threshold minus not"
_LATER, _FEWER = "late alone minus perfect", "lossy alone minus perfect"
_PAIRS = ((_BAD, 1, 0), (_OTHER, 2, 1), (_LOW, 3, 1), (_LATER, 4, 0), (_FEWER, 5, 0))
_ABOVE, _SIGNALS, _SPARE = "minutes above capacity", "signals, 22:00 to 1:00", "hours to spare"
_ERROR, _USED = "error of averages", "used, 22:00 to 1:00"


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run nights with a perfect channel, a bad one, averages that forget, and a lower threshold."""
    replications, n, step = (2, 6, 240) if quick else (12, 40, 15)
    jobs = [partial(night, case, n, step) for case in _CASES.values()]
    nights = replicate(jobs, replications, seed, workers=1 if quick else None, out=runs)
    table = _table(nights)
    settings = {"seed": seed, "replications": replications, "vehicles": n}
    printed = shown(table, ["channel", "average", "measure"], ".3f")
    drawn = {"ev_day": partial(_figure, table, nights)}
    return Finding("ev_day", settings, table, printed, _findings(table), drawn)


def _table(nights: list[list[Night]]) -> pd.DataFrame:
    """Sum up the nights, what would be without control, and paired differences."""
    keys = ["channel", "average"]
    labelled = [
        (dict(zip(keys, case, strict=True)), run)
        for case, runs in zip(_CASES, nights, strict=True)
        for run in runs
    ]
    rows = [{**labels, **run.measures} for labels, run in labelled]
    for _, uncontrolled, capacity, _ in (run.lines for run in nights[0]):
        above, peak = 5.0 * float((uncontrolled > capacity).sum()), float((uncontrolled / capacity).max())
        rows.append({"channel": _NOBODY, "average": "", _ABOVE: above, "peak": peak})
    for name, one, other in _PAIRS:
        for left, right in zip(nights[one], nights[other], strict=True):
            gaps = {key: left.measures[key] - right.measures[key] for key in (_SIGNALS, _SPARE)}
            rows.append({"channel": name, "average": "", **gaps})
    table = summarise(rows, keys)
    expected = summarise([{**labels, **run.expected} for labels, run in labelled], keys)
    predicted = expected[[*keys, "measure", "mean"]].rename(columns={"mean": "theory"})
    return table[table["replications"] > 0].merge(predicted, "left", [*keys, "measure"])


def _figure(table: pd.DataFrame, nights: list[list[Night]]) -> Figure:
    figure = Figure(figsize=(13.0, 5.4), layout="constrained")
    axes = figure.subplot_mosaic("abc;abc;abd;ebd", width_ratios=[1.2, 0.9, 1.1])
    _draw_day(axes["a"], axes["e"], nights[1][0].lines)
    _draw_progress(axes["b"], nights[1][0].progress)
    _draw_error(axes["c"], table, nights)
    _draw_above(axes["d"], table)
    titles = {
        "a": "A night: what the houses leave is used",
        "b": "All are full before they leave",
        "c": "Averages are off by luck, and late",
        "d": "Overload of the transformer in a night",
    }
    for name, title in titles.items():
        axes[name].set_title(f"({name}) {title}", loc="left", fontsize="medium")
    for each in axes.values():
        figures.frame(each)
    shared_legend(figure)
    return figure


def _clock(axes: Axes, low: int, high: int, every: int) -> None:
    ticks = range(low, high + 1, every)
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, [f"{(12 + tick // 60) % 24}:00" for tick in ticks])
    axes.set_xlabel("time of day")
    axes.set_ylim(0.0)
    figures.number_axis(axes.yaxis)


def _draw_day(power: Axes, present: Axes, lines: FloatArray) -> None:
    total, uncontrolled, capacity, here = lines
    power.fill_between(TIMES, uncontrolled, color="0.86", label="charging if nobody held back")
    power.plot(TIMES, total, color=colour(0), linewidth=1.3, label="charging")
    power.plot(TIMES, capacity, color=colour(1), linewidth=1.8, label="capacity left by the houses")
    present.plot(TIMES, here, color=figures.REFERENCE, drawstyle="steps-post")
    for axes, label in ((power, "power (kW)"), (present, "vehicles")):
        _clock(axes, 120, 1320, 240)
        axes.set_ylabel(label)
    present.set_yticks([0, int(here.max())])
    power.set_xlabel("")
    power.tick_params(labelbottom=False)


def _draw_progress(axes: Axes, progress: FloatArray) -> None:
    axes.plot(100 * SHARES, 100 * progress, color=colour(0), linewidth=0.6, alpha=0.7)
    figures.named(axes, "one vehicle", color=colour(0), linewidth=0.8, alpha=0.7)
    axes.plot([0, 100], [0, 100], "--", color=figures.REFERENCE, linewidth=1.4, label="just in time")
    axes.set(xlabel="part of the stay that is over (%)", ylabel="energy delivered (% of the need)")
    axes.set(xlim=(0, 100), ylim=(0, 103))


def _draw_error(axes: Axes, table: pd.DataFrame, nights: list[list[Night]]) -> None:
    for place, name in ((1, "average over all of the stay"), (2, "average that forgets in 2 hours")):
        mean, error = mean_and_error([100 * run.error for run in nights[place]])
        shade, marker = colour(place + 1), " os"[place]
        axes.errorbar(LOOKS, mean, 2 * error, color=shade, marker=marker, markersize=4.0, label=name)
        luck = 100 * numbers(table, "theory", channel=_LOSSY, measure=_ERROR)[place - 1]
        axes.plot(SPAN, [luck, luck], ":", color=figures.REFERENCE, linewidth=1.8)
    figures.named(axes, "luck alone, by theory", ":", linewidth=1.8)
    axes.set_ylabel("distance of averages\nfrom the optimum (%)")
    _clock(axes, 360, 900, 120)


def _draw_above(axes: Axes, table: pd.DataFrame) -> None:
    names = (_NOBODY, _PERFECT, _LOSSY, _LOWERED)
    for place, name in enumerate(names):
        minutes, error = _value(table, name, _ABOVE)
        peak, _ = _value(table, name, "peak")
        fill = "0.86" if name == _NOBODY else colour(0)
        axes.barh(-place, minutes, 0.4, xerr=2 * error, color=fill, capsize=2.0)
        words = f"{name}: {minutes:.0f} min, up to {peak:.2f} of capacity"
        axes.text(2.0, 0.28 - place, words, va="bottom", fontsize="small")
    axes.set_yticks([])
    axes.set(xlabel="minutes above the capacity", ylim=(-3.4, 0.8), xlim=(0.0, None))
    figures.number_axis(axes.xaxis)


def _value(table: pd.DataFrame, channel: str, measure: str, **average: str) -> tuple[float, float]:
    """Look up a mean and its error, of the average over all of the stay unless it is said."""
    wanted = {"channel": channel, "measure": measure, **average}
    return number(table, **wanted), number(table, "standard_error", **wanted)


def _findings(table: pd.DataFrame) -> list[str]:
    def mean(channel: str, measure: str, **average: str) -> float:
        return number(table, channel=channel, measure=measure, **average)

    def both(channel: str, measure: str, scale: float = 1.0) -> str:
        value, error = _value(table, channel, measure)
        return f"{scale * value:.1f} ± {abs(scale) * error:.1f}"

    ratio, rate = mean(_LOSSY, _SIGNALS) / mean(_PERFECT, _SIGNALS), 1.0 / (1.0 - LOSS)
    allowed = number(table, "theory", channel=_LOWERED, measure=_ABOVE)
    luck = 100 * numbers(table, "theory", channel=_LOSSY, measure=_ERROR)
    stay, forget = (100 * mean(_LOSSY, _ERROR, average=name) for name in (_STAY, _FORGET))
    return sentences(f"""
        - {100 * mean(_LOSSY, "energy missing"):.1f} % of the energy needed is missing when vehicles leave.
          They are full {both(_LOSSY, _SPARE)} hours early, the last of a night
          {both(_LOSSY, "least hours to spare")} hours.
        - Where nobody holds back the capacity is exceeded for {mean(_NOBODY, _ABOVE):.0f} minutes of a night,
          up to {mean(_NOBODY, "peak"):.1f} times; with one bit, late and lossy, for {both(_LOSSY, _ABOVE)}
          minutes, by up to {100 * mean(_LOSSY, "peak") - 100:.1f} %; with a perfect channel for
          {both(_PERFECT, _ABOVE)}.
        - The bad channel takes {ratio:.2f} times the signals, where 1 / (1 - p) is {rate:.2f}. It leaves
          demand nearer to the capacity, {100 * mean(_LOSSY, _USED):.1f} % of it instead of
          {100 * mean(_PERFECT, _USED):.1f} %, and vehicles are full {both(_BAD, _SPARE, 60.0)} minutes
          earlier: {both(_LATER, _SPARE, 60.0)} by latency alone, {both(_FEWER, _SPARE, 60.0)} by loss alone.
        - With the threshold that theory gives, {mean(_LOWERED, "threshold"):.3f}, the capacity is exceeded
          for {mean(_LOWERED, _ABOVE):.2f} minutes, of {allowed:.1f} allowed, and vehicles are full
          {both(_LOW, _SPARE, -60.0)} minutes later.
        - With averages that forget, vehicles are full {both(_OTHER, _SPARE, 60.0)} minutes earlier. These
          averages are {forget:.1f} % from the optimum in force around midnight, and {stay:.1f} % over all of
          the stay; luck alone is {luck[1]:.1f} and {luck[0]:.1f} %.
    """)


main = command(
    "ev_day", study, "Do vehicles charge in time behind one transformer, by one bit that gets lost?"
)
