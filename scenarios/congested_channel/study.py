"""The study: what is run, and what is made of it."""

from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import gamma

from aimd_des import theory
from aimd_des.plots import colour
from aimd_des.study import jackknife
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, rows_of, run_draws
from scenarios.common.tables import (
    estimate,
    number,
    numbers,
    over_draws,
    pick,
    reached,
    shown,
    summarise_draws,
    theory_of,
    with_theory,
)
from scenarios.congested_channel.runs import (
    Constant,
    Excess,
    Holding,
    Law,
    Load,
    Overflow,
    Shares,
    Silence,
    Stay,
    load,
    shares,
    stay,
    system_of,
)

_BASE = 0.2
_EXCESS, _OVERFLOW, _SAME = "base + excess", "overflow", "the base alone"
_KEPT, _LOWER = "base + excess, 0.4 kept", "base + excess, threshold 0.9"
_LIMIT = 0.95
_LAWS: dict[str, Law] = {
    _EXCESS: Excess(_BASE, _LIMIT),
    _OVERFLOW: Overflow(_BASE),
    _SAME: Constant(_BASE),
    _KEPT: Excess(_BASE, 0.6),
    _LOWER: Excess(_BASE, _LIMIT),
}
# What chance may take away: loss, hold-off and threshold; and how far beyond the turning load that is.
_STAYS = ((_EXCESS, 1.0, 1.0), (_LOWER, 1.0, 0.9))
_GONE = 0.5
# An agent that is cut off for so long has a load far beyond every turning load.
_LONG = 60.0
# A load that is not back: below it are all that demand has under control.
_AWAY = 1.2
# How near the turning load chance may decide.
_NEAR, _HALF = 0.1, 0.5
_SILENCE, _REST, _SHARES = "comes back", "rest", "distance (%)"
_RATE, _EXPOSURE = "escapes per unit of time", "time at the capacity"
_LABELS = ["experiment", "loss", "hold_off", "x", "length"]
_OWN, _EQUAL = "in proportion to holdings", "the same for all"


class _Size(NamedTuple):
    draws: int
    silences: tuple[float, ...]
    hold_offs: tuple[float, ...]
    after: float
    limits: tuple[float, ...]
    lengths: tuple[float, ...]
    shares: tuple[float, ...]
    ends: tuple[float, float]
    stays: tuple[int, float]  # how many runs of a draw chance may take away, and how long they are


_FULL = _Size(
    draws=10,
    silences=(0.0, 2.0, 4.0, 6.0, 7.0, 8.0, 10.0, 12.0, 14.0, 16.0, 20.0),
    hold_offs=(1.0, 0.5, 0.25),
    after=400.0,
    limits=(0.95, 0.9),
    lengths=(500.0, 2000.0),
    shares=(0.05, 0.1, 0.2),
    ends=(1000.0, 3000.0),
    stays=(2, 2000.0),
)
_QUICK = _Size(2, (0.0, 16.0), (1.0, 0.5), 60.0, (0.95,), (150.0,), (0.2,), (100.0, 200.0), (1, 200.0))


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory of the paper's system with losses that depend on demand."""
    size = _QUICK if quick else _FULL
    silences = _silences(size)
    rests = [
        Silence(Excess(_BASE, limit), hold_off, _LONG, after=length)
        for limit in size.limits
        for hold_off in size.hold_offs[:2]
        for length in size.lengths
    ]
    holdings = [Holding(share, own, ends=size.ends) for share in size.shares for own in (True, False)]
    jobs = partial(run_draws, draws=size.draws, replications=1, seed=seed, quick=quick, runs=runs)
    rows = rows_of(jobs(load, silences), _silence_row, seed)
    rows += rows_of(jobs(load, rests), _rest_row, seed)
    held = [row for case, found in jobs(shares, holdings) for row in _share_rows(case, found, seed)]
    table = pd.concat([summarise_draws(some, _LABELS) for some in (rows, held)], ignore_index=True)
    table = with_theory(table, _LABELS)
    table = pd.concat([table, pd.DataFrame(_escapes(size, seed, quick, runs))], ignore_index=True)
    settings = {"seed": seed, **size._asdict()}
    printed = shown(table[table["measure"].isin([_SILENCE, _REST, _SHARES])], [*_LABELS, "measure"], ".3f")
    drawn = {"congested_channel": partial(_figure, table, size, seed)}
    return Finding("congested_channel", settings, table, printed, _findings(table, size, seed), drawn)


def _silences(size: _Size) -> list[Silence]:
    """List silences: all hold-offs with loss that grows, the longest one with what helps."""
    cases = [(_EXCESS, hold_off) for hold_off in size.hold_offs]
    cases += [(law, size.hold_offs[0]) for law in (_OVERFLOW, _SAME, _LOWER)]
    cases += [(_KEPT, size.hold_offs[1])]
    return [
        Silence(_LAWS[law], hold_off, silence, 0.9 if law == _LOWER else 1.0, size.after)
        for law, hold_off in cases
        for silence in size.silences
    ]


@lru_cache(maxsize=1024)
def _congestion(law: Law, hold_off: float, draw: int) -> theory.Congestion:
    return theory.congestion(system_of(draw), law, hold_off=hold_off)


def _silence_row(case: Silence, draw: int, one: Load) -> dict[str, Any]:
    gap = one.lifted - _congestion(case.law, case.hold_off, draw).turning
    back = one.last < _AWAY
    right = float(back == (gap < 0.0))
    law = _LOWER if case.threshold < 1.0 else next(name for name, law in _LAWS.items() if law == case.law)
    return {
        **dict(zip(_LABELS, ("silence", law, case.hold_off, case.silence, case.after), strict=True)),
        "lifted": one.lifted,
        _SILENCE: float(back),
        "as predicted": right,
        "clearly predicted": right if abs(gap) > _NEAR else np.nan,
    }


def _rest_row(case: Silence, draw: int, one: Load) -> dict[str, Any]:
    rests = _congestion(case.law, case.hold_off, draw).rests
    limit = case.law.limit if isinstance(case.law, Excess) else np.nan
    labels = dict(zip(_LABELS, ("rest", _EXCESS, case.hold_off, limit, case.after), strict=True))
    return {**labels, _REST: one.last, theory_of(_REST): rests[-1] if rests else np.nan}


def _escapes(size: _Size, seed: int, quick: bool, runs: Path | None) -> list[dict[str, Any]]:
    """Measure how often chance takes demand past the turning load, per unit of time, over draws."""
    each, until = size.stays
    cases = [Stay(_LAWS[law], hold_off, threshold, until, _GONE) for law, hold_off, threshold in _STAYS]
    pairs = run_draws(stay, cases, size.draws, each, seed, quick, runs)
    rows = []
    for (law, hold_off, threshold), (_, found) in zip(_STAYS, pairs, strict=True):
        counts = [np.sum(seen, axis=0) for seen in found]
        rate, error = jackknife(counts, lambda mean: mean[:1] / mean[1:])
        labels = {"experiment": "stay", "loss": law, "hold_off": hold_off, "x": threshold, "length": until}
        row = estimate(labels, _RATE, (rate, error), each * size.draws)
        spread = float(np.std([count[0] / count[1] for count in counts], ddof=1))
        rows.append({**row, "draws": size.draws, "spread": spread})
        row = estimate(labels, _EXPOSURE, (np.sum(counts, axis=0)[1], np.nan), each * size.draws)
        rows.append({**row, "draws": size.draws})
    return rows


def _share_rows(case: Holding, found: Sequence[Sequence[Shares]], seed: int) -> list[dict[str, Any]]:
    rows = []
    for draw, (one,) in enumerate(found, start=seed):
        for length, average in zip(case.ends, one.average, strict=True):
            labels = {"experiment": "shares", "loss": _OWN if case.own else _EQUAL, "hold_off": case.hold_off}
            off = 100 * float(distance(system_of(draw), average[:, None])[0])
            rows.append({**labels, "x": case.share, "length": length, "draw": draw, _SHARES: off})
    return rows


def _figure(table: pd.DataFrame, size: _Size, seed: int) -> Figure:
    figure, (left, middle, right) = figures.panels(1, 3, (14.0, 4.8))
    _draw_rests(left, table, size, seed)
    _draw_back(middle, table, size, seed)
    for place, loss in enumerate((_OWN, _EQUAL)):
        rows = pick(table, measure=_SHARES, loss=loss, length=size.ends[-1])
        figures.points(right, rows["x"], rows, place, f"loss {loss}", fmt="os"[place] + "-")
    x, y = "loss of an agent that holds the capacity over n", "distance from the optimum for what is used (%)"
    title = "(c) Agents that hold more lose more, and take more"
    figures.dress(right, title, x, y, ylim=(0.0, None), xlim=(0.0, None))
    figures.legends((left, middle, right))
    return figure


def _draw_rests(axes: Axes, table: pd.DataFrame, size: _Size, seed: int) -> None:
    """Draw where demand rests, and from where it does not come back, over the hold-off."""
    hold_offs = np.linspace(0.03, 1.2, 40 if len(size.limits) > 1 else 8)
    for place, limit in enumerate(size.limits):
        known = [_congestion(Excess(_BASE, limit), float(r), seed) for r in hold_offs]
        rest = [found.rests[-1] if found.rests else np.nan for found in known]
        turning = [found.turning if found.rests else np.nan for found in known]
        axes.plot(hold_offs, rest, color=colour(place), linewidth=1.5)
        axes.plot(hold_offs, turning, ":", color=colour(place), linewidth=1.8)
        rows = pick(table, measure=_REST, x=limit, length=size.lengths[-1])
        figures.points(axes, rows["hold_off"], rows, place, f"rest, loss at most {limit:g}")
    figures.level(axes, 1.0, "-")
    figures.named(axes, "theory: rest")
    figures.named(axes, "theory: turning load", ":", linewidth=1.8)
    x, y = "hold-off (periods)", "total demand over capacity"
    figures.dress(axes, "(a) Two steady states: at the capacity, far above it", x, y, ylim=(0.5, 7.0))


def _draw_back(axes: Axes, table: pd.DataFrame, size: _Size, seed: int) -> None:
    """Draw how many runs come back, over the load to which the silence has lifted demand."""
    kinds = [(_EXCESS, hold_off) for hold_off in size.hold_offs]
    kinds += [(_OVERFLOW, size.hold_offs[0]), (_SAME, size.hold_offs[0])]
    for place, (loss, hold_off) in enumerate(kinds):
        where: dict[str, Any] = {"loss": loss, "hold_off": hold_off}
        lifted = numbers(table, measure="lifted", **where)
        rows = pick(table, measure=_SILENCE, **where)
        label = f"{loss}, hold-off {hold_off:g}"
        figures.points(axes, lifted, rows, place, label, fmt=figures.MARKS[place] + "-", linewidth=1.0)
        turning = _congestion(_LAWS[loss], hold_off, seed).turning
        if np.isfinite(turning):
            axes.axvline(turning, color=colour(place), linestyle=":", linewidth=1.8)
    x, y = "load as the silence ends (capacity = 1)", "share of runs that come back"
    title = "(b) Demand above the turning load stays away"
    figures.dress(axes, title, x, y, ylim=(-0.05, 1.08), xlim=(0.45, 2.0))


def _survived(table: pd.DataFrame, law: str, hold_off: float) -> float:
    """Find the silence after which half of the runs stay away."""
    rows = pick(table, measure=_SILENCE, loss=law, hold_off=hold_off)
    return reached(rows["x"].to_numpy(), 1.0 - rows["mean"].to_numpy(), _HALF)


def _turning(size: _Size, seed: int, law: str, hold_off: float) -> str:
    found = [_congestion(_LAWS[law], hold_off, draw).turning for draw in range(seed, seed + size.draws)]
    return f"{min(found):.2f} to {max(found):.2f}"


def _findings(table: pd.DataFrame, size: _Size, seed: int) -> list[str]:
    slow, fast = size.hold_offs[0], size.hold_offs[-1]
    rests = "; ".join(
        f"{over_draws(table, measure=_REST, x=limit, hold_off=slow, length=size.lengths[-1])}"
        f" (theory {number(table, 'theory', measure=_REST, x=limit, hold_off=slow):.2f}) where loss is at"
        f" most {limit:g}"
        for limit in size.limits
    )
    right, clear = (numbers(table, measure=name) for name in ("as predicted", "clearly predicted"))
    weights = numbers(table, "draws", measure="clearly predicted")
    helped = {
        (law, hold_off): _survived(table, law, hold_off)
        for law, hold_off in [(_EXCESS, slow), (_EXCESS, fast), (_LOWER, slow)]
    }
    always = [(_OVERFLOW, slow), (_SAME, slow), (_KEPT, size.hold_offs[1])]
    back = [numbers(table, measure=_SILENCE, loss=law, hold_off=r).mean() for law, r in always]
    top = size.shares[-1]

    def off(loss: str, share: float, length: float) -> str:
        return over_draws(table, 1.0, 1, measure=_SHARES, loss=loss, x=share, length=length)

    longer = "; ".join(f"{off(_OWN, top, end)} after {end:,.0f}" for end in size.ends)
    return sentences(f"""
        - Where loss is {_BASE:g} plus the excess over the capacity, demand that has passed the turning load
          does not come back: by theory that is at {_turning(size, seed, _EXCESS, slow)} of the capacity with
          hold-off {slow:g} and at {_turning(size, seed, _EXCESS, fast)} with {fast:g}. Theory says rightly of
          {100 * right.mean():.0f} % of the runs whether they come back, and of
          {100 * float(clear @ weights) / float(weights.sum()):.1f} % of those that are more than {_NEAR:g}
          away from it.
        - What does not come back rests, with hold-off {slow:g}, at a load of {rests}.
        - Chance alone takes demand past the turning load {"; ".join(_said(table, *one) for one in _STAYS)}.
          That is measured: there is no theory of it here.
        - Half of the runs survive a silence of {helped[_EXCESS, slow]:.1f} periods with hold-off {slow:g},
          {helped[_LOWER, slow]:.1f} with that and threshold 0.9, and {helped[_EXCESS, fast]:.1f} with
          hold-off {fast:g}. After silences of up to {size.silences[-1]:g} {100 * back[0]:.0f} % come
          back where the
          channel drops the share that overflows, {100 * back[1]:.0f} % where loss does not grow, and
          {100 * back[2]:.0f} % with hold-off {size.hold_offs[1]:g} where 0.4 of the signals always pass.
        - Where an agent loses signals in proportion to what it holds, averages are
          {off(_OWN, size.shares[0], size.ends[-1])} % from the optimum with a loss of {size.shares[0]:g}, and
          with {top:g} {longer} periods; the same loss for all leaves
          {off(_EQUAL, top, size.ends[-1])} %.
    """)


def _said(table: pd.DataFrame, law: str, hold_off: float, threshold: float) -> str:
    """Say a rate, with its interval by Poisson for the draws that there are."""
    where: dict[str, Any] = {"experiment": "stay", "loss": law, "hold_off": hold_off}
    rate, time = (number(table, measure=measure, **where) for measure in (_RATE, _EXPOSURE))
    count = round(rate * time)
    low, high = (float(gamma.ppf(part, n)) if n else 0.0 for part, n in ((0.025, count), (0.975, count + 1)))
    return (
        f"{1e3 * rate:.2f} times in 1,000 periods ({1e3 * low / time:.2f} to "
        f"{1e3 * high / time:.2f}) with hold-off {hold_off:g} and threshold {threshold:g} ({count} times in "
        f"{time:,.0f})"
    )


main = command("congested_channel", study, "Can signals be lost to the excess that they report?")
