"""Locks that processes share through a file; the system gives them up with the process that holds them."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["exclusive"]

if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int, wait: bool) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int, wait: bool) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def exclusive(path: Path, *, wait: bool) -> Iterator[None]:
    """Hold a lock over a block.

    Parameters
    ----------
    path : Path
        The file, made if there is none; it stays, and is empty.
    wait : bool
        Whether to wait for who holds it.

    Yields
    ------
    None
        While it is held.

    Raises
    ------
    BlockingIOError
        If another process holds it and `wait` is false.
    OSError
        If the file cannot be made.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            _lock(descriptor, wait)
        except PermissionError as error:  # what Windows says where others say BlockingIOError
            raise BlockingIOError(error.errno, error.strerror) from None
        yield
    finally:
        os.close(descriptor)
