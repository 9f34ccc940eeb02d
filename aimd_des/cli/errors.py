"""How the command ends where something is wrong: one sentence, and an exit code."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from aimd_des.utils.errors import InputError, SimulationError

#: The exit code where Ctrl-C has ended a command, as shells have it.
INTERRUPTED = 130


class Refusal(click.ClickException):
    """A user's mistake: the sentence, and exit code 2."""

    exit_code = 2


@contextmanager
def refusing(about: object = "") -> Iterator[None]:
    """End the command with a sentence where its block raises one of our exceptions."""
    try:
        yield
    except InputError as refusal:
        raise Refusal(f"{about}: {refusal}" if about else str(refusal)) from None
    except SimulationError as failure:
        raise click.ClickException(str(failure)) from None
    except MemoryError as failure:
        words = f"the memory of this machine is too small for it ({failure})".replace(" ()", "")
        raise click.ClickException(f"{about}: {words}" if about else words) from None
    except Exception as failure:
        # Here, since it imports NumPy, which a command that fails at once need not wait for.
        from aimd_des.utils.returned_values import raised_in

        said = raised_in(failure)  # a part of the user's own
        if said is None:
            raise
        raise click.ClickException(f"{about}: {said}" if about else said) from None


@contextmanager
def writing(place: Path) -> Iterator[None]:
    """End the command with a sentence where its block cannot write."""
    try:
        yield
    except OSError as failure:
        raise Refusal(f"{place}: cannot be written ({failure.strerror})") from None
