"""What it costs to fork a run, to save it and to go on from the file."""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aimd_des import BroadcastChannel, Crossing, Fleet, Simulation, latency
from aimd_des.lowlevel import resume
from benchmarks.harness import (
    add_options,
    console,
    cpu_seconds,
    machine,
    positive,
    table,
    write_json,
)
from models import smart_cameras

__all__ = ["main"]

COLUMNS = (
    "cameras",
    "fork,\nms",
    "kept,\nms",
    "save,\nms",
    "resume,\nms",
    "file,\nkB",
    "a checkpoint each\n10 s costs",
)
LEGEND = (
    "Best CPU milliseconds, the system's share included, of a run with copies on their way.\n"
    "'kept': of forks that are all kept, so that none gets the memory of another."
)
WARM, UNTIL, EVERY = 100.0, 200.0, 10.0
KEPT = 10


def _best(repeats: int, action: Callable[[], object]) -> float:
    """The least CPU seconds of several."""
    found = []
    for _ in range(repeats):
        seconds, made = _timed(action)
        found.append(seconds)
        # Not before the clock has stopped: what it takes to give memory back is not part of it.
        del made
    return min(found)


def _timed(action: Callable[[], object]) -> tuple[float, object]:
    """CPU seconds, and what came of them."""
    began = cpu_seconds()
    made = action()
    return cpu_seconds() - began, made


def _measure(cameras: int, repeats: int, seed: int) -> dict[str, Any]:
    simulation = Simulation(
        smart_cameras(0, cameras),
        dynamics="continuous",
        control_unit=Crossing(1.0),
        channel=BroadcastChannel(latency.Exponential(0.5), loss=0.1),
        agents=Fleet,
        seed=seed,
    )
    run = simulation.start(UNTIL)
    run.advance(WARM)
    run.fork().advance(WARM + 5.0)  # compiles what is left to compile
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run")
        seconds = {
            "fork": _best(repeats, run.fork),
            "kept": min(seconds for seconds, _ in [_timed(run.fork) for _ in range(KEPT)]),
            "save": _best(repeats, lambda: run.save(path)),
            "resume": _best(repeats, lambda: resume(path, simulation)),
        }
        return {"cameras": cameras, **seconds, "bytes": path.stat().st_size}


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    times = (f"{1e3 * row[name]:.2f}" for name in ("fork", "kept", "save", "resume"))
    return f"{row['cameras']:,}", *times, f"{row['bytes'] / 1e3:,.0f}", f"{row['save'] / EVERY:.2%}"


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.forks", description="the paper's system as a fleet, forked and saved"
    )
    sizes = {"type": positive, "nargs": "+", "default": [60, 100_000]}
    parser.add_argument("--cameras", **sizes, help="how many (default: %(default)s)")  # type: ignore[arg-type]
    add_options(parser, repeats=100)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure all sizes and print a table."""
    options = _options(arguments)
    out, host = console(), machine(("numpy", "numba", "simpy"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    rows = [_measure(cameras, options.repeats, options.seed) for cameras in options.cameras]
    out.print(table("forks and files", COLUMNS, map(_cells, rows)))
    out.print(LEGEND, soft_wrap=True)
    if options.json:
        write_json(options.json, {"machine": host, "rows": rows})


if __name__ == "__main__":
    main()
