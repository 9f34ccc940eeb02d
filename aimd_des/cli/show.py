"""`aimd-des show`: what a folder holds, in the terminal."""

from pathlib import Path

import click

from aimd_des.cli.refusals import refusing

__all__ = ["command"]


@click.command("show")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--measure", "measures", multiple=True, help="Show this measure only; may be repeated.")
def command(folder: Path, measures: tuple[str, ...]) -> None:
    """Show what was run in the folder DIR, and what came out."""
    from aimd_des.cli.folders import load_run
    from aimd_des.cli.runs import show_run

    with refusing():
        show_run(load_run(folder), measures)
