"""What all benchmarks share: interleaved repeats, CPU seconds, compiled C, a table, the machine."""

import argparse
import ctypes
import gc
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from importlib import metadata
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from rich import box
from rich.console import Console
from rich.table import Table

__all__ = [
    "Alone",
    "Contestant",
    "FloatArray",
    "IntArray",
    "Timing",
    "Unavailable",
    "add_options",
    "aligned",
    "alone",
    "compile_c",
    "console",
    "cpu_seconds",
    "interleaved",
    "machine",
    "off",
    "positive",
    "ratio",
    "table",
    "write_json",
]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
T = TypeVar("T")


class Unavailable(Exception):  # noqa: N818  # a state, not a failure
    """A contestant that cannot take part on this machine; the message says why."""


@dataclass(frozen=True)
class Contestant(Generic[T]):
    """A program to time.

    Parameters
    ----------
    name : str
        Its row in the table.
    prepare : callable
        Compiles and loads what has to be, which is not counted, and returns ``run(seed)``.
    repeats : int, optional
        An upper bound of its own, for the slow ones.
    """

    name: str
    prepare: Callable[[], Callable[[int], T]]
    repeats: int | None = None


@dataclass
class Timing(Generic[T]):
    """What came of a contestant: CPU seconds of each repeat, and what each returned."""

    name: str
    preparation: float = 0.0
    seconds: list[float] = field(default_factory=list)
    outcomes: list[T] = field(default_factory=list)
    missing: str = ""

    @property
    def outcome(self) -> T | None:
        return self.outcomes[0] if self.outcomes else None

    @property
    def best(self) -> float:
        return min(self.seconds, default=float("nan"))

    @property
    def median(self) -> float:
        return statistics.median(self.seconds) if self.seconds else float("nan")


def cpu_seconds() -> float:
    """CPU seconds, user and system, of all threads of this process and of the children it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def interleaved(contestants: Iterable[Contestant[T]], repeats: int, seed: int = 0) -> list[Timing[T]]:
    """Time all contestants turn by turn, so that a slow moment of the machine falls on all of them.

    Repeat r runs with seed + r.
    """
    timings: list[Timing[T]] = []
    runs: list[tuple[Timing[T], Callable[[int], T], int]] = []
    for contestant in contestants:
        timing = Timing[T](contestant.name)
        timings.append(timing)
        start = cpu_seconds()
        try:
            run = contestant.prepare()
        except Unavailable as reason:
            timing.missing = str(reason)
            continue
        timing.preparation = cpu_seconds() - start
        runs.append((timing, run, min(repeats, contestant.repeats or repeats)))
    for repeat in range(repeats):
        for timing, run, own_repeats in runs:
            if repeat < own_repeats:
                gc.collect()
                start = cpu_seconds()
                outcome = run(seed + repeat)
                timing.seconds.append(cpu_seconds() - start)
                timing.outcomes.append(outcome)
    return timings


class Alone(NamedTuple):
    """What one run takes in a process of its own.

    `seconds` of CPU and `peak` of memory are those of the whole process: start, imports, compiling
    or loading, and the run, but not a C compiler, which is a process of its own.  `added` is how far
    the run lifts the peak above what was in use before it.  Memory is in MiB, and not a number where
    the system does not tell.
    """

    seconds: float
    peak: float
    added: float


def _memory(name: str) -> float:
    """Read a line of what Linux says about this process, in MiB."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        lines = []
    found = (line.split()[1] for line in lines if line.startswith(f"{name}:"))
    return float(next(found, "nan")) / 1024.0


def _run_once(contestant: Contestant[Any], seed: int) -> Alone:
    run = contestant.prepare()
    before = _memory("VmRSS")
    run(seed)
    peak = _memory("VmHWM")
    return Alone(time.process_time(), peak, peak - before)


def alone(contestant: Contestant[Any], seed: int = 0) -> Alone:
    """Run a contestant once in a fresh process.

    Raises
    ------
    Unavailable
        If it cannot take part.
    """
    # Spawned, not forked: a fork would begin with the memory of this process.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_run_once, contestant, seed).result()


def _compiler(suffix: str) -> str:
    return os.environ.get("CC", "cc") if suffix == ".c" else os.environ.get("CXX", "c++")


def compile_c(source: Path, *flags: str) -> ctypes.CDLL:
    """Compile C or C++ with ``-O3 -march=native`` and `flags` in a temporary folder, and load the result."""
    compiler = _compiler(source.suffix)
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / f"{source.stem}.so"
        flags = ("-O3", "-march=native", *flags, "-shared", "-fPIC")
        command = [compiler, *flags, "-o", str(library), str(source)]
        try:
            subprocess.run(command, check=True, capture_output=True, text=True)
        except FileNotFoundError:
            raise Unavailable(f"no compiler: {compiler} is not installed") from None
        except subprocess.CalledProcessError as failure:
            raise Unavailable(f"{compiler} refused {source.name}: {failure.stderr.strip()}") from None
        return ctypes.CDLL(str(library))  # stays loaded when the folder is gone


def aligned(values: FloatArray) -> FloatArray:
    """Copy to the start of a cache line: with a row across two lines a vectorised loop loses up to half."""
    memory = np.empty(values.nbytes + 64, dtype=np.uint8)
    start = -memory.ctypes.data % 64
    copy = memory[start : start + values.nbytes].view(np.float64).reshape(values.shape)
    copy[...] = values
    return copy


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _compiler_version(suffix: str) -> str:
    try:
        answer = subprocess.run([_compiler(suffix), "--version"], check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        return "none"
    return answer.stdout.partition("\n")[0]


def machine(packages: Sequence[str] = ()) -> dict[str, str]:
    """Say what was measured on: processor, cores, and versions, all read now."""
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{package: metadata.version(package) for package in packages},
        "cc": _compiler_version(".c"),
        "c++": _compiler_version(".cpp"),
    }


def console() -> Console:
    """A console wide enough for a table where the output is a file or a pipe."""
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Lay out rows of text under columns; those after the first are right-aligned."""
    layout = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for position, column in enumerate(columns):
        layout.add_column(column, justify="right" if position else "left", vertical="bottom", no_wrap=True)
    for row in rows:
        layout.add_row(*row)
    return layout


def off(values: FloatArray | IntArray, reference: FloatArray | IntArray) -> float:
    """Return the largest relative difference."""
    return float(np.max(np.abs(values / reference - 1)))


def ratio(value: float | None) -> str:
    """Write a ratio with three digits, or a dash where one of its parts is missing."""
    if value is None:
        return "-"
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"


def positive(text: str) -> int:
    """Read a positive integer from the command line."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 1")
    return value


def add_options(parser: argparse.ArgumentParser, repeats: int) -> None:
    """Add the options that every benchmark has."""
    parser.add_argument(
        "--repeats", type=positive, default=repeats, help="interleaved (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the first repeat (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all that was measured to FILE")


def write_json(path: Path, measured: dict[str, Any]) -> None:
    """Write what was measured, indented."""
    path.write_text(json.dumps(measured, indent=2) + "\n", encoding="utf-8")
