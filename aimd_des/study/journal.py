"""Journals: what workers append, a line a run, until the sweep puts the rows of all runs in order.

A worker has a journal of its own, so that no other process writes between its bytes.  Each line ends with a
checksum.  What stands behind the last line is of a process that was killed, or is being written now.
"""

import json
import os
import socket
import threading
import time
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

_SUFFIX = ".jsonl"
# A line waits for the disk unless one has done so a moment ago: a power cut costs the runs of that moment.
_SECONDS = 1.0
_synced: dict[Path, float] = {}


def append(folder: Path, record: Mapping[str, Any]) -> None:
    """Write a record into the journal of this thread."""
    path = folder / f".{socket.gethostname()}-{os.getpid()}-{threading.get_ident()}{_SUFFIX}"
    text = json.dumps(record)
    # It begins on a line of its own, after any rest of an earlier writer.
    line = f"\n{text}\t{_digest(text.encode())}\n"
    with path.open("ab") as file:
        file.write(line.encode())
        file.flush()
        if time.monotonic() - _synced.get(path, -_SECONDS) >= _SECONDS:
            os.fsync(file.fileno())
            _synced[path] = time.monotonic()


def journals(folder: Path) -> list[Path]:
    """List the journals of a folder."""
    return sorted(folder.glob(f".*{_SUFFIX}"))


def read(content: bytes, source: str, remedy: str) -> tuple[list[dict[str, Any]], list[str]]:
    """Read the records of a journal, and say which lines are damaged."""
    records, damage = [], []
    for number, line in enumerate(content.split(b"\n")[:-1], start=1):
        text, _, digest = line.rpartition(b"\t")
        if not line:
            continue
        if digest == _digest(text).encode():
            records.append(json.loads(text))
        else:
            damage.append(f"{source}: line {number} does not fit its checksum: it is damaged; {remedy}")
    return records, damage


def record_of(labels: Mapping[str, Any], columns: Mapping[str, list[Any]]) -> dict[str, Any]:
    """Put together what is the same in all rows of a run, and what each of them has."""
    return {"labels": dict(labels), "columns": dict(columns)}


def values_of(record: Mapping[str, Any], name: str) -> list[Any]:
    """Give a column of a record."""
    labels, columns = record["labels"], record["columns"]
    return [labels[name]] * len(columns["resource"]) if name in labels else columns[name]


def _digest(text: bytes) -> str:
    return sha256(text).hexdigest()
