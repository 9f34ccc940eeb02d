"""The folder of a study: what is written where, each file whole or not at all, and checked when read."""

import json
import logging
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from aimd_des._version import RESULT_VERSION
from aimd_des.results.frames import columns_now
from aimd_des.study.columns import FRAMES
from aimd_des.study.file import STUDY_FILE
from aimd_des.study.locks import LOCK, alone
from aimd_des.study.seal import read_sealed, write_sealed
from aimd_des.study.study import Study
from aimd_des.utils.errors import InputError
from aimd_des.utils.whole_files import is_left, sweep_left

_LOGGER = logging.getLogger("aimd_des")

_FOLDERS = ("runs", "failed", *FRAMES)
_FILES = ("manifest.json", STUDY_FILE, "plan.parquet", "points.parquet")
_MANIFEST = {"runs", "result_version", "study"}

#: What is to be done about a damaged file of runs.
AGAIN = "sweep again, which runs what it held again"
_ANEW = "remove it, and sweep again"


def parquet(table: pa.Table) -> pa.Buffer:
    """Turn a table into the bytes of a Parquet file."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return sink.getvalue()


class Store:
    """The folder of a study."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._told = False

    @staticmethod
    def name(kind: str, key: str) -> str:
        """Name a file of a run."""
        return f"{kind}/{key}.{'json' if kind == 'failed' else 'parquet'}"

    def write(self, name: str, content: bytes | pa.Buffer) -> None:
        """Write a file with its checksum, unless it is there already."""
        write_sealed(self.folder, name, content)

    def _content(self, name: str, remedy: str) -> tuple[bytes, bool]:
        """Read a file, and whether it has a checksum; that some have none is said once."""
        content, sealed = read_sealed(self.folder, name, remedy)
        if not sealed and not self._told:
            self._told = True
            _LOGGER.warning(
                "%s: files of an earlier version have no checksums; whether they are as they were written"
                " is not known",
                self.folder,
            )
        return content, sealed

    def table(self, name: str, remedy: str) -> pa.Table:
        """Read a Parquet file; what has no checksum is looked at as a whole."""
        content, sealed = self._content(name, remedy)
        try:
            # One small file after the other: threads would take longer to begin than to read.
            with pq.ParquetFile(pa.BufferReader(content)) as file:
                table: pa.Table = file.read(use_threads=False)
            if not sealed:
                table.validate(full=True)
        except Exception as error:  # noqa: BLE001 - any error that damage causes
            raise InputError(f"{self.folder / name}: cannot be read ({error}); {remedy}") from None
        return table

    def frame(self, kind: str, key: str) -> pa.Table:
        """Read a frame of a run."""
        name = self.name(kind, key)
        table = self.table(name, AGAIN).replace_schema_metadata(None)
        # Checksums know their file, and earlier versions had none.
        if "key" not in table.column_names or not set(table["key"].unique().to_pylist()) <= {key}:
            raise InputError(f"{self.folder / name}: is another run's; {AGAIN}")
        return table.rename_columns(columns_now(table.column_names))

    def failure(self, key: str) -> dict[str, str]:
        """Read what is written about a run that failed."""
        name = self.name("failed", key)
        try:
            found = json.loads(self._content(name, AGAIN)[0])
            record = {word: str(found[word]) for word in ("key", "message", "scenario")}
        except InputError:
            raise
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise InputError(f"{self.folder / name}: cannot be read ({error}); {AGAIN}") from None
        if record["key"] != key:
            raise InputError(f"{self.folder / name}: is another run's; {AGAIN}")
        return record

    def fault(self, key: str, keep: Sequence[str], *, done: bool) -> str:
        """Say what a run whose rows are there, or that has failed, lacks to be whole."""
        try:
            if not done:
                self.failure(key)
                return ""
            for kind in keep:
                # What fits its checksum need not be taken apart: there may be thousands.
                if not self._content(self.name(kind, key), AGAIN)[1]:
                    self.frame(kind, key)
        except InputError as damage:
            return str(damage)
        return ""

    def names(self, kind: str) -> list[str]:
        """List the files of a kind; those that are being written are none yet."""
        place = self.folder / kind
        names = os.listdir(place) if place.is_dir() else []  # noqa: PTH208 - a Path for each of thousands is slow
        return [name for name in names if not name.startswith(".")]

    def failed(self) -> set[str]:
        """List the runs that have failed."""
        return {name.partition(".")[0] for name in self.names("failed")}

    def manifest(self) -> dict[str, Any] | None:
        """Read the manifest."""
        name = _FILES[0]
        if not (self.folder / name).is_file():
            return None
        content = self._content(name, _ANEW)[0]
        try:
            found = json.loads(content)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{self.folder / name}: cannot be read ({error}); {_ANEW}") from None
        if not (
            isinstance(found, dict)
            and found.keys() >= _MANIFEST
            and all(isinstance(found.get(key, {}), dict) for key in ("study", "digests", "versions"))
        ):
            needed = ", ".join(sorted(_MANIFEST))
            raise InputError(f"{self.folder / name}: is damaged: it must be a table with {needed}; {_ANEW}")
        return found

    def plan(self) -> pa.Table | None:
        """Read which runs the study has."""
        name = _FILES[2]
        if not (self.folder / name).is_file():
            return None
        return self.table(name, _ANEW).replace_schema_metadata(None)

    def scenario(self, point: str) -> str:
        """Read the scenario of a point, without its seed."""
        if point not in self._scenarios:
            raise InputError(f"{self.folder / _FILES[3]}: is that of another study; {_ANEW}")
        return self._scenarios[point]

    @cached_property
    def _scenarios(self) -> dict[str, str]:
        """The scenario of each point, read once, since a report asks for those of many."""
        return {row["point"]: str(row["scenario"]) for row in self.table(_FILES[3], _ANEW).to_pylist()}

    @contextmanager
    def taken(self, *, overwrite: bool) -> Iterator[None]:
        """Keep the folder for this process; it is made if there is none."""
        self.check(overwrite=overwrite)
        self.folder.mkdir(parents=True, exist_ok=True)
        with alone(self.folder):
            if overwrite:
                self._clear()
            self.tidy()
            yield

    def tidy(self) -> None:
        """Remove what processes that were killed have left; the folder must be ours and not in use."""
        for place in ("", *_FOLDERS):
            sweep_left(self.folder / place)

    def check(self, *, overwrite: bool = False) -> None:
        """Refuse a folder that is none, or not of a study."""
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError.of(
                "output folder", str(self.folder), "a folder", "it is a file; choose another name"
            )
        if self.folder.is_dir() and not self._is_ours(damaged=overwrite):
            others = [
                path.name for path in self.folder.iterdir() if path.name != LOCK and not is_left(path.name)
            ]
            if others:
                reason = f"it has no manifest.json but {sorted(others)[0]!r}; choose another"
                raise InputError.of(
                    "output folder", str(self.folder), "new, empty or that of a study", reason
                )

    def _is_ours(self, *, damaged: bool) -> bool:
        """Tell whether this program has written the folder: by the manifest, or else by a plan that fits."""
        manifest, _, plan, _ = ((self.folder / name).is_file() for name in _FILES)
        if manifest:
            return damaged or self.manifest() is not None
        return plan and self._content(_FILES[2], _ANEW)[1]

    def _clear(self) -> None:
        # The manifest goes last: until then the folder is known as ours.
        for name in (*_FOLDERS, *reversed(_FILES)):
            path = self.folder / name
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def write_study(
        self,
        study: Study,
        plan: pa.Table,
        points: pa.Table,
        digests: Mapping[str, Any],
        versions: Mapping[str, str],
    ) -> None:
        """Write what the study is, and which runs it has."""
        manifest = {
            "runs": len(plan),
            "result_version": RESULT_VERSION,
            **({"versions": dict(versions)} if versions else {}),
            "study": study.spoken(),
            "digests": dict(digests),
        }
        content = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
        text = tomli_w.dumps(study.spoken()).encode()
        for name, part in zip(_FILES, (content.encode(), text, parquet(plan), parquet(points)), strict=True):
            self.write(name, part)
        for name in ("runs", "failed", *study.keep):
            (self.folder / name).mkdir(exist_ok=True)

    def forget(self, name: str) -> None:
        """Remove a file, or an empty folder in its place."""
        path = self.folder / name
        if not path.is_dir() or path.is_symlink():
            path.unlink(missing_ok=True)
        elif any(path.iterdir()):
            raise InputError(f"{path}: is a folder that is not empty, in place of a file; remove it yourself")
        else:
            path.rmdir()
