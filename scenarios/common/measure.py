"""One run of the paper's system, or one like it, and what is measured after its start has died away."""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    OverloadWarning,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    metrics,
    run_synchronous,
    solve_optimum,
)
from aimd_des.interventions import CapacityStep
from aimd_des.latency import Constant
from aimd_des.loss import Bernoulli
from aimd_des.lowlevel import Channel, FloatArray, ProcessGenerator, System
from aimd_des.study import replicate
from aimd_des.theory import reweighted_optimum

_Case = TypeVar("_Case")
_Outcome = TypeVar("_Outcome")

# A signal that comes so soon after another can find it still in the latch of a slow clock.
_SOON = 1.5

# More than a study has replications, so that no two draws share a seed.
_SEEDS_A_DRAW = 1_000

# Looks at total demand a period where clocks are apart: it changes between the control unit's looks.
_LOOKS_PER_PERIOD = 8


@dataclass(frozen=True, eq=False)
class Run:
    """What is run."""

    problem: Problem  # what is shared
    # The end, and the time from which signals, utilisation and peaks are measured.
    until: float
    start: float
    dynamics: Literal["discrete", "continuous"] = "discrete"  # which agents
    control_unit: Sampled | Crossing = field(default_factory=Sampled)  # what senses
    latency: float = 0.0  # common to all copies
    loss: float | FloatArray = 0.0  # (n,): probability of loss
    clocks: Clocks | None = None  # of discrete agents, default: in phase


class Measures(NamedTuple):
    """What is measured of one run; arrays have shape (m,) but where it is said."""

    signals: FloatArray  # signals per unit of time, after the start
    utilisation: FloatArray  # time average of total demand over the capacity, after the start
    misallocation: FloatArray  # of the averages at the end, which are those over the whole run
    # Highest total demand after the start, and the median of all its local peaks, over the capacity;
    # typical peaks are NaN for discrete agents.
    peak: FloatArray
    typical_peak: FloatArray
    saturated: FloatArray  # share of the responses that had a probability above 1
    # Share of the signals that come within one and a half units of time of the one before.
    repeated: FloatArray
    average: FloatArray  # (n, m): averages at the end, in units of the resources


class _Peaks:
    """Follows total demand of continuous agents, and keeps what it was before each fall."""

    def __init__(self, start: float) -> None:
        self.start = start
        self.tops: list[list[float]] = []

    def __call__(self, system: System) -> ProcessGenerator:
        self._slope = system.parameters.increase.sum(axis=1).tolist()
        self._total, self._time = [0.0] * len(self._slope), [0.0] * len(self._slope)
        self.tops = [[] for _ in self._slope]
        system.on_response.append(self._changed)
        yield from ()

    def _changed(self, time: float, resource: int, change: float) -> None:
        if time > self._time[resource]:
            self._total[resource] += self._slope[resource] * (time - self._time[resource])
            self._time[resource] = time
            if time >= self.start:
                self.tops[resource].append(self._total[resource])
        self._total[resource] += change


def distance(problem: Problem, average: FloatArray, weights: npt.ArrayLike | None = None) -> FloatArray:
    """Compute how far averages (n, m) are from the optimum for what they use, of reweighted costs if asked.

    The sum of absolute deviations over the sum, (m,).
    """
    used = average.sum(axis=0)
    best = (
        solve_optimum(problem, capacity=used)
        if weights is None
        else reweighted_optimum(problem, weights, capacity=used)
    )
    return metrics.relative_error(average, best.allocation)


def sensed(problem: Problem, hold_off: float | Crossing, **parts: Any) -> Simulation:
    """Set up continuous agents as a fleet, with a control unit that senses crossings."""
    unit = hold_off if isinstance(hold_off, Crossing) else Crossing(hold_off)
    return Simulation(problem, dynamics="continuous", control_unit=unit, agents=Fleet, **parts)


def quietly(simulation: Simulation, until: float) -> Result:
    """Run without warnings of probabilities above 1 and of overload: what is measured says so."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* responses had a probability above 1", RuntimeWarning)
        warnings.simplefilter("ignore", OverloadWarning)
        return simulation.run(until)


def totals(result: Result) -> FloatArray:
    """Take total demand of one resource over its capacity, at all samples."""
    return np.asarray(result.observations.total_demand[:, 0] / result.problem.capacity[0])


def signal_rate(result: Result, start: float) -> float:
    """Count the signals per unit of time from `start` on."""
    return float((result.signals_sent.time >= start).sum() / (result.until - start))


class Late(NamedTuple):
    """What is measured of one resource from a note on, over the capacity; `average` (n, 1) in its unit."""

    signals: float
    utilisation: float
    peak: float
    time_above: float
    excess: float
    average: FloatArray


def run_late(
    problem: Problem,
    hold_off: float | Crossing,
    channel: Channel,
    span: tuple[float, float],
    seed: int,
    looks: Any,
) -> Result:
    """Run with total demand recorded at `looks`, and noted at the first instant of the span for `late`.

    The capacity is set to what it is: totals are integrated exactly from there on.
    """
    start, until = span
    simulation = sensed(
        problem,
        hold_off,
        channel=channel,
        interventions=[CapacityStep(problem.resource_names[0], start, float(problem.capacity[0]))],
        seed=seed,
        recording=Recording(demand=looks, allocations=[start]),
    )
    return quietly(simulation, until)


def late(result: Result, start: float) -> Late:
    """Measure a run as `run_late` makes it."""
    span, seen = result.until - start, result.observations
    average = ((seen.average[-1] * result.until - seen.average[0] * start) / span).T
    over = seen.stretches[-1].overshoot()
    return Late(
        signals=signal_rate(result, start),
        utilisation=float(average.sum() / result.problem.capacity[0]),
        peak=float(over.peak[0]),
        time_above=float(over.time[0]),
        excess=float(over.mean[0]),
        average=average,
    )


def measure(run: Run, seed: int) -> Measures:
    """Run and measure."""
    peaks = _Peaks(run.start)
    return _measure(run, _run(run, seed, peaks), peaks)


def _run(run: Run, seed: int, peaks: _Peaks) -> Result:
    discrete, apart = run.dynamics == "discrete", run.clocks is not None
    step = 1.0 / _LOOKS_PER_PERIOD if apart else 1.0
    count = int((run.until - run.start) / step) if discrete else 1
    looks = [run.start + step * look for look in range(count)]
    recording = Recording(demand=looks, overshoot=False)
    plain = discrete and not apart and not np.any(run.loss) and run.control_unit == Sampled()
    if plain and run.latency <= 1.0:  # the same run to the last bit, in a fraction of the time
        lag = int(run.latency > 0.0)
        return run_synchronous(run.problem, steps=int(run.until), seed=seed, lag=lag, recording=recording)
    channel = BroadcastChannel(latency=Constant(run.latency), loss=Bernoulli(run.loss))
    simulation = Simulation(
        run.problem,
        dynamics=run.dynamics,
        control_unit=run.control_unit,
        channel=channel,
        agents=Fleet,
        clocks=run.clocks,
        seed=seed,
        recording=recording,
        processes=() if discrete else (peaks,),
    )
    return quietly(simulation, run.until)


def _measure(run: Run, result: Result, peaks: _Peaks) -> Measures:
    problem, seen, sent = run.problem, result.observations, result.signals_sent
    m, span = problem.n_resources, run.until - run.start
    counted = np.bincount(sent.resource[sent.time >= run.start], minlength=m)
    used = seen.total_average[-1] * run.until - seen.total_average[0] * run.start
    if run.dynamics == "discrete":
        peak, typical = seen.total_demand.max(axis=0), np.full(m, np.nan)
    else:
        tops = [np.array(row) if row else np.full(1, np.nan) for row in peaks.tops]
        peak = np.array([row.max() for row in tops])
        typical = np.array([np.median(row) for row in tops])
    responses = result.account.responses.sum(axis=1)
    average = result.average_at_end
    return Measures(
        signals=counted / span,
        utilisation=used / span / problem.capacity,
        misallocation=distance(problem, average),
        peak=peak / problem.capacity,
        typical_peak=typical / problem.capacity,
        saturated=result.account.saturated.sum(axis=1) / np.maximum(responses, 1),
        repeated=np.array([_repeated(sent.time[sent.resource == j]) for j in range(m)]),
        average=average,
    )


def _repeated(times: FloatArray) -> float:
    return float((np.diff(times) < _SOON).mean()) if len(times) > 1 else 0.0


def run_all(
    function: Callable[[_Case, int], _Outcome],
    cases: Sequence[_Case],
    replications: int,
    seed: int,
    quick: bool,
    runs: Path | None = None,
) -> list[tuple[_Case, list[_Outcome]]]:
    """Run cases with the same seeds, in this process where it is quick: each with its outcomes."""
    jobs = [partial(function, case) for case in cases]
    outcomes = replicate(jobs, replications, seed, workers=1 if quick else None, out=runs)
    return list(zip(cases, outcomes, strict=True))


def run_draws(
    function: Callable[[_Case, int, int], _Outcome],
    cases: Sequence[_Case],
    draws: int,
    replications: int,
    seed: int,
    quick: bool,
    runs: Path | None = None,
) -> list[tuple[_Case, list[list[_Outcome]]]]:
    """Run cases for their draws, from `seed` on: each case with the outcomes of each draw.

    The function takes a case, a draw and a seed.  Cases share draws and seeds, so that their differences are
    paired; draws do not share seeds, so that they are independent.
    """
    numbers = range(seed, seed + draws)
    jobs = [partial(_run_draw, function, case, draw) for case in cases for draw in numbers]
    outcomes = replicate(jobs, replications, workers=1 if quick else None, out=runs)
    groups = [outcomes[first : first + draws] for first in range(0, len(outcomes), draws)]
    return list(zip(cases, groups, strict=True))


def rows_of(
    pairs: Iterable[tuple[Any, Iterable[Iterable[Any]]]],
    row: Callable[[Any, int, Any], Mapping[str, Any]] | None = None,
    first: int = 0,
) -> list[dict[str, Any]]:
    """List what `run_draws` gives, a row for each run, with its `draw`, which are counted from `first` on.

    A row is what a function of case, draw and outcome makes of them; default: the fields of the case, and the
    numbers of the outcome by measure.
    """
    return [
        {"draw": draw, **(row(case, draw, one) if row else {**case._asdict(), **one})}
        for case, found in pairs
        for draw, outcomes in enumerate(found, first)
        for one in outcomes
    ]


def _run_draw(function: Callable[[_Case, int, int], _Outcome], case: _Case, draw: int, seed: int) -> _Outcome:
    return function(case, draw, seed + _SEEDS_A_DRAW * draw)
