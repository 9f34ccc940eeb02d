"""`aimd-des validate`: whether files would run, without running them."""

from pathlib import Path

import click

from aimd_des.cli.printing import say
from aimd_des.cli.set_option import holds_a_study


@click.command("validate", short_help="Check files, and run nothing.")
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False)
)
@click.pass_context
def command(context: click.Context, files: tuple[Path, ...]) -> None:
    """Check files of scenarios and studies; nothing is run, and nothing is written.

    A line for each FILE that would run says what it is.  For the others there is a line for each
    mistake, with file, line and key, and the exit code is 2.  The problem is built, its costs are
    checked, and numbers of values are held against the number of agents.
    """
    from aimd_des.utils.errors import InputError

    wrong = 0
    for path in files:
        try:
            say(f"{path}: ok: {_described(path)}")
        except InputError as refusal:
            wrong += 1
            lines = str(refusal).splitlines()
            say("\n".join(_about(path, line) for line in lines), err=True)
    if wrong:
        context.exit(2)


def _about(path: Path, sentence: str) -> str:
    """Name the file, where the sentence does not."""
    return sentence if sentence.startswith(str(path)) else f"{path}: {sentence}"


def _described(path: Path) -> str:
    """Say what a file holds, once it has been checked."""
    if holds_a_study(path):
        return _study(path)
    from aimd_des.scenario import load_scenario
    from aimd_des.scenario.dry_run import check_to_run

    scenario = load_scenario(path)
    problem = check_to_run(scenario)
    size = f"{_count(problem.n_agents, 'agent')}, {_count(problem.n_resources, 'resource')}"
    return f"{size}, {scenario.dynamics}, until {scenario.until:g}"


def _study(path: Path) -> str:
    from aimd_des.scenario.dry_run import check_to_run
    from aimd_des.study.file import read_study
    from aimd_des.study.points import expand, run_of
    from aimd_des.utils.errors import InputError

    study = read_study(path)
    points = expand(study)
    for point in points:
        run = run_of(study, point, 0)
        try:
            check_to_run(run.scenario)
        except InputError as refusal:
            raise InputError(f"at {run}: {refusal}") from None
    most = "" if study.precision is None else f", at most {study.precision.at_most}"
    return (
        f"a study of {_count(len(points), 'point')}, {_count(study.replications, 'replication')} each{most}:"
        f" {_count(len(points) * study.replications, 'run')}"
    )


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}{'' if number == 1 else 's'}"
