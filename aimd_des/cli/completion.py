"""`aimd-des completion`: what a shell needs to complete commands, options, files and keys."""

import click
from click.shell_completion import get_completion_class

from aimd_des.cli.errors import Refusal
from aimd_des.cli.printing import say

_PROGRAM = "aimd-des"
_VARIABLE = "_AIMD_DES_COMPLETE"

_EPILOG = """\b
Add one line to the file that your shell reads when it starts:
  bash  ~/.bashrc                   eval "$(aimd-des completion bash)"
  zsh   ~/.zshrc, after compinit    eval "$(aimd-des completion zsh)"
  fish  ~/.config/fish/config.fish  aimd-des completion fish | source
"""


@click.command("completion", epilog=_EPILOG)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def command(context: click.Context, shell: str) -> None:
    """Print the script that makes a shell complete this command.

    Completed are commands, options and their words, files, and the keys that --set may change.
    """
    found = get_completion_class(shell)
    if found is None:
        raise Refusal(f"shell {shell!r}: this version of click has no completion for it")
    say(found(context.find_root().command, {}, _PROGRAM, _VARIABLE).source())
