"""Continuous agents behind a slow and lossy channel: ours beside other programs that do the same.

Run it from the root of the checkout: ``python -m benchmarks.asynchronous``.
"""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from aimd_des import PolynomialCosts, Problem, Recording, Simulation
from aimd_des.channel import BroadcastChannel, latency
from aimd_des.control_unit import Crossing
from benchmarks import asynchronous_simpy
from benchmarks.harness import (
    Alone,
    Contestant,
    FloatArray,
    IntArray,
    Timing,
    Unavailable,
    add_options,
    alone,
    console,
    interleaved,
    machine,
    off,
    positive,
    ratio,
    table,
    write_json,
)
from models import smart_cameras

__all__ = ["main"]

LATENCY, LOSS, HOLD_OFF = 0.5, 0.1, 1.0
WARM_UP = 50.0  # long enough for the first signals of every resource, so that all that is used is compiled
TOLERANCE = 0.02
STRAIGHT = "SimPy, by the book"
COLUMNS = (
    "program",
    "deliver-\nies per\nCPU s",
    "over\nSimPy",
    "CPU s,\nbest",
    "CPU s,\nmedian",
    "runs",
    "signals,\nmean",
    "signals\noff",
    "averages\noff",
    "alone,\nCPU s",
    "peak,\nMiB",
    "the run,\nMiB",
)
LEGEND = (
    "CPU seconds of all threads, compiling not counted.  Deliveries per second are those of the best run;\n"
    f"'over SimPy' is their ratio to '{STRAIGHT}'.  'off' is the largest relative difference from the first\n"
    "program on any resource, means over the runs; "
    f"above {TOLERANCE:.0%} the work is not the same and no ratio is given.\n"
    "'alone' and the memory are of one run in a process of its own, start and imports included;\n"
    "'the run' is how far the run itself lifts the peak."
)


class Task(NamedTuple):
    """What every program is given; `slopes` are the derivatives' coefficients, (terms, n, m)."""

    problem: Problem
    slopes: FloatArray
    until: float


class Outcome(NamedTuple):
    """Number of signals, shape (m,), averages at the end, (n, m), and copies delivered."""

    signals: IntArray
    average: FloatArray
    deliveries: int


Run = Callable[[int], Outcome]


def _task(cameras: int, until: float) -> Task:
    problem = smart_cameras(seed=0, n_cameras=cameras)
    if not isinstance(problem.costs, PolynomialCosts):
        raise TypeError("the rivals know polynomial costs only")
    return Task(problem, problem.costs.slopes, until)


def _prepare_ours(task: Task, recording: Recording) -> Run:
    channel = BroadcastChannel(latency=latency.Exponential(LATENCY), loss=LOSS)

    def run(seed: int, until: float = task.until) -> Outcome:
        simulation = Simulation(
            task.problem,
            dynamics="continuous",
            control_unit=Crossing(refractory=HOLD_OFF),
            channel=channel,
            seed=seed,
            recording=recording,
        )
        result = simulation.run(until)
        signals = result.signals_sent.counts(task.problem.n_resources)
        return Outcome(signals, result.average_at_end, int(result.account.delivered.sum()))

    run(seed=0, until=WARM_UP)
    return run


def _prepare_simpy(task: Task) -> Run:
    return lambda seed: Outcome(*asynchronous_simpy.run(*task, LATENCY, LOSS, HOLD_OFF, seed))


def _contestants(task: Task) -> list[Contestant[Outcome]]:
    end_only = Recording("end", overshoot=False)
    return [
        Contestant("camera processes (ours)", partial(_prepare_ours, task, Recording())),
        Contestant("the same, end only", partial(_prepare_ours, task, end_only)),
        Contestant(STRAIGHT, partial(_prepare_simpy, task)),
    ]


def _rate(timing: Timing[Outcome]) -> float:
    runs = zip(timing.outcomes, timing.seconds, strict=True)
    return max(outcome.deliveries / seconds for outcome, seconds in runs)


def _mean(timing: Timing[Outcome]) -> tuple[FloatArray, FloatArray]:
    """Mean over the runs of signals and of total averages, both of shape (m,)."""
    signals = np.mean([outcome.signals for outcome in timing.outcomes], axis=0)
    return signals, np.mean([outcome.average.sum(axis=0) for outcome in timing.outcomes], axis=0)


def _row(timing: Timing[Outcome], timings: list[Timing[Outcome]], separate: Alone | None) -> dict[str, Any]:
    """Hold one program's speed against the straightforward one, its work against the first that ran."""
    row: dict[str, Any] = {"program": timing.name, "missing": timing.missing}
    if separate is None or not timing.outcomes:
        return row
    signals, averages = _mean(timing)
    reference = _mean(next(other for other in timings if other.outcomes))
    signals_off, averages_off = off(signals, reference[0]), off(averages, reference[1])
    same_work = max(signals_off, averages_off) <= TOLERANCE
    straight = next((other for other in timings if other.name == STRAIGHT and other.outcomes), None)
    return row | {
        "rate": _rate(timing),
        "over_simpy": _rate(timing) / _rate(straight) if same_work and straight else None,
        "seconds": timing.seconds,
        "best": timing.best,
        "median": timing.median,
        "deliveries": [outcome.deliveries for outcome in timing.outcomes],
        "signals": [outcome.signals.tolist() for outcome in timing.outcomes],
        "signals_mean": signals.tolist(),
        "averages_mean": averages.tolist(),
        "signals_off": signals_off,
        "averages_off": averages_off,
        "alone": separate._asdict(),
    }


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    if "rate" not in row:
        return (row["program"], *["-"] * 5, row["missing"])
    return (
        row["program"],
        f"{row['rate']:,.0f}",
        ratio(row["over_simpy"]),
        f"{row['best']:.3f}",
        f"{row['median']:.3f}",
        str(len(row["seconds"])),
        " ".join(f"{signals:.0f}" for signals in row["signals_mean"]),
        f"{row['signals_off']:.2%}",
        f"{row['averages_off']:.2%}",
        f"{row['alone']['seconds']:.2f}",
        f"{row['alone']['peak']:.0f}",
        f"{row['alone']['added']:.1f}",
    )


def _alone(contestant: Contestant[Outcome], seed: int) -> Alone | None:
    try:
        return alone(contestant, seed)
    except Unavailable:  # the timing says why
        return None


def _measure(task: Task, repeats: int, seed: int) -> list[dict[str, Any]]:
    contestants = _contestants(task)
    separate = [_alone(contestant, seed) for contestant in contestants]
    timings = interleaved(contestants, repeats, seed)
    return [_row(timing, timings, own) for timing, own in zip(timings, separate, strict=True)]


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.asynchronous",
        description="continuous agents behind a slow and lossy channel: ours beside other programs",
    )
    parser.add_argument("--cameras", type=positive, nargs="+", default=[60], help="sizes (default: 60)")
    parser.add_argument(
        "--until", type=float, default=3000.0, help="end, in units of time (default: %(default)g)"
    )
    add_options(parser, repeats=3)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure all programs at each size and print a table a size."""
    options = _options(arguments)
    out, host = console(), machine(("numpy", "numba", "simpy"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    sizes = {}
    for cameras in options.cameras:
        task = _task(cameras, options.until)
        sizes[str(cameras)] = rows = _measure(task, options.repeats, options.seed)
        names = " ".join(task.problem.resource_names)
        title = (
            f"{cameras} cameras, {names}, {task.until:g} units of time; exponential latency {LATENCY:g}, "
            f"loss {LOSS:g}, hold-off {HOLD_OFF:g}"
        )
        out.print(table(title, COLUMNS, map(_cells, rows)))
    out.print(LEGEND, soft_wrap=True)
    if options.json:
        settings = {name: getattr(options, name) for name in ("until", "repeats", "seed")}
        settings |= {"latency": LATENCY, "loss": LOSS, "hold_off": HOLD_OFF}
        write_json(options.json, {"machine": host, "settings": settings, "cameras": sizes})


if __name__ == "__main__":
    main()
