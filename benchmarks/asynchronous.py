"""Continuous agents behind a slow and lossy channel: ours beside other programs that do the same.

Run it from the root of the checkout: ``python -m benchmarks.asynchronous``.
"""

import argparse
import ctypes
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aimd_des import AgentProcess, Fleet, PolynomialCosts, Problem, Recording, Simulation
from aimd_des.channel import BroadcastChannel, latency
from aimd_des.engine.control_unit import Crossing
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
    compile_c,
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
QUEUE = "C++, priority queue"

# Three to ten million deliveries each, and at least some ten signals of each resource.
HORIZONS = {60: 30_000.0, 600: 6_000.0, 6_000: 600.0, 60_000: 100.0}

# Programs that are slow are given a shorter run where there are many cameras, but one with signals in it.
SLOW_FROM, SLOW_SHARE, SHORTEST = 600, 0.1, 30.0
COLUMNS = (
    "program",
    "deliver-\nies per\nCPU s",
    "over\nSimPy",
    "over\nC++",
    "until",
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
    f"'over' is their ratio to '{STRAIGHT}' and to '{QUEUE}'.  'off' is the largest relative difference on\n"
    "any resource from the first program that ran for as long, means over the runs;\n"
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


def _horizon(cameras: int) -> float:
    return HORIZONS.get(cameras, max(100.0, 1.8e6 / cameras))


def _task(cameras: int, until: float) -> Task:
    problem = smart_cameras(seed=0, n_cameras=cameras)
    if not isinstance(problem.costs, PolynomialCosts):
        raise TypeError("the rivals know polynomial costs only")
    return Task(problem, problem.costs.slopes, until)


def _prepare_ours(task: Task, agents: Any, recording: Recording) -> Run:
    channel = BroadcastChannel(latency=latency.Exponential(LATENCY), loss=LOSS)

    def run(seed: int, until: float = task.until) -> Outcome:
        simulation = Simulation(
            task.problem,
            dynamics="continuous",
            control_unit=Crossing(hold_off=HOLD_OFF),
            channel=channel,
            agents=agents,
            seed=seed,
            recording=recording,
        )
        result = simulation.run(until)
        signals = result.signals_sent.counts(task.problem.n_resources)
        return Outcome(signals, result.average_at_end, int(result.account.delivered.sum()))

    # Compiles, or loads what an earlier run compiled; with few agents, so that it takes up no memory.
    few = _task(min(task.problem.n_agents, 60), WARM_UP)
    if few.problem.n_agents < task.problem.n_agents:
        _prepare_ours(few, agents, recording)
    else:
        run(seed=0, until=WARM_UP)
    return run


def _prepare_simpy(task: Task) -> Run:
    return lambda seed: Outcome(*asynchronous_simpy.run(*task, LATENCY, LOSS, HOLD_OFF, seed))


def _prepare_queue(task: Task) -> Run:
    problem, slopes = task.problem, np.ascontiguousarray(task.slopes.transpose(1, 2, 0))
    n, m, terms = slopes.shape
    library = compile_c(Path(__file__).with_name("asynchronous_queue.cpp"), "-std=c++17", f"-DTERMS={terms}")
    table, counts = (np.ctypeslib.ndpointer(kind, flags="C") for kind in (np.float64, np.int64))
    numbers = [*[ctypes.c_int64] * 2, *[ctypes.c_double] * 4, ctypes.c_uint64]
    library.run.argtypes = [*numbers, *[table] * 5, counts, table, ctypes.POINTER(ctypes.c_int64)]
    library.run.restype = None
    law = [problem.increase, problem.decrease, problem.normalization, problem.limit]
    tables = [np.ascontiguousarray(values) for values in (*law, slopes)]

    def run(seed: int) -> Outcome:
        signals, averages, deliveries = np.zeros(m, dtype=np.int64), np.zeros((n, m)), ctypes.c_int64()
        settings = (task.until, LATENCY, LOSS, HOLD_OFF, seed)
        library.run(n, m, *settings, *tables, signals, averages, ctypes.byref(deliveries))
        return Outcome(signals, averages, deliveries.value)

    return run


def _contestants(task: Task) -> list[tuple[Contestant[Outcome], float]]:
    """List the programs, each with the end of its run."""
    end_only, slow = Recording("end", overshoot=False), task
    if task.problem.n_agents >= SLOW_FROM:
        slow = task._replace(until=max(SLOW_SHARE * task.until, min(SHORTEST, task.until)))
    once, processes = {"repeats": 1}, partial(_prepare_ours, slow, AgentProcess)
    return [
        (Contestant("fleet (ours)", partial(_prepare_ours, task, Fleet, Recording())), task.until),
        (Contestant("fleet, end only", partial(_prepare_ours, task, Fleet, end_only)), task.until),
        (Contestant(QUEUE, partial(_prepare_queue, task)), task.until),
        (Contestant("cameras (ours)", partial(processes, Recording()), **once), slow.until),
        (Contestant("cameras, end only", partial(processes, end_only), **once), slow.until),
        (Contestant(STRAIGHT, partial(_prepare_simpy, slow), **once), slow.until),
    ]


def _rate(timing: Timing[Outcome]) -> float:
    runs = zip(timing.outcomes, timing.seconds, strict=True)
    return max(outcome.deliveries / seconds for outcome, seconds in runs)


def _mean(timing: Timing[Outcome]) -> tuple[FloatArray, FloatArray]:
    """Mean over the runs of signals and of total averages, both of shape (m,)."""
    signals = np.mean([outcome.signals for outcome in timing.outcomes], axis=0)
    return signals, np.mean([outcome.average.sum(axis=0) for outcome in timing.outcomes], axis=0)


def _row(
    timing: Timing[Outcome], until: float, timings: list[tuple[Timing[Outcome], float]], own: Alone | None
) -> dict[str, Any]:
    """Hold one program's speed against two others, its work against the first that ran for as long."""
    row: dict[str, Any] = {"program": timing.name, "missing": timing.missing, "until": until}
    if own is None or not timing.outcomes:
        return row
    signals, averages = _mean(timing)
    reference = _mean(next(other for other, end in timings if other.outcomes and end == until))
    signals_off, averages_off = off(signals, reference[0]), off(averages, reference[1])
    same_work = max(signals_off, averages_off) <= TOLERANCE
    rates = {other.name: _rate(other) for other, _ in timings if other.outcomes}
    ratios = {
        name: _rate(timing) / rates[rival] if same_work and rival in rates else None
        for name, rival in (("over_simpy", STRAIGHT), ("over_queue", QUEUE))
    }
    return row | {
        "rate": _rate(timing),
        **ratios,
        "seconds": timing.seconds,
        "best": timing.best,
        "median": timing.median,
        "deliveries": [outcome.deliveries for outcome in timing.outcomes],
        "signals": [outcome.signals.tolist() for outcome in timing.outcomes],
        "signals_mean": signals.tolist(),
        "averages_mean": averages.tolist(),
        "signals_off": signals_off,
        "averages_off": averages_off,
        "alone": own._asdict(),
    }


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    if "rate" not in row:
        return (row["program"], *["-"] * 5, row["missing"])
    return (
        row["program"],
        f"{row['rate']:,.0f}",
        ratio(row["over_simpy"]),
        ratio(row["over_queue"]),
        f"{row['until']:g}",
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


def _measure(task: Task, repeats: int, seed: int, programs: list[str] | None) -> list[dict[str, Any]]:
    taking_part = [one for one in _contestants(task) if programs is None or one[0].name in programs]
    contestants, ends = zip(*taking_part, strict=True)
    separate = [_alone(contestant, seed) for contestant in contestants]
    timings = list(zip(interleaved(contestants, repeats, seed), ends, strict=True))
    return [_row(timing, end, timings, own) for (timing, end), own in zip(timings, separate, strict=True)]


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.asynchronous",
        description="continuous agents behind a slow and lossy channel: ours beside other programs",
    )
    parser.add_argument(
        "--cameras", type=positive, nargs="+", default=list(HORIZONS), help="sizes (default: %(default)s)"
    )
    parser.add_argument("--until", type=float, help="end, in units of time (default: by size)")
    names = [contestant.name for contestant, _ in _contestants(_task(1, WARM_UP))]
    parser.add_argument(
        "--programs", nargs="+", choices=names, metavar="NAME", help="as in the tables (default: all)"
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
        task = _task(cameras, options.until or _horizon(cameras))
        sizes[str(cameras)] = rows = _measure(task, options.repeats, options.seed, options.programs)
        names = " ".join(task.problem.resource_names)
        title = (
            f"{cameras} cameras, {names}, {task.until:g} units of time; exponential latency {LATENCY:g}, "
            f"loss {LOSS:g}, hold-off {HOLD_OFF:g}"
        )
        out.print(table(title, COLUMNS, map(_cells, rows)))
    out.print(LEGEND, soft_wrap=True)
    if options.json:
        settings = {name: getattr(options, name) for name in ("until", "repeats", "seed", "programs")}
        settings |= {"latency": LATENCY, "loss": LOSS, "hold_off": HOLD_OFF}
        write_json(options.json, {"machine": host, "settings": settings, "cameras": sizes})


if __name__ == "__main__":
    main()
