"""`aimd-des show`: what a folder holds, in the terminal."""

from pathlib import Path

import click

from aimd_des.cli.errors import Refusal, refusing


@click.command("show")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--measure", "measures", multiple=True, help="Show this measure only; may be repeated.")
@click.option(
    "--by",
    "axes",
    multiple=True,
    help="Of a study: tell the values of this axis apart, and take means over the others; may be repeated.",
)
def command(folder: Path, measures: tuple[str, ...], axes: tuple[str, ...]) -> None:
    """Show what was run in the folder DIR, and what came out.

    Of a run: the scenario, versions, digest, and all measures of each resource.  Of a study: the axes,
    how many runs are there, failed or missing, and at each point the mean of the main measures over the
    replications, with the half-width of its 95 % confidence interval.
    """
    from aimd_des.cli.study_tables import is_study, show_study

    with refusing():
        if is_study(folder):
            show_study(folder, measures, axes)
            return
        if axes:
            raise Refusal(f"--by: has a meaning for the folder of a study only, and {folder} is none")
        from aimd_des.cli.run_tables import show_run
        from aimd_des.scenario.run_folder import load_run

        show_run(load_run(folder), measures)
