"""How well `theory.convergence` predicts the accuracy of runs: random problems, other draws, cures."""

import argparse
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from aimd_des import (
    Crossing,
    Fleet,
    InputError,
    Problem,
    Recording,
    Result,
    Simulation,
    metrics,
    responses,
    run_synchronous,
    solve_optimum,
    theory,
)
from aimd_des.lowlevel import FloatArray
from benchmarks.harness import console, positive, table
from models import random_convex, smart_cameras

__all__ = ["main"]

SIZES = (5, 10, 20, 50, 100, 200)
LENGTHS = (1000.0, 10_000.0, 30_000.0)
DRAWS = (1, 2, 3, 4, 5)
COUPLED = (0, 1, 2, 3, 7)
LONG = (10_000.0, 100_000.0, 1_000_000.0)


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


def _on_the_clock(problem: Problem, at: Sequence[float], seed: int) -> Result:
    return run_synchronous(problem, steps=int(at[-1]), seed=seed, lag=0, recording=_recording(at))


def _continuous(problem: Problem, at: Sequence[float], seed: int) -> Result:
    simulation = Simulation(
        problem,
        dynamics="continuous",
        control_unit=Crossing(hold_off=0.0),
        agents=Fleet,
        seed=seed,
        recording=_recording(at),
    )
    return simulation.run(at[-1])


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
    """Compare standard deviation and bias for other draws of the paper's costs."""
    at = LENGTHS[1], 100_000.0
    for draw in DRAWS:
        problem = smart_cameras(seed=draw)
        expected = theory.convergence(problem)
        averages = np.stack([_averages(_on_the_clock(problem, at, luck), at) for luck in range(runs)])
        spread = averages.var(axis=0, ddof=1).sum(axis=1)
        predicted = np.stack([np.einsum("jii->j", expected.covariance(time)) for time in at])
        off, bias = np.stack([_off(problem, average) for average in averages[:, -1]]), expected.bias
        part = (off * bias).sum(axis=1) / (bias**2).sum(axis=0)
        found = [*np.sqrt(spread / predicted), part.mean(axis=0), part.std(axis=0, ddof=1) / np.sqrt(runs)]
        yield [str(draw), *(", ".join(f"{value:.3f}" for value in row) for row in found)]


def _cured() -> Iterator[list[str]]:
    """Measure coupled problems without draws and without bias, in per cent."""
    cure = responses.Derandomised("events")
    for seed in COUPLED:
        problem = random_convex(seed=seed, n_agents=30, n_resources=3)
        steps, recording = int(LONG[-1]), _recording(LONG)
        run = run_synchronous(problem, steps=steps, seed=0, lag=0, response=cure, recording=recording)
        rows = 100.0 * _misallocation(problem, _averages(run, LONG))
        saturated = str(int(run.account.saturated.sum()))
        yield [str(seed), *(", ".join(f"{value:.4f}" for value in row) for row in rows), saturated]


def main(arguments: list[str] | None = None) -> None:
    """Measure and print three tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=positive, default=18, help="random ones (default: %(default)s)")
    parser.add_argument("--runs", type=positive, default=6, help="of each (default: %(default)s)")
    options = parser.parse_args(arguments)
    out = console()
    rows = [_inside(discrete, options.problems, options.runs) for discrete in (True, False)]
    title = "Random problems of 5 to 200 agents: misallocation in the 95 % interval"
    out.print(table(title, ("agents", "problems", "inside", "share"), rows))
    columns = ("draw", "sd, 10,000 steps", "sd, 100,000 steps", "bias", "its error")
    out.print(table("Draws of the paper's costs: measured over predicted", columns, _draws(12)))
    columns = ("seed", *(f"{steps:,.0f} steps" for steps in LONG), "cut off")
    out.print(table("Coupled problems, Derandomised('events'): misallocation, %", columns, _cured()))


if __name__ == "__main__":
    main()
