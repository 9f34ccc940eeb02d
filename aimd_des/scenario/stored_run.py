"""The folder of a run, read back: what was run, what came out, and with which versions."""

import csv
import json
import tomllib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import pandas as pd

from aimd_des.results.frames import columns_now, name_as_written
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.utils import validation
from aimd_des.utils.checksums import SUMS, read_checksums, verified
from aimd_des.utils.errors import InputError

__all__ = ["StoredRun", "load_run"]

Number = int | float

_REMEDY = "run the scenario again"


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
    checksums : mapping of str to str, or None
        Of the files, by their names; None for a folder without them.
    run_away : tuple of str
        The resources from whose capacity demand has run away.
    """

    folder: Path
    scenario: dict[str, Any]
    digest: str
    versions: dict[str, str]
    measures: dict[str, dict[str, Number]]
    checksums: Mapping[str, str] | None
    run_away: tuple[str, ...] = ()

    def has(self, frame: str) -> bool:
        """Tell whether a frame was written; earlier versions wrote fewer.

        Parameters
        ----------
        frame : str
            Its name.

        Returns
        -------
        bool
            Whether the folder has it.
        """
        return (self.folder / f"{frame}.parquet").is_file()

    def frame(self, name: str) -> pd.DataFrame:
        """Read a frame.

        Parameters
        ----------
        name : str
            Such as "signals".

        Returns
        -------
        DataFrame
            As the run wrote it.

        Raises
        ------
        InputError
            If it is not there, or not as the run wrote it.
        """
        content = _read(self.folder, f"{name}.parquet", self.checksums)
        try:
            frame = pd.read_parquet(BytesIO(content))
        except Exception as damage:  # noqa: BLE001 - without a checksum, nobody knows what a damaged file does
            path, cause = self.folder / f"{name}.parquet", " ".join(str(damage).split())
            raise InputError(f"{path}: is damaged ({cause}); {_REMEDY}") from None
        return frame.set_axis(columns_now(frame.columns), axis="columns")

    def source(self) -> str:
        """Read the scenario.

        Returns
        -------
        str
            As TOML.
        """
        return _text(self.folder, "scenario.toml", self.checksums)


def load_run(folder: str | Path) -> StoredRun:
    """Read the folder of a run.

    Parameters
    ----------
    folder : str or Path
        As `aimd-des run` wrote it.

    Returns
    -------
    StoredRun
        Its frames are read when they are asked for.

    Raises
    ------
    InputError
        If it is no such folder, or a file of it is damaged.

    Warns
    -----
    UserWarning
        If the folder has no checksums: an earlier version wrote it.
    """
    folder = validation.path("folder", folder)
    sums = read_checksums(folder, _REMEDY)
    text = {name: _text(folder, name, sums) for name in ("run.json", "scenario.toml", "summary.csv")}
    name = "run.json"
    try:
        provenance = json.loads(text[name])
        digest, versions = str(provenance["digest"]), dict(provenance["versions"])
        run_away = tuple(map(str, provenance.get("run_away", ())))
        name = "scenario.toml"
        scenario = with_new_keys(tomllib.loads(text[name]), silent=True)
        name = "summary.csv"
        head, *rows = csv.reader(StringIO(text[name], newline=""), strict=True)
        place = head.index("resource")
        measures = {
            name_as_written(row[place]): {
                key: _number(word) for key, word in zip(head, row, strict=True) if key != "resource"
            }
            for row in rows
        }
    except (ValueError, KeyError, TypeError, csv.Error, RecursionError) as damage:
        raise InputError(f"{folder / name}: is damaged ({damage}); {_REMEDY}") from None
    if sums is None:
        said = (
            f"{folder}: has no {SUMS}, so nothing tells whether its files are as they were written; {_REMEDY}"
        )
        warnings.warn(said, UserWarning, stacklevel=2)
    return StoredRun(folder, scenario, digest, versions, measures, sums, run_away)


def _read(folder: Path, name: str, sums: Mapping[str, str] | None) -> bytes:
    try:
        return verified(folder, name, sums, _REMEDY)
    except FileNotFoundError:
        raise InputError.of(
            "folder", str(folder), "one that aimd-des run or aimd-des sweep wrote", f"it has no {name}"
        ) from None


def _text(folder: Path, name: str, sums: Mapping[str, str] | None) -> str:
    content = _read(folder, name, sums)
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{folder / name}: cannot be read ({error})") from None


def _number(word: str) -> Number:
    """Read a number; pandas writes nothing for what is not a number."""
    if not word:
        return float("nan")
    try:
        return int(word)
    except ValueError:
        return float(word)
