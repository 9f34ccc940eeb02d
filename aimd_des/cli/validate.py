"""`aimd-des validate`: whether files would run, without running them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from aimd_des.cli.errors import refusing
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import holds_a_study

if TYPE_CHECKING:
    from aimd_des.scenario import Scenario


@click.command("validate", short_help="Check files, and run nothing.")
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False)
)
@click.option(
    "--accuracy",
    type=float,
    is_flag=False,
    flag_value=0.01,
    help="Say what misallocation theory expects, and how long a run with this one, or 0.01, has to be.",
)
@click.pass_context
def command(context: click.Context, files: tuple[Path, ...], accuracy: float | None) -> None:
    """Check files of scenarios and studies; nothing is run, and nothing is written.

    A line for each FILE that would run says what it is.  For the others there is a line for each
    mistake, with file, line and key, and the exit code is 2.  The problem is built, its costs are
    checked, and numbers of values are held against the number of agents.  With --accuracy a line for each
    resource follows, at each point of a study, or the reason why theory does not cover it.
    """
    from aimd_des.utils import validation
    from aimd_des.utils.errors import InputError

    if accuracy is not None:
        with refusing():
            validation.number("--accuracy", accuracy, low=0.0, low_open=True)
    wrong = 0
    for path in files:
        try:
            described, scenarios = _described(path)
            say(f"{path}: ok: {described}")
            if accuracy is not None:
                _say_accuracy(scenarios, accuracy)
        except InputError as refusal:
            wrong += 1
            lines = str(refusal).splitlines()
            say("\n".join(_about(path, line) for line in lines), err=True)
    if wrong:
        context.exit(2)


def _about(path: Path, sentence: str) -> str:
    """Name the file, where the sentence does not."""
    return sentence if sentence.startswith(str(path)) else f"{path}: {sentence}"


def _say_accuracy(scenarios: "Sequence[tuple[str, Scenario]]", accuracy: float) -> None:
    """Say what theory expects of each scenario, or why it expects nothing."""
    from aimd_des.theory.accuracy_words import needed_words
    from aimd_des.utils.errors import InputError, SimulationError

    for name, scenario in scenarios:
        try:
            lines = needed_words(scenario.convergence(), scenario.until, accuracy)
        except (InputError, SimulationError) as refusal:
            lines = [f"no accuracy is predicted: {refusal}"]
        say("\n".join([name] * bool(name) + [f"  {line}" for line in lines]))


def _described(path: Path) -> "tuple[str, Sequence[tuple[str, Scenario]]]":
    """Say what a file holds, once it has been checked, and give its scenarios with their names."""
    if holds_a_study(path):
        return _study(path)
    from aimd_des.scenario import load_scenario
    from aimd_des.scenario.dry_run import check_to_run

    scenario = load_scenario(path)
    problem = check_to_run(scenario)
    size = f"{_count(problem.n_agents, 'agent')}, {_count(problem.n_resources, 'resource')}"
    return f"{size}, {scenario.dynamics}, until {scenario.until:g}", [("", scenario)]


def _study(path: Path) -> "tuple[str, Sequence[tuple[str, Scenario]]]":
    from aimd_des.scenario.dry_run import check_to_run
    from aimd_des.study.file import read_study
    from aimd_des.study.points import expand, run_of
    from aimd_des.utils.errors import InputError

    study = read_study(path)
    points = expand(study)
    runs = [run_of(study, point, 0) for point in points]
    for run in runs:
        try:
            check_to_run(run.scenario)
        except InputError as refusal:
            raise InputError(f"at {run}: {refusal}") from None
    most = "" if study.precision is None else f", at most {study.precision.at_most}"
    described = (
        f"a study of {_count(len(points), 'point')}, {_count(study.replications, 'replication')} each{most}:"
        f" {_count(len(points) * study.replications, 'run')}"
    )
    return described, [(str(run), run.scenario) for run in runs]


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}{'' if number == 1 else 's'}"
