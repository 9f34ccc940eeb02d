"""`aimd-des compare`: two folders, side by side."""

from pathlib import Path

import click

from aimd_des.cli.refusals import refusing

__all__ = ["command"]

_FOLDER = click.Path(path_type=Path, exists=True, file_okay=False)


@click.command("compare")
@click.argument("first", metavar="DIR", type=_FOLDER)
@click.argument("second", metavar="DIR", type=_FOLDER)
@click.option("--measure", "measures", multiple=True, help="Compare this measure only; may be repeated.")
def command(first: Path, second: Path, measures: tuple[str, ...]) -> None:
    """Show in what two runs differ: keys of the scenario, digests and measures."""
    from aimd_des.cli.folders import load_run
    from aimd_des.cli.runs import compare_runs

    with refusing():
        compare_runs(load_run(first), load_run(second), measures)
