"""`run_synchronous` beside four programs that do the same: C twice, NumPy and SimPy.

Run it from the root of the checkout: ``python -m benchmarks.discrete``.
"""

import argparse
import ctypes
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aimd_des import PolynomialCosts, Problem
from benchmarks import discrete_numpy, discrete_simpy
from benchmarks.harness import (
    Contestant,
    FloatArray,
    IntArray,
    Timing,
    Unavailable,
    add_options,
    aligned,
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

TOLERANCE = 0.02
LANES = 8  # rows of the vectorised program are filled up to whole vectors of eight doubles
COLUMNS = (
    "program",
    "CPU s,\nbest",
    "CPU s,\nmedian",
    "runs",
    "over\nours",
    "over\nC loop",
    "capacity events",
    "events\noff",
    "averages\noff",
    "compiling,\nCPU s",
)
LEGEND = (
    "CPU seconds of all threads, compiling not counted; ratios are of the best.  'off' is the largest\n"
    "relative difference from the first program on any resource; above "
    f"{TOLERANCE:.0%} the work is not the same and no ratio is given."
)


class Task(NamedTuple):
    """What every program is given; `slopes` are the derivatives' coefficients, (terms, n, m)."""

    problem: Problem
    slopes: FloatArray
    steps: int


class Outcome(NamedTuple):
    """Number of capacity events, shape (m,), and averages at the end, (n, m)."""

    signals: IntArray
    average: FloatArray


Run = Callable[[int], Outcome]


def _task(cameras: int, steps: int) -> Task:
    problem = smart_cameras(seed=0, n_cameras=cameras)
    if not isinstance(problem.costs, PolynomialCosts):
        raise TypeError("the rivals know polynomial costs only")
    return Task(problem, problem.costs.slopes, steps)


def _prepare_ours(task: Task) -> Run:
    try:
        from aimd_des import run_synchronous
    except ImportError as reason:
        raise Unavailable(f"cannot be imported: {reason}") from None

    def run(seed: int) -> Outcome:
        result = run_synchronous(task.problem, steps=task.steps, seed=seed)
        return Outcome(result.signals_sent.counts(task.problem.n_resources), result.average_at_end)

    run_synchronous(task.problem, steps=1, seed=0)  # compiles, or loads what an earlier run compiled
    return run


def _prepare_numpy(task: Task) -> Run:
    return lambda seed: Outcome(*discrete_numpy.run(*task, seed))


def _prepare_simpy(task: Task) -> Run:
    return lambda seed: Outcome(*discrete_simpy.run(*task, seed))


def _rows(values: FloatArray, width: int, filler: float) -> FloatArray:
    """Turn (..., n, m) into (..., m, width), filled up behind the n agents."""
    rows = np.full((*values.shape[:-2], values.shape[-1], width), filler)
    rows[..., : values.shape[-2]] = np.swapaxes(values, -1, -2)
    return rows


def _load(source: str, *flags: str) -> ctypes.CDLL:
    library = compile_c(Path(__file__).with_name(source), *flags)
    table_in, counts = (np.ctypeslib.ndpointer(kind, flags="C") for kind in (np.float64, np.int64))
    library.run.argtypes = [*[ctypes.c_int] * 3, ctypes.c_int64, ctypes.c_uint64, *[table_in] * 7, counts]
    library.run.restype = None
    return library


def _call(library: ctypes.CDLL, task: Task, width: int, slopes: FloatArray) -> Run:
    """Lay out the problem as C reads it; agents that fill up a row ask for nothing."""
    problem, m = task.problem, task.problem.n_resources
    increase, decrease = _rows(problem.increase, width, 0.0), _rows(problem.decrease, width, 1.0)
    inputs = [aligned(a) for a in (problem.limit, problem.normalization, increase, decrease, slopes)]

    def run(seed: int) -> Outcome:
        demand, average = aligned(np.zeros((m, width))), aligned(np.zeros((m, width)))
        signals = np.zeros(m, dtype=np.int64)
        library.run(width, m, len(task.slopes), task.steps, seed, *inputs, demand, average, signals)
        return Outcome(signals, average[:, : problem.n_agents].T)

    return run


def _prepare_c(task: Task) -> Run:
    slopes = np.moveaxis(task.slopes, (0, 1, 2), (2, 1, 0))
    return _call(_load("discrete.c"), task, task.problem.n_agents, slopes)


def _prepare_simd(task: Task) -> Run:
    library = _load("discrete_simd.c", "-fopenmp-simd", f"-DTERMS={len(task.slopes)}")
    width = -(-task.problem.n_agents // LANES) * LANES
    return _call(library, task, width, _rows(task.slopes, width, 0.0))


def _contestants(task: Task) -> list[Contestant[Outcome]]:
    return [
        Contestant("run_synchronous (ours)", partial(_prepare_ours, task)),
        Contestant("C loop", partial(_prepare_c, task)),
        Contestant("C across agents", partial(_prepare_simd, task)),
        Contestant("NumPy loop", partial(_prepare_numpy, task)),
        Contestant("SimPy, ticking", partial(_prepare_simpy, task), repeats=1),
    ]


def _row(timing: Timing[Outcome], timings: list[Timing[Outcome]]) -> dict[str, Any]:
    """Hold one program against ours and the C loop (the first two), its work against the first that ran."""
    row: dict[str, Any] = {"program": timing.name, "missing": timing.missing}
    if timing.outcome is None:
        return row
    reference = next(other.outcome for other in timings if other.outcome is not None)
    signals_off = off(timing.outcome.signals, reference.signals)
    averages_off = off(timing.outcome.average.sum(axis=0), reference.average.sum(axis=0))
    same_work = max(signals_off, averages_off) <= TOLERANCE
    over_ours, over_c_loop = (
        timing.best / other.best if same_work and other.seconds else None for other in timings[:2]
    )
    return row | {
        "seconds": timing.seconds,
        "best": timing.best,
        "median": timing.median,
        "over_ours": over_ours,
        "over_c_loop": over_c_loop,
        "signals": timing.outcome.signals.tolist(),
        "signals_off": signals_off,
        "averages_off": averages_off,
        "compiling": timing.preparation,
    }


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    if row["missing"]:
        return (row["program"], *["-"] * 5, row["missing"])
    return (
        row["program"],
        f"{row['best']:.4f}",
        f"{row['median']:.4f}",
        str(len(row["seconds"])),
        ratio(row["over_ours"]),
        ratio(row["over_c_loop"]),
        " ".join(map(str, row["signals"])),
        f"{row['signals_off']:.2%}",
        f"{row['averages_off']:.2%}",
        f"{row['compiling']:.2f}",
    )


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.discrete", description="run_synchronous beside C, NumPy and SimPy"
    )
    parser.add_argument(
        "--cameras", type=positive, nargs="+", default=[60, 600], help="sizes (default: 60 600)"
    )
    parser.add_argument("--steps", type=positive, default=30_000, help="K (default: %(default)s)")
    add_options(parser, repeats=15)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure all programs at each size and print a table a size."""
    options = _options(arguments)
    out, host = console(), machine(("numpy", "numba", "simpy"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    sizes = {}
    for cameras in options.cameras:
        task = _task(cameras, options.steps)
        timings = interleaved(_contestants(task), options.repeats, options.seed)
        sizes[str(cameras)] = rows = [_row(timing, timings) for timing in timings]
        names = " ".join(task.problem.resource_names)
        out.print(table(f"{cameras} cameras, {names}, {options.steps} steps", COLUMNS, map(_cells, rows)))
    out.print(LEGEND, soft_wrap=True)
    if options.json:
        settings = {"steps": options.steps, "repeats": options.repeats, "seed": options.seed}
        write_json(options.json, {"machine": host, "settings": settings, "cameras": sizes})


if __name__ == "__main__":
    main()
