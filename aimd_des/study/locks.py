"""A lock that processes share through a file; the system gives it up with the process that holds it."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aimd_des.utils.errors import InputError

#: The file of the lock of a folder.
LOCK = ".lock"

if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep a folder of results for this process; refuse one that another has."""
    descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            _lock(descriptor)
        except (BlockingIOError, PermissionError):  # the latter is what Windows says
            allowed, remedy = "one that no other sweep is using", "wait for it, or choose another"
            raise InputError.of("output folder", str(folder), allowed, remedy) from None
        yield
    finally:
        os.close(descriptor)
