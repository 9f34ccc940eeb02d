"""How well `theory.convergence` predicts the accuracy of runs: five tables."""

import argparse
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Result,
    Simulation,
    averaging,
    loss,
    metrics,
    responses,
    run_synchronous,
    solve_optimum,
    theory,
)
from aimd_des.lowlevel import FloatArray
from aimd_des.study import jackknife
from benchmarks.harness import console, positive, table
from models import random_convex, smart_cameras

__all__ = ["Slopes", "main", "slopes", "slow_costs"]

SIZES = (5, 10, 20, 50, 100, 200)
LENGTHS = (1000.0, 10_000.0, 30_000.0)
# Draws of the paper's costs, and the longest runs of each.
DRAWS = {0: 1_000_000.0, 1: 100_000.0, 2: 100_000.0, 3: 100_000.0, 4: 100_000.0, 5: 100_000.0}
DECADES = (1000.0, 10_000.0, 100_000.0, 1_000_000.0)
COUPLED = (0, 1, 2, 3, 7)
LONG = (10_000.0, 100_000.0, 1_000_000.0)
SLOPE_AT = (3000.0, 6463.0, 13_925.0, 30_000.0, 64_633.0, 139_248.0, 300_000.0)
SLOW = ((0.2, 1.0), (0.3, 1.0), (0.6, 1.0))
GAINS = (1.0, 5.0)
# Loss, and for how many units of time: for a standard error of the bias of 1 % of it.
LOSSES = {0.0: 9, 0.2: 17, 0.4: 38}
ONE_RUN = 1_000_000.0
# What is claimed of standard deviations, slopes and biases.
IN_THE_MEAN, EACH, SLOPE, BIAS = 0.03, 0.06, 0.03, 0.03
CURE = responses.Derandomised("events")


class Slopes(NamedTuple):
    """Slopes of the mean misallocation over the time, both as logarithms, of each resource, (m,)."""

    measured: FloatArray
    error: FloatArray  # standard error of the measured one; NaN for a single run
    predicted: FloatArray


def slow_costs(elasticities: tuple[float, float], n: int = 60) -> Problem:
    """Make costs with the derivatives 1 - e + e x / x* by turns, which are 1 at a known optimum x*."""
    optimum = np.random.default_rng(0).uniform(0.5, 1.5, n)
    steep = np.resize(elasticities, n)
    coefficients = np.stack([1.0 - steep, 0.5 * steep / optimum], axis=1)[:, None, :]
    shared = Resource("shared", optimum.sum(), increase=0.025, decrease=0.7, normalization=0.2)
    return Problem([shared], PolynomialCosts([1, 2], coefficients))


def slopes(problem: Problem, at: Sequence[float], runs: int, **rule: Any) -> Slopes:
    """Compare slopes over these times on the clock without lag; `rule` is a response and an averaging."""
    expected = theory.convergence(problem, **rule).misallocation(at).mean
    slope = partial(_slope, at)
    averages = [_averages(_on_the_clock(problem, at, luck, **rule), at) for luck in range(runs)]
    measured, error = jackknife([_misallocation(problem, rows) for rows in averages], slope)
    return Slopes(measured, error, slope(expected))


def slopes_over_draws(at: Sequence[float], draws: int, **rule: Any) -> Slopes:
    """Compare slopes of the mean over draws of the cameras' costs and their resources, without draws in runs.

    A run without draws is off the prediction by a factor whose mean is 1 and whose scatter grows with time:
    the mean of the factors is followed, since the mean of their logarithms falls.
    """
    factors, predicted = [], []
    for draw in range(draws):
        problem = smart_cameras(seed=draw)
        expected = theory.convergence(problem, **rule).misallocation(at).mean
        averages = _averages(_on_the_clock(problem, at, 0, **rule), at)
        factors.append((_misallocation(problem, averages) / expected).mean(axis=1))
        predicted.append(expected.mean(axis=1))
    slope = partial(_slope, at)
    expected = slope(np.mean(predicted, axis=0))
    off, error = jackknife(factors, slope)
    return Slopes(expected + off, error, expected)


def _slope(at: Sequence[float], rows: FloatArray) -> FloatArray:
    return np.asarray(np.polyfit(np.log(at), np.log(rows), 1)[0])


def _recording(at: Sequence[float]) -> Recording:
    return Recording(demand="end", allocations=list(at), overshoot=False)


def _averages(result: Result, at: Sequence[float]) -> FloatArray:
    """Averages at these times, (q, n, m)."""
    return result.observations.average[-len(at) :].transpose(0, 2, 1)


def _off(problem: Problem, average: FloatArray) -> FloatArray:
    """Averages (n, m) less the optimum for what they use."""
    return average - solve_optimum(problem, capacity=average.sum(axis=0)).allocation


def _misallocation(problem: Problem, averages: FloatArray) -> FloatArray:
    best = [average - _off(problem, average) for average in averages]
    return np.stack([metrics.relative_error(*pair) for pair in zip(averages, best, strict=True)])


def _on_the_clock(problem: Problem, at: Sequence[float], seed: int, **rule: Any) -> Result:
    return run_synchronous(problem, steps=int(at[-1]), seed=seed, lag=0, recording=_recording(at), **rule)


def _continuous(problem: Problem, at: Sequence[float], seed: int, lost: float = 0.0) -> Result:
    simulation = Simulation(
        problem,
        dynamics="continuous",
        control_unit=Crossing(hold_off=0.0),
        channel=BroadcastChannel(loss=loss.Bernoulli(lost)),
        agents=Fleet,
        seed=seed,
        recording=_recording(at),
    )
    return simulation.run(at[-1])


def _biased(expected: theory.Convergence, averages: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Project the averages of runs, (r, n, m), on the predicted bias; mean and standard error, (m,)."""
    off, bias = np.stack([_off(expected.problem, average) for average in averages]), expected.bias
    part = (off * bias).sum(axis=1) / (bias**2).sum(axis=0)
    return part.mean(axis=0), part.std(axis=0, ddof=1) / np.sqrt(len(part))


def _said(values: FloatArray, digits: int = 3) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _holds(within: Any) -> str:
    return "yes" if np.all(within) else "no"


def _inside(discrete: bool, problems: int, runs: int) -> list[str]:
    """Count in how many cases the measured misallocation lies in the predicted interval."""
    hits, cases, refused = 0, 0, 0
    run: Callable[..., Result] = _on_the_clock if discrete else _continuous
    for seed in range(problems):
        n, coupled = SIZES[seed % len(SIZES)], bool(seed // len(SIZES) % 2)
        problem = random_convex(seed=seed, n_agents=n, n_resources=2, coupled=coupled)
        try:
            expected = theory.convergence(problem, "discrete" if discrete else "continuous")
        except InputError:
            refused += 1
            continue
        predicted = expected.misallocation(LENGTHS)
        for luck in range(runs):
            measured = _misallocation(problem, _averages(run(problem, LENGTHS, luck), LENGTHS))
            hits += int(((measured >= predicted.low) & (measured <= predicted.high)).sum())
            cases += measured.size
    name = "on the clock" if discrete else "continuous"
    return [name, str(problems - refused), f"{hits} of {cases}", f"{hits / max(cases, 1):.1%}"]


def _draws(runs: int) -> Iterator[list[str]]:
    """Compare standard deviation and bias for draws of the paper's costs, for claims of both."""
    ratios = []
    for draw, longest in DRAWS.items():
        problem, at = smart_cameras(seed=draw), [time for time in DECADES if time <= longest]
        expected = theory.convergence(problem)
        averages = np.stack([_averages(_on_the_clock(problem, at, luck), at) for luck in range(runs)])
        covariance = np.stack([expected.covariance(time) for time in at])
        predicted = np.einsum("qjii->qj", covariance)
        ratio = np.sqrt(averages.var(axis=0, ddof=1).sum(axis=1) / predicted)
        # The summed variances of Gaussian averages have the variance 2 tr V^2 / (runs - 1).
        error = np.sqrt(0.5 * np.einsum("qjik,qjki->qj", covariance, covariance) / (runs - 1)) / predicted
        holds = _holds(np.abs(ratio - 1.0) <= EACH + 3.0 * error)
        ratios.append(ratio)
        cells = [_said(row) for row in ratio] + [""] * (len(DECADES) - len(at))
        yield [str(draw), *cells, holds, *map(_said, _biased(expected, averages[:, -1]))]
    mean = float(np.concatenate(ratios).mean())
    yield ["mean", f"{mean:.3f}", *[""] * (len(DECADES) - 1), _holds(abs(mean - 1.0) <= IN_THE_MEAN), "", ""]


def _slope_row(name: str, gain: float, found: Slopes) -> list[str]:
    off = np.abs(found.measured - found.predicted)
    error = "" if np.isnan(found.error).any() else _said(found.error)
    parts = _said(found.predicted), _said(found.measured), error, _holds(off <= SLOPE)
    return [name, f"{gain:g}", *parts]


def _slopes(runs: int) -> Iterator[list[str]]:
    """Compare slopes for the cameras and for slow costs; without draws one run is enough."""
    cameras = smart_cameras(seed=0)
    ways = {"paper": responses.Randomised(), "event-normalised": responses.EventNormalised()}
    for gain in GAINS:
        past = averaging.Polynomial(gain)
        for way, response in ways.items():
            found = slopes(cameras, SLOPE_AT, runs, response=response, averaging=past)
            yield _slope_row(f"cameras, {way}", gain, found)
        for pair in SLOW:
            name, problem = f"elasticities {pair[0]:g} and {pair[1]:g}", slow_costs(pair)
            found = slopes(problem, SLOPE_AT, runs, response=ways["event-normalised"], averaging=past)
            yield _slope_row(f"{name}, event-normalised", gain, found)
            if gain * pair[0] <= 1.0:  # else the saw decides: 1 / k
                found = slopes(problem, SLOPE_AT, 1, response=CURE, averaging=past)
                yield _slope_row(f"{name}, derandomised", gain, found)
    many = 3 * runs
    found = slopes_over_draws(SLOPE_AT, many, response=CURE)
    yield _slope_row(f"cameras, derandomised, mean of {many} draws", 1.0, Slopes(*map(np.atleast_1d, found)))


def _losses() -> Iterator[list[str]]:
    """Compare biases of continuous agents by exact moments."""
    problem = smart_cameras(seed=0)
    for lost, runs in LOSSES.items():
        expected = theory.convergence(problem, "continuous", loss=lost, exact=True)
        at = [ONE_RUN]
        averages = [_averages(_continuous(problem, at, luck, lost), at)[0] for luck in range(runs)]
        ratio, error = _biased(expected, np.stack(averages))
        cells = _said(100.0 * expected.floor), _said(ratio), _said(error)
        yield [f"{lost:g}", f"{runs} x {ONE_RUN:,.0f}", *cells, _holds(np.abs(ratio - 1.0) <= BIAS)]


def _cured() -> Iterator[list[str]]:
    """Measure coupled problems without draws and without bias, in per cent."""
    for seed in COUPLED:
        problem = random_convex(seed=seed, n_agents=30, n_resources=3)
        run = _on_the_clock(problem, LONG, 0, response=CURE)
        rows = 100.0 * _misallocation(problem, _averages(run, LONG))
        saturated = str(int(run.account.saturated.sum()))
        yield [str(seed), *(", ".join(f"{value:.4f}" for value in row) for row in rows), saturated]


def _inside_rows(options: argparse.Namespace) -> Iterator[list[str]]:
    for discrete in (True, False):
        yield _inside(discrete, options.problems, options.runs)


_TABLES: dict[str, tuple[str, Sequence[str], Callable[[argparse.Namespace], Iterable[list[str]]]]] = {
    "inside": (
        "Random problems of 5 to 200 agents: misallocation in the 95 % interval",
        ("agents", "problems", "inside", "share"),
        _inside_rows,
    ),
    "draws": (
        "Draws of the paper's costs, measured over predicted: sd, and bias of the longest runs",
        ("draw", *(f"{steps:,.0f} steps" for steps in DECADES), "holds", "bias", "its error"),
        lambda options: _draws(options.replications),
    ),
    "slopes": (
        f"Slopes of misallocation from {SLOPE_AT[0]:,.0f} to {SLOPE_AT[-1]:,.0f} steps, on log axes",
        ("costs and response", "gain", "predicted", "measured", "its error", "holds"),
        lambda options: _slopes(options.replications),
    ),
    "losses": (
        "Continuous agents and crossings, exact moments: bias, and the mean of runs projected on it",
        ("loss", "runs", "bias, %", "measured / predicted", "its error", "holds"),
        lambda options: _losses(),
    ),
    "cured": (
        "Coupled problems, Derandomised('events'): misallocation, %",
        ("seed", *(f"{steps:,.0f} steps" for steps in LONG), "cut off"),
        lambda options: _cured(),
    ),
}


def _table(name: str, options: argparse.Namespace) -> Table:
    title, columns, rows = _TABLES[name]
    with warnings.catch_warnings():
        # A few responses in millions, on the way to the averages.
        warnings.filterwarnings("ignore", ".* responses had a probability above 1", RuntimeWarning)
        return table(title, columns, rows(options))


def main(arguments: list[str] | None = None) -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tables", nargs="*", help=f"of {', '.join(_TABLES)} (default: all)")
    parser.add_argument("--problems", type=positive, default=18, help="random ones (default: %(default)s)")
    parser.add_argument("--runs", type=positive, default=6, help="of each of them (default: %(default)s)")
    parser.add_argument(
        "--replications", type=positive, default=24, help="of draws and slopes (default: %(default)s)"
    )
    options = parser.parse_args(arguments)
    unknown = set(options.tables) - set(_TABLES)
    if unknown:
        parser.error(f"unknown tables {', '.join(sorted(unknown))}: must be of {', '.join(_TABLES)}")
    out = console()
    for name in options.tables or _TABLES:
        out.print(_table(name, options))


if __name__ == "__main__":
    main()
