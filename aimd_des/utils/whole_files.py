"""Files that are written whole or not at all, and what is left where a process is killed meanwhile."""

import os
import re
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

# What a process that was killed leaves: see `write_file`.
_LEFT = re.compile(r"\..+\.[0-9a-f]{32}\.tmp")


def write_file(path: Path, content: bytes, temporary: Path | None = None) -> None:
    """Write a file under a temporary name, and give it its own when all of it is on the disk."""
    # Of its own unless one is given: processes may write the same file.
    unfinished = temporary or path.parent / f".{path.name}.{uuid4().hex}.tmp"
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
    except BaseException:
        with suppress(OSError):
            unfinished.unlink()
        raise


def is_left(name: str) -> bool:
    """Tell whether a file is one that a process could not end."""
    return _LEFT.fullmatch(name) is not None


def sweep_left(folder: Path) -> None:
    """Remove what processes that were killed have left; the folder must be ours and not in use."""
    for left in folder.glob(".*.tmp"):
        if is_left(left.name):
            left.unlink(missing_ok=True)
