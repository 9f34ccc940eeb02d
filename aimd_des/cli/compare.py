"""`aimd-des compare`: two folders, side by side."""

from pathlib import Path

import click

from aimd_des.cli.errors import Refusal, refusing

_FOLDER = click.Path(path_type=Path, exists=True, file_okay=False)


@click.command("compare")
@click.argument("first", metavar="DIR", type=_FOLDER)
@click.argument("second", metavar="DIR", type=_FOLDER)
@click.option("--measure", "measures", multiple=True, help="Compare this measure only; may be repeated.")
def command(first: Path, second: Path, measures: tuple[str, ...]) -> None:
    """Show in what two runs differ, or two studies.

    Of runs: whether their digests are equal, the keys of the scenario and the versions that differ, and
    the measures side by side.  Of studies: the keys that differ, and at each point that both have the
    difference of the means with its 95 % confidence interval, paired where seeds are equal, else by Welch.
    """
    from aimd_des.utils.folders import is_study

    with refusing():
        if is_study(first) and is_study(second):
            from aimd_des.cli.compare_studies import compare_studies

            compare_studies(first, second, measures)
        elif is_study(first) or is_study(second):
            study = first if is_study(first) else second
            raise Refusal(f"only {study} is the folder of a study; give those of two runs, or of two studies")
        else:
            from aimd_des.cli.run_tables import compare_runs
            from aimd_des.scenario.run_folder import load_run

            compare_runs(load_run(first), load_run(second), measures)
