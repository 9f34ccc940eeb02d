"""What a person meets first: imports, commands and the first run on a machine, each in a fresh process.

Run it from the root of the checkout: ``python -m benchmarks.start``.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from benchmarks.harness import (
    Contestant,
    add_options,
    console,
    cpu_seconds,
    interleaved,
    machine,
    ratio,
    table,
    write_json,
)

__all__ = ["main"]

RIVAL = "numba's own njit of a loop"
COLUMNS = ("first use", "empty cache,\nCPU s", "over\nnjit", "filled cache,\nCPU s")
COMMANDS = ("import or command", "CPU s,\nbest", "CPU s,\nmedian")
LEGEND = (
    "CPU seconds of whole processes, imports included, the least of all repeats.  'Over njit': what an\n"
    "empty cache costs beside a filled one, over what it costs a program of one small loop (cache=True)."
)

_SETTING = """
import warnings
warnings.simplefilter("ignore")
from aimd_des import AgentProcess, BroadcastChannel, Crossing, Fleet, Sampled, Simulation, run_synchronous
from aimd_des.latency import Exponential
from models import smart_cameras
problem = smart_cameras(0)
channel = BroadcastChannel(Exponential(0.5), loss=0.1)
clock = {"dynamics": "continuous", "channel": channel, "seed": 0}
"""
_CAMERAS = "Simulation(problem, control_unit=Crossing(1.0), agents={}, **clock).run(50.0)"
#: What compiles, as programs.
FIRST = {
    RIVAL: (
        "import numba, numpy\n@numba.njit(cache=True)\ndef total(x):\n    s = 0.0\n"
        "    for i in range(x.shape[0]):\n        s += x[i]\n    return s\ntotal(numpy.ones(5))"
    ),
    "fleet, crossing": _SETTING + _CAMERAS.format("Fleet"),
    "fleet, sampled": _SETTING + _CAMERAS.format("Fleet").replace("Crossing", "Sampled"),
    "agent processes": _SETTING + _CAMERAS.format("AgentProcess"),
    "run_synchronous": _SETTING + "run_synchronous(problem, steps=50, seed=0)",
}
SCENARIO = 'model = "models.smart_cameras"\nuntil = 50\nseed = 0\n'
STUDY = 'base = "scenario.toml"\nreplications = 2\n'
_SWEEP = ["-m", "aimd_des", "sweep", "study.toml", "--out", "study", "--workers", "1"]
#: What compiles nothing: arguments of Python, and variables of the environment.
PLAIN: dict[str, tuple[list[str], dict[str, str]]] = {
    "python": (["-c", ""], {}),
    "import aimd_des": (["-c", "import aimd_des"], {}),
    "what a run is made of": (
        ["-c", "from aimd_des import BroadcastChannel, Crossing, Fleet, Simulation, latency, loss"],
        {},
    ),
    "aimd-des --help": (["-m", "aimd_des", "--help"], {}),
    "aimd-des validate": (["-m", "aimd_des", "validate", "scenario.toml"], {}),
    "validate, of a study": (["-m", "aimd_des", "validate", "study.toml"], {}),
    "show, of a study": (["-m", "aimd_des", "show", "study"], {}),
    "report, of a study": (["-m", "aimd_des", "report", "study", "--overwrite"], {}),
    "sweep, with nothing to do": (_SWEEP, {}),
    "Tab on --set": (
        ["-m", "aimd_des"],
        {
            "_AIMD_DES_COMPLETE": "bash_complete",
            "COMP_WORDS": "aimd-des run scenario.toml --set chan",
            "COMP_CWORD": "4",
        },
    ),
}


class Use(NamedTuple):
    """CPU seconds of a first use: with an empty cache, and again."""

    name: str
    empty: float
    filled: float


def _run(arguments: list[str], folder: Path, more: Mapping[str, str]) -> None:
    """Run Python to its end in a folder, with the checkout on its path."""
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": root, **more}
    subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL
    )


def _first(name: str, program: str, folder: Path) -> Use:
    """Time a program with a cache of its own, once empty and once filled."""
    (folder / "program.py").write_text(program, encoding="utf-8")  # Numba caches what stands in files alone
    seconds = []
    with tempfile.TemporaryDirectory(dir=folder) as cache:
        for _ in range(2):
            start = cpu_seconds()
            _run(["program.py"], folder, {"NUMBA_CACHE_DIR": cache})
            seconds.append(cpu_seconds() - start)
    return Use(name, *seconds)


def main(arguments: list[str] | None = None) -> None:
    """Measure and print two tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.start", description="imports, commands and the first run on a machine"
    )
    add_options(parser, repeats=3)
    options = parser.parse_args(arguments)
    out, host = console(), machine(("numpy", "numba", "pandas", "pydantic"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "scenario.toml").write_text(SCENARIO, encoding="utf-8")
        (folder / "study.toml").write_text(STUDY, encoding="utf-8")
        _run(_SWEEP, folder, {})
        turns = [
            [_first(name, program, folder) for name, program in FIRST.items()] for _ in range(options.repeats)
        ]
        commands = interleaved(
            [
                Contestant(name, lambda given=given, more=more: lambda _: _run(given, folder, more))  # type: ignore[misc]
                for name, (given, more) in PLAIN.items()
            ],
            options.repeats,
        )
    uses = [
        Use(each[0].name, min(use.empty for use in each), min(use.filled for use in each))
        for each in zip(*turns, strict=True)
    ]
    rival = uses[0].empty - uses[0].filled
    cells = [
        (use.name, f"{use.empty:.2f}", ratio((use.empty - use.filled) / rival), f"{use.filled:.2f}")
        for use in uses
    ]
    out.print(table("The first use, which compiles, and the second", COLUMNS, cells))
    out.print(LEGEND, soft_wrap=True)
    lines = [(timing.name, f"{timing.best:.2f}", f"{timing.median:.2f}") for timing in commands]
    out.print(table("What compiles nothing", COMMANDS, lines))
    if options.json:
        seconds = {timing.name: timing.seconds for timing in commands}
        first = [[use._asdict() for use in turn] for turn in turns]
        write_json(options.json, {"machine": host, "first": first, "commands": seconds})


if __name__ == "__main__":
    main()
