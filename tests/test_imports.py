"""Nothing imports what is slow to import before it needs it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import INLINE, python
from tests.forks import PROGRAM, ForkServer

HEAVY = {"matplotlib", "networkx", "numba", "numpy", "pandas", "pyarrow", "pydantic", "rich", "simpy"}
HEAVY |= {"scipy.integrate", "scipy.optimize", "scipy.special", "scipy.stats"}

#: What is imported, and what of the heavy that takes with it: more and more.
IMPORTS: dict[str, set[str]] = {
    "import aimd_des": set(),
    "import aimd_des.study": set(),
    "from aimd_des import run_synchronous": {"numpy"},
    "from aimd_des import BroadcastChannel, Fleet, Simulation": {"numpy", "simpy"},
    "import models": {"numpy", "pydantic", "simpy"},
}

# What a file is checked with: its tables are pydantic's. Formulas and kernels are compiled by runs alone.
CHECKED = {"numpy", "pydantic", "simpy"}
FRAMES = {"pandas", "pyarrow"}
# Intervals of means are Student's.
INTERVALS = {"scipy.special"}
# What theory expects of a run stands in its folder.
EXPECTED = {"scipy.integrate", "scipy.optimize", "scipy.special"}

#: Commands in the order in which they are given, and what of the heavy each takes with it.
COMMANDS: dict[str, set[str]] = {
    "--help": set(),
    "validate one.toml": CHECKED,
    "validate study.toml": CHECKED,
    "list": CHECKED | {"rich"},
    "schema study": CHECKED,
    "run one.toml --out one --no-figures": CHECKED | FRAMES | EXPECTED | {"numba", "rich"},
    "show one": CHECKED | {"rich"},
    "sweep study.toml --out many --workers 1": CHECKED | FRAMES | {"rich"},
    "sweep study.toml --out many --dry-run": CHECKED | FRAMES | {"rich"},
    "report one": CHECKED | FRAMES,
    "report many": CHECKED | FRAMES | INTERVALS,
    "show many": CHECKED | FRAMES | INTERVALS | {"rich"},
}

_SAY = f"\nimport sys\nprint(*sorted({HEAVY!r} & sys.modules.keys()), file=sys.stderr)"
_COMMAND = f"""
try:
    {PROGRAM.replace(chr(10), chr(10) + "    ")}
except SystemExit as end:
    assert not end.code, end.code
"""


def imported(forks: ForkServer, needed: set[str], code: str, *arguments: str, **options: str) -> str:
    """What a program prints; of the heavy it must import just what it needs.

    It runs in a copy of a process, in which all is that it needs: this is imported once for many programs.
    What needs nothing runs in an interpreter of its own.
    """
    if needed:
        outcome = forks.run(code + _SAY, *arguments, **options)
    else:
        outcome = python("-c", code + _SAY, *arguments, **options)
    assert outcome.returncode == 0, outcome.stderr
    assert set(outcome.stderr.splitlines()[-1].split()) == needed, (code, arguments)
    return outcome.stdout


@pytest.fixture
def forks() -> Iterator[ForkServer]:
    """A server of these tests alone, in which nothing is imported yet."""
    server = ForkServer()
    yield server
    server.close()


def prepare(forks: ForkServer, needed: list[set[str]]) -> None:
    """Import what all programs need that are still to come."""
    common = set.intersection(*needed)
    # With a scenario comes what a file is checked with; that this is all, each copy shows.
    names = [*sorted(common), *(["aimd_des.scenario"] if common >= CHECKED else [])]
    forks.prepare("\n".join(f"import {name}" for name in names))


@pytest.mark.usefixtures("own_folder")
def test_nothing_imports_what_is_heavy_and_not_needed(forks: ForkServer) -> None:
    Path("one.toml").write_text(INLINE, encoding="utf-8")
    Path("study.toml").write_text('base = "one.toml"\nreplications = 2\n', encoding="utf-8")
    for line, needed in IMPORTS.items():
        forks.prepare("\n".join(f"import {name}" for name in sorted(needed)))
        imported(forks, needed, line)
    left = list(COMMANDS.values())
    for line, needed in COMMANDS.items():
        prepare(forks, left)
        imported(forks, needed, _COMMAND, *line.split())
        left.remove(needed)


@pytest.mark.usefixtures("own_folder")
def test_completing_a_key_imports_what_a_file_is_checked_with(forks: ForkServer) -> None:
    Path("one.toml").write_text(INLINE, encoding="utf-8")
    words = {"COMP_WORDS": "aimd-des run one.toml --set chan", "COMP_CWORD": "4"}
    prepare(forks, [CHECKED])
    said = imported(forks, CHECKED, _COMMAND, _AIMD_DES_COMPLETE="bash_complete", **words)
    assert "channel.latency=" in said
