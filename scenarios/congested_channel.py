"""Can signals be lost to the excess that they report?

They can: where loss grows with the load, demand that has once passed a turning load does not come back by
itself, and rests at a multiple of the capacity.  Theory has that load; hold-offs far below 1 / rho put it far
away, and a channel that keeps enough of its capacity for signals has none.  Where an agent loses signals in
proportion to what it holds, shares are distorted a little, until single agents run away for themselves.
"""  # noqa: D400 - a question

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import gamma

from aimd_des import BroadcastChannel, Recording, theory
from aimd_des.interventions import Partition
from aimd_des.loss import Bernoulli, Loss
from aimd_des.lowlevel import Draws, FloatArray, Purpose, System
from aimd_des.plots import colour
from aimd_des.study import jackknife
from scenarios.common import figures
from scenarios.common.command import Finding, command, sentences
from scenarios.common.measure import distance, quietly, rows_of, run_draws, sensed, totals
from scenarios.common.systems import lowered, memory_alone
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

# Loss depends on demand from here on, so that the start of a run is none of the causes; no agent hears from
# `OUTAGE` on for a while.
BEGIN, OUTAGE = 200.0, 300.0
# A level of demand is a mean over so much time.
_STRETCH = 50.0


@dataclass(frozen=True)
class Excess:
    """Loss that grows by the excess over the capacity; what it may not pass is kept for signals."""

    base: float
    limit: float = 1.0

    def __call__(self, load: float) -> float:
        """Return the probability of loss at a load."""
        return min(self.base + max(load - 1.0, 0.0), self.limit)


@dataclass(frozen=True)
class Overflow:
    """Loss of the share of all traffic that exceeds the capacity, and of a part of the rest."""

    base: float

    def __call__(self, load: float) -> float:
        """Return the probability of loss at a load."""
        return 1.0 - (1.0 - self.base) / max(load, 1.0)


@dataclass(frozen=True)
class Constant:
    """Loss that does not depend on the load: the run without the cause."""

    base: float

    def __call__(self, load: float) -> float:
        """Return the probability of loss at a load."""
        return self.base


Law = Excess | Overflow | Constant


@dataclass(frozen=True)
class LoadLoss:
    """Loss that is the same for all, and depends on the load by a law from a time on."""

    law: Law
    begin: float = 0.0

    def start(self, n_agents: int) -> "_ReadingLoss":
        """Begin a run."""
        return _ReadingLoss(self._chance)

    def _chance(self, system: System, draws: Draws) -> float:
        load = system.total(draws.resource) / float(system.problem.capacity[draws.resource])
        return self.law(load if draws.time >= self.begin else 1.0)


@dataclass(frozen=True)
class HoldingLoss:
    """Loss in proportion to what an agent holds, up to a limit; `share` at the capacity over n."""

    share: float
    limit: float

    def start(self, n_agents: int) -> "_ReadingLoss":
        """Begin a run."""
        return _ReadingLoss(self._chance)

    def _chance(self, system: System, draws: Draws) -> FloatArray:
        held, j = system.allocations()[0][draws.resource], draws.resource
        parts = held * (draws.n_agents / float(system.problem.capacity[j]))
        return np.asarray(np.minimum(self.share * parts, self.limit))


@dataclass(eq=False)
class _ReadingLoss:
    """Losses of one run, with a probability that is read off it."""

    chance: Callable[[System, Draws], float | FloatArray]

    def attach(self, system: System) -> None:
        """Take the run in progress."""
        self.system = system

    def draw(self, draws: Draws) -> npt.NDArray[np.bool_]:
        """Say of each agent's copy whether it is lost, shape (n,)."""
        return np.asarray(draws.uniforms(Purpose.LOSS) < self.chance(self.system, draws))


class Silence(NamedTuple):
    """A run in which no agent hears for a while; then signals are lost by a law."""

    law: Law
    hold_off: float
    silence: float  # how long no agent hears, in units of time
    threshold: float = 1.0
    after: float = 400.0  # how long it runs afterwards


@lru_cache(maxsize=1024)
def _congestion(law: Law, hold_off: float, draw: int, threshold: float = 1.0) -> theory.Congestion:
    return theory.congestion(lowered(memory_alone(draw=draw), threshold), law, hold_off=hold_off)


def load(case: Silence, draw: int, seed: int) -> tuple[float, float]:
    """Run, and measure the load as the silence ends, and its mean over the last stretch."""
    back = OUTAGE + case.silence
    until = back + case.after
    simulation = sensed(
        lowered(memory_alone(draw=draw), case.threshold),
        case.hold_off,
        channel=BroadcastChannel(loss=LoadLoss(case.law, BEGIN)),
        interventions=[Partition(OUTAGE, case.silence)] if case.silence > 0.0 else [],
        seed=seed,
        recording=Recording(demand=[back, *np.arange(until - _STRETCH, until, 0.5)], overshoot=False),
    )
    total = totals(quietly(simulation, until))
    return float(total[0]), float(total[1:].mean())


class Stay(NamedTuple):
    """A run that only chance takes from the capacity, with loss by a law from the start on."""

    law: Law
    hold_off: float
    threshold: float
    until: float
    gone: float  # so far beyond the turning load no run is ever on its way back


def stay(case: Stay, draw: int, seed: int) -> FloatArray:
    """Run, and count escapes, 0 or 1, and the time until then; without the first stretch."""
    begin = 2.0 * _STRETCH
    looks = np.arange(begin, case.until)
    simulation = sensed(
        lowered(memory_alone(draw=draw), case.threshold),
        case.hold_off,
        channel=BroadcastChannel(loss=LoadLoss(case.law, begin)),
        seed=seed,
        recording=Recording(demand=looks, overshoot=False),
    )
    total = totals(quietly(simulation, case.until))
    turning = _congestion(case.law, case.hold_off, draw, case.threshold).turning
    away = np.flatnonzero(total > turning + case.gone)
    return np.array([len(away) > 0, looks[away[0]] - begin if len(away) else case.until - begin])


class Holding(NamedTuple):
    """A run with loss in proportion to what agents hold, or the same for all, with two lengths."""

    share: float
    own: bool  # whether it is in proportion
    hold_off: float = 0.25
    limit: float = 0.9
    ends: tuple[float, float] = (2000.0, 4000.0)

    @property
    def loss(self) -> Loss:
        """The model of loss."""
        return HoldingLoss(self.share, self.limit) if self.own else Bernoulli(self.share)


def shares(case: Holding, draw: int, seed: int) -> list[float]:
    """Run, and measure how far averages are from the optimum for what they use, at both ends."""
    problem = memory_alone(draw=draw)
    simulation = sensed(
        problem,
        case.hold_off,
        channel=BroadcastChannel(loss=case.loss),
        seed=seed,
        recording=Recording(demand="end", allocations=list(case.ends[:1]), overshoot=False),
    )
    found = quietly(simulation, case.ends[1]).observations.average[-2:]
    return [float(distance(problem, average.T)[0]) for average in found]


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
    held = list(_share_rows(jobs(shares, holdings), seed))
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


def _labels(experiment: str, *others: Any) -> dict[str, Any]:
    return dict(zip(_LABELS, (experiment, *others), strict=True))


def _silence_row(case: Silence, draw: int, loads: tuple[float, float]) -> dict[str, Any]:
    lifted, last = loads
    gap, back = lifted - _congestion(case.law, case.hold_off, draw).turning, last < _AWAY
    right = float(back == (gap < 0.0))
    law = _LOWER if case.threshold < 1.0 else next(name for name, law in _LAWS.items() if law == case.law)
    return {
        **_labels("silence", law, case.hold_off, case.silence, case.after),
        "lifted": lifted,
        _SILENCE: float(back),
        "as predicted": right,
        "clearly predicted": right if abs(gap) > _NEAR else np.nan,
    }


def _rest_row(case: Silence, draw: int, loads: tuple[float, float]) -> dict[str, Any]:
    rests = _congestion(case.law, case.hold_off, draw).rests
    limit = case.law.limit if isinstance(case.law, Excess) else np.nan
    labels = _labels("rest", _EXCESS, case.hold_off, limit, case.after)
    return {**labels, _REST: loads[1], theory_of(_REST): rests[-1] if rests else np.nan}


def _escapes(size: _Size, seed: int, quick: bool, runs: Path | None) -> list[dict[str, Any]]:
    """Measure how often chance takes demand past the turning load, per unit of time, over draws."""
    each, until = size.stays
    cases = [Stay(_LAWS[law], hold_off, threshold, until, _GONE) for law, hold_off, threshold in _STAYS]
    pairs = run_draws(stay, cases, size.draws, each, seed, quick, runs)
    rows = []
    for (law, hold_off, threshold), (_, found) in zip(_STAYS, pairs, strict=True):
        counts = [np.sum(seen, axis=0) for seen in found]
        rate, error = jackknife(counts, lambda mean: mean[:1] / mean[1:])
        labels = _labels("stay", law, hold_off, threshold, until)
        row = estimate(labels, _RATE, (rate, error), each * size.draws)
        spread = float(np.std([count[0] / count[1] for count in counts], ddof=1))
        rows.append({**row, "draws": size.draws, "spread": spread})
        row = estimate(labels, _EXPOSURE, (np.sum(counts, axis=0)[1], np.nan), each * size.draws)
        rows.append({**row, "draws": size.draws})
    return rows


def _share_rows(
    pairs: Iterable[tuple[Holding, list[list[list[float]]]]], first: int
) -> Iterable[dict[str, Any]]:
    for case, found in pairs:
        for draw, (distances,) in enumerate(found, first):
            for length, off in zip(case.ends, distances, strict=True):
                labels = _labels("shares", _OWN if case.own else _EQUAL, case.hold_off, case.share, length)
                yield {**labels, "draw": draw, _SHARES: 100 * off}


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


main = command("congested_channel", study, __doc__)

if __name__ == "__main__":
    main()
