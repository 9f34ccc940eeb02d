"""What the tests of the command share: files to work on, and the command called in this process."""

import json
from inspect import signature
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from aimd_des.cli import main
from tests.conftest import INLINE, quietly

#: What a run writes besides figures.
TABLES = {
    "run.json",
    "scenario.toml",
    "summary.csv",
    "signals.parquet",
    "demand.parquet",
    "allocations.parquet",
    "capacity.parquet",
    "optimum.parquet",
    "convergence.parquet",
    "SHA256SUMS",
}


def write(text: str = INLINE, name: str = "five.toml") -> Path:
    """Write a file into the working directory."""
    path = Path(name)
    path.write_text(text, encoding="utf-8")
    return path


def runner(**options: Any) -> CliRunner:
    """Click's runner, which below 8.2 mixes both outputs unless it is told not to."""
    apart = {"mix_stderr": False} if "mix_stderr" in signature(CliRunner).parameters else {}
    return CliRunner(**apart, **options)


def invoke(*arguments: str) -> Result:
    """Call the command with these arguments."""
    return quietly(runner().invoke, main, arguments)


def run(*arguments: str) -> Result:
    """Call `run`, without figures."""
    return invoke("run", *arguments, "--no-figures")


def said(*arguments: str) -> str:
    """What the command prints; it must go well."""
    outcome = invoke(*arguments)
    assert outcome.exit_code == 0, outcome.output
    assert outcome.stderr == ""
    return outcome.stdout


def words(text: str) -> list[list[str]]:
    """The words of each line."""
    return [line.split() for line in text.splitlines()]


def everything() -> set[str]:
    """All files and folders below the working directory, hidden ones too, but for Python's byte code."""
    return {str(path) for path in Path().rglob("*") if "__pycache__" not in path.parts}


def refusal(*arguments: str) -> str:
    """The one sentence with which the command refuses; it must leave everything as it was."""
    before = everything()
    outcome = invoke(*arguments)
    assert isinstance(outcome.exception, SystemExit), outcome.exception
    assert outcome.exit_code == 2
    assert "Traceback" not in outcome.output
    assert everything() == before
    # Click says before its own errors how the command is used.
    lines = [line for line in outcome.stderr.splitlines() if line and not line.startswith(("Usage:", "Try "))]
    assert len(lines) == 1, lines
    assert lines[0].startswith("Error: ")
    return lines[0].removeprefix("Error: ")


def digest(folder: str) -> str:
    """The digest that a run wrote."""
    return str(json.loads(Path(folder, "run.json").read_text(encoding="utf-8"))["digest"])
