"""Locks that processes share through a file; the system gives them up with the process that holds them."""

import errno
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from aimd_des.utils.errors import InputError

#: The file of the lock of a folder.
LOCK = ".lock"

# Between two tries, in seconds: who waits, waits for much longer.
_PAUSE = 0.05

if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def private_folder() -> Path:
    """Make a folder for temporary files that nobody else can put anything into."""
    user = os.getuid() if hasattr(os, "getuid") else "all"
    folder = Path(tempfile.gettempdir()) / f"aimd_des-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    # On Windows the temporary folder is the user's own.
    open_to_others = user != "all" and (found.st_uid != user or bool(found.st_mode & 0o077))
    if not stat.S_ISDIR(found.st_mode) or open_to_others:
        raise PermissionError(errno.EPERM, "is not a folder of this user alone", str(folder))
    return folder


@contextmanager
def exclusive(path: Path, *, wait: float) -> Iterator[None]:
    """Hold a lock over a block."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        until = time.monotonic() + wait
        while not _is_ours(descriptor):
            if time.monotonic() >= until:
                raise BlockingIOError(errno.EWOULDBLOCK, "is held by another process", str(path))
            time.sleep(_PAUSE)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep a folder of results for this process; refuse one that another has."""
    with ExitStack() as lock:
        try:
            lock.enter_context(exclusive(folder / LOCK, wait=0.0))
        except BlockingIOError:
            allowed, remedy = "one that no other sweep is using", "wait for it, or choose another"
            raise InputError.of("output folder", str(folder), allowed, remedy) from None
        yield


def _is_ours(descriptor: int) -> bool:
    try:
        _lock(descriptor)
    except (BlockingIOError, PermissionError):  # the latter is what Windows says
        return False
    return True
