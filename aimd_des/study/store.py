"""The folder of a study: what is written where, each file whole or not at all."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

import aimd_des
from aimd_des.errors import InputError
from aimd_des.output import library_versions
from aimd_des.study.columns import FRAMES
from aimd_des.study.design import Study
from aimd_des.study.locks import exclusive

__all__ = ["Store", "parquet", "read_parquet", "write_file"]

_FOLDERS = ("runs", "failed", *FRAMES)
_FILES = ("manifest.json", "study.toml", "plan.parquet")
_MANIFEST = {"runs", "result_version", "versions", "study"}
_LOCK = ".lock"


def write_file(path: Path, content: bytes | pa.Buffer) -> None:
    """Write a file under a temporary name, and give it its own when all of it is on the disk.

    Parameters
    ----------
    path : Path
        Its name.
    content : bytes or pyarrow.Buffer
        What it holds.

    Raises
    ------
    OSError
        If it cannot be written; nothing is left then.
    """
    temporary = path.with_name(f".{path.name}.{uuid4().hex}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def parquet(table: pa.Table, *, small: bool = False) -> pa.Buffer:
    """Turn a table into the bytes of a Parquet file.

    Parameters
    ----------
    table : pyarrow.Table
        What it holds.
    small : bool
        Whether it has so few rows that compression and statistics are not worth their time.

    Returns
    -------
    pyarrow.Buffer
        The same for the same table and version of pyarrow.
    """
    sink = pa.BufferOutputStream()
    if small:
        pq.write_table(table, sink, compression="none", use_dictionary=False, write_statistics=False)
    else:
        pq.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def read_parquet(path: Path) -> pa.Table:
    """Read a Parquet file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    pyarrow.Table
        What it holds, without metadata.

    Raises
    ------
    InputError
        If it cannot be read, or is damaged.
    """
    try:
        # One small file after the other: threads would take longer to begin than to read.
        with pq.ParquetFile(path) as file:
            return file.read(use_threads=False).replace_schema_metadata(None)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read ({error}); remove it, and sweep again") from None


class Store:
    """The folder of a study.

    Parameters
    ----------
    folder : Path
        Where it is, or shall be.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def file(self, kind: str, key: str) -> Path:
        """Name a file of a run.

        Parameters
        ----------
        kind : str
            "runs", "failed" or a frame.
        key : str
            Of the run.

        Returns
        -------
        Path
            Where it is, or shall be.
        """
        return self.folder / kind / f"{key}.{'json' if kind == 'failed' else 'parquet'}"

    def keys(self, kind: str) -> set[str]:
        """List the runs that have a file.

        Parameters
        ----------
        kind : str
            "runs", "failed" or a frame.

        Returns
        -------
        set of str
            Their keys.
        """
        place = self.folder / kind
        names = os.listdir(place) if place.is_dir() else []  # noqa: PTH208 - a Path for each of thousands is slow
        return {name.partition(".")[0] for name in names if not name.startswith(".")}

    def manifest(self) -> dict[str, Any] | None:
        """Read the manifest.

        Returns
        -------
        dict or None
            None where there is none.

        Raises
        ------
        InputError
            If it cannot be read, or is damaged.
        """
        path = self.folder / "manifest.json"
        if not path.is_file():
            return None
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path}: cannot be read ({error})") from None
        if not (
            isinstance(found, dict) and isinstance(found.get("study"), dict) and found.keys() >= _MANIFEST
        ):
            raise InputError(f"{path}: is damaged: it must be a table with {', '.join(sorted(_MANIFEST))}")
        return found

    def plan(self) -> pa.Table | None:
        """Read which runs the study has.

        Returns
        -------
        pyarrow.Table or None
            A row for each, with its labels; None where there is none.

        Raises
        ------
        InputError
            If it cannot be read, or is damaged.
        """
        path = self.folder / "plan.parquet"
        return read_parquet(path) if path.is_file() else None

    @contextmanager
    def taken(self, *, overwrite: bool) -> Iterator[None]:
        """Keep the folder for this process; it is made if there is none.

        Parameters
        ----------
        overwrite : bool
            Whether an earlier study is removed.

        Yields
        ------
        None
            While the folder is ours.

        Raises
        ------
        InputError
            If it is a file, holds what this program did not write, or is in use.
        OSError
            If it cannot be written.
        """
        self.check()
        self.folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as lock:
            try:
                lock.enter_context(exclusive(self.folder / _LOCK, wait=False))
            except BlockingIOError:
                allowed, remedy = "one that no other sweep is using", "wait for it, or choose another"
                raise InputError.of("output folder", str(self.folder), allowed, remedy) from None
            if overwrite:
                self._clear()
            for place in ("", *_FOLDERS):
                for left in (self.folder / place).glob(".*.tmp"):  # by a process that was killed
                    left.unlink(missing_ok=True)
            yield

    def check(self) -> None:
        """Refuse a folder that is none, or somebody else's.

        Raises
        ------
        InputError
            If it is a file, or holds what this program did not write.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError.of(
                "output folder", str(self.folder), "a folder", "it is a file; choose another name"
            )
        if self.folder.is_dir() and self.manifest() is None:
            others = [
                path.name for path in self.folder.iterdir() if path.name != _LOCK and path.suffix != ".tmp"
            ]
            if others:
                reason = f"it has no manifest.json but {sorted(others)[0]!r}; choose another"
                raise InputError.of(
                    "output folder", str(self.folder), "new, empty or that of a study", reason
                )

    def _clear(self) -> None:
        # The manifest goes last: until then the folder is known as ours.
        for name in (*_FOLDERS, *reversed(_FILES)):
            path = self.folder / name
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def write_study(self, study: Study, plan: pa.Table) -> None:
        """Write what the study is, and which runs it has.

        Parameters
        ----------
        study : Study
            The study.
        plan : pyarrow.Table
            A row for each run.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        manifest = {
            "runs": len(plan),
            "result_version": aimd_des.RESULT_VERSION,
            "versions": library_versions(),
            "study": study.spoken(),
        }
        content = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
        write_file(self.folder / "manifest.json", content.encode())
        write_file(self.folder / "study.toml", tomli_w.dumps(study.spoken()).encode())
        write_file(self.folder / "plan.parquet", parquet(plan))
        for name in ("runs", "failed", *study.keep):
            (self.folder / name).mkdir(exist_ok=True)

    def forget_failures(self) -> None:
        """Remove what is written about runs that failed."""
        for key in self.keys("failed"):
            self.file("failed", key).unlink()
