"""Keys that are pressed in a terminal, read one by one and without waiting for the end of a line."""

import os
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

TAB, BACK_TAB = "\t", "\x1b[Z"
_LONGEST = 16  # bytes of one key: arrows and their like are sequences


class Keys(Protocol):
    """Where keys come from."""

    def read(self, seconds: float) -> str:
        """Wait for a key, at most so long; empty if there was none."""
        ...


class NoKeys:
    """A place without a keyboard."""

    def read(self, seconds: float) -> str:
        """Wait."""
        time.sleep(max(seconds, 0.0))
        return ""


class TerminalKeys:
    """The keyboard of a terminal that sends each key at once."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def read(self, seconds: float) -> str:
        """Wait for a key."""
        ready, _, _ = select.select([self._descriptor], [], [], max(seconds, 0.0))
        return os.read(self._descriptor, _LONGEST).decode(errors="ignore") if ready else ""


@contextmanager
def keyboard() -> Iterator[Keys]:
    """Read the keys of the terminal where there is one, and leave it as it was found."""
    try:
        import termios
        import tty
    except ImportError:  # of other systems than POSIX
        yield NoKeys()
        return
    if not sys.stdin.isatty():
        yield NoKeys()
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield TerminalKeys(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
