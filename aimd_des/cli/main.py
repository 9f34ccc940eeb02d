"""The command itself, which finds its subcommands by their names."""

import sys
import warnings
from difflib import get_close_matches
from importlib import import_module
from io import TextIOWrapper
from typing import Any

import click

from aimd_des._version import __version__
from aimd_des.cli.errors import INTERRUPTED
from aimd_des.cli.printing import let_go_of_output, say
from aimd_des.utils.terminal_text import fit

# In the order in which help shows them; each is `command` in the module of its name.
_COMMANDS = (
    "run",
    "watch",
    "live",
    "emulate",
    "sweep",
    "validate",
    "show",
    "report",
    "compare",
    "list",
    "schema",
    "completion",
)

_EPILOG = """\b
Examples:
  aimd-des run scenarios/paper.toml --seed 0 --out results/run
  aimd-des run my_system.toml --set channel.loss=0.2 --out results/mine
  aimd-des compare results/run results/mine
  aimd-des list latency

A mistake in a file or an option ends with one sentence and exit code 2; a run
that cannot go on ends with exit code 1, and what Ctrl-C stops with 130.
"""


def _sentence(message: Warning | str, *_: Any, **__: Any) -> str:
    """Write a warning as errors are written: where it was raised is left out."""
    return f"Warning: {fit(str(message))}\n"


class _Lazy(click.Group):
    """A group that imports the module of a subcommand when it is asked for it."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command; what a terminal cannot show is written as a number, and is no reason to stop."""
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
        earlier = warnings.formatwarning
        warnings.formatwarning = _sentence
        try:
            return super().main(*args, **kwargs)
        except OSError as failure:  # of files it is told where they are read and written
            let_go_of_output()
            say(f"Error: the output cannot be written ({failure.strerror})", err=True)
            sys.exit(1)
        finally:
            warnings.formatwarning = earlier

    def invoke(self, ctx: click.Context) -> Any:
        """Run a subcommand; any error ends it with one sentence."""
        try:
            return super().invoke(ctx)
        except click.ClickException as refusal:
            refusal.message = fit(refusal.message)  # type: ignore[misc]  # final in some versions
            raise
        except KeyboardInterrupt:
            say("Stopped.", err=True)
            raise SystemExit(INTERRUPTED) from None

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Name the subcommands in the order of their use."""
        return list(_COMMANDS)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a subcommand; one that there is not is refused with the name that is most like it."""
        if args and not args[0].startswith("-") and args[0] not in _COMMANDS:
            found = get_close_matches(args[0], _COMMANDS, n=1)
            hint = f" Did you mean {found[0]!r}?" if found else f" There are {', '.join(_COMMANDS)}."
            ctx.fail(f"No such command {args[0]!r}.{hint}")
        return super().resolve_command(ctx, args)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a subcommand."""
        if cmd_name not in _COMMANDS:
            return None
        found: click.Command = import_module(f"aimd_des.cli.{cmd_name}").command
        return found


@click.group(cls=_Lazy, epilog=_EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="aimd-des")
def main() -> None:
    """Simulate asynchronous AIMD resource allocation with one-bit capacity signals.

    Many agents share a few resources.  Each raises its demand steadily; when the total passes a
    capacity, a control unit broadcasts one bit, and each agent cuts its demand with a probability
    that comes from its own private cost.  The averages settle at the optimum of the whole.
    """
