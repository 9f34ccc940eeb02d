"""The one way of the commands to print: what others have written is made fit for the terminal first."""

import os
import sys
from typing import TYPE_CHECKING

import click

from aimd_des.utils.terminal_text import fit

if TYPE_CHECKING:
    from rich.text import Text

__all__ = ["let_go_of_output", "say", "styled"]


def say(text: str = "", *, err: bool = False, end: bool = True) -> None:
    """Print a text.

    Parameters
    ----------
    text : str
        One line or more.
    err : bool
        Whether to the standard error.
    end : bool
        Whether the last line ends with it.
    """
    click.echo(fit(text), err=err, nl=end)


def styled(text: str, style: str = "") -> "Text":
    """Make a text for a table or a heading; nothing in it is taken for markup.

    Parameters
    ----------
    text : str
        What it says.
    style : str
        How it looks, as rich has it.

    Returns
    -------
    rich.text.Text
        To be printed.
    """
    from rich.text import Text

    return Text(fit(text), style=style)


def let_go_of_output() -> None:
    """Write no more to a standard output that refuses: Python would try again, and complain, when it ends."""
    try:
        place = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError):  # no file
        return
    os.dup2(os.open(os.devnull, os.O_WRONLY), place)
