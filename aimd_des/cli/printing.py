"""The one way of the commands to print: what others have written is made fit for the terminal first."""

import os
import sys

import click

from aimd_des.utils.terminal_text import fit


def say(text: str = "", *, err: bool = False, end: bool = True) -> None:
    """Print a text."""
    click.echo(fit(text), err=err, nl=end)


def write_out(data: str) -> None:
    """Write data to the standard output as they are, for other programs."""
    click.echo(data, nl=False)


def let_go_of_output() -> None:
    """Write no more to a standard output that refuses: Python would try again, and complain, when it ends."""
    try:
        place = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError):  # no file
        return
    os.dup2(os.open(os.devnull, os.O_WRONLY), place)
