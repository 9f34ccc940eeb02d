"""The one way of the commands to print: what others have written is made fit for the terminal first."""

import io
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

import click

from aimd_des.utils.terminal_text import fit


def say(text: str = "", *, err: bool = False, end: bool = True) -> None:
    """Print a text."""
    click.echo(fit(text), err=err, nl=end)


def write_out(data: str) -> None:
    """Write data to the standard output as they are, for other programs."""
    click.echo(data, nl=False)


class _Terminal(io.StringIO):
    """Keeps what a terminal would be sent, for programs that ask what they write to."""

    def __init__(self, encoding: str) -> None:
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a property there, too
        """What the terminal can show."""
        return self._encoding

    def isatty(self) -> bool:
        """Whether it stands for a terminal."""
        return True


@contextmanager
def paged() -> Iterator[None]:
    """Show what a block prints page by page where the terminal is too low for it, and as it is elsewhere."""
    if not sys.stdout.isatty():
        yield
        return
    kept = _Terminal(sys.stdout.encoding)
    try:
        with redirect_stdout(kept):
            yield
    except BaseException:
        write_out(kept.getvalue())
        raise
    text = kept.getvalue()
    if text.count("\n") < shutil.get_terminal_size().lines:
        write_out(text)
    else:
        click.echo_via_pager(text)


def let_go_of_output() -> None:
    """Write no more to a standard output that refuses: Python would try again, and complain, when it ends."""
    try:
        place = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError):  # no file
        return
    os.dup2(os.open(os.devnull, os.O_WRONLY), place)
