"""The folder of a run, read back: what was run, what came out, and with which versions."""

import csv
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aimd_des import checks
from aimd_des.errors import InputError

__all__ = ["StoredRun", "load_run"]

Number = int | float


@dataclass(frozen=True)
class StoredRun:
    """A folder that `aimd-des run` wrote.

    Attributes
    ----------
    folder : Path
        Where it is.
    scenario : dict
        What was run, every value spelled out.
    digest : str
        Of the result.
    versions : dict of str to str
        Of this program, Python and the libraries.
    measures : dict of str to dict of str to number
        For each resource, each measure by its name.
    """

    folder: Path
    scenario: dict[str, Any]
    digest: str
    versions: dict[str, str]
    measures: dict[str, dict[str, Number]]


def load_run(folder: str | Path) -> StoredRun:
    """Read the folder of a run.

    Parameters
    ----------
    folder : str or Path
        As `aimd-des run` wrote it.

    Returns
    -------
    StoredRun
        Without the frames.

    Raises
    ------
    InputError
        If it is no such folder, or a file of it is damaged.
    """
    folder = checks.path("folder", folder)
    text = {name: _read(folder / name) for name in ("run.json", "scenario.toml", "summary.csv")}
    name = "run.json"
    try:
        provenance = json.loads(text[name])
        digest, versions = str(provenance["digest"]), dict(provenance["versions"])
        name = "scenario.toml"
        scenario = tomllib.loads(text[name])
        name = "summary.csv"
        head, *rows = csv.reader(text[name].splitlines(), strict=True)
        place = head.index("resource")
        measures = {
            row[place]: {key: _number(word) for key, word in zip(head, row, strict=True) if key != "resource"}
            for row in rows
        }
    except (ValueError, KeyError, TypeError, csv.Error, RecursionError) as damage:
        raise InputError(f"{folder / name}: is damaged ({damage}); run the scenario again") from None
    return StoredRun(folder, scenario, digest, versions, measures)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError.of(
            "folder",
            str(path.parent),
            "one that aimd-des run or aimd-des sweep wrote",
            f"it has no {path.name}",
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None


def _number(word: str) -> Number:
    """Read a number; pandas writes nothing for what is not a number."""
    if not word:
        return float("nan")
    try:
        return int(word)
    except ValueError:
        return float(word)
