"""The command `aimd-des`: everything heavy is imported inside the commands, so that help is instant."""

from pathlib import Path
from typing import Any

import click

import aimd_des

__all__ = ["main"]

_EPILOG = """\b
Examples:
  aimd-des run scenarios/paper.toml --seed 0 --out results/run
  aimd-des run my_system.toml --out results/mine --overwrite

A mistake in a file or an option ends with one sentence and exit code 2; a run
that cannot go on ends with exit code 1.
"""


class _Refusal(click.ClickException):
    """A user's mistake: the sentence, and exit code 2."""

    exit_code = 2


@click.group(epilog=_EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(aimd_des.__version__, prog_name="aimd-des")
def main() -> None:
    """Simulate asynchronous AIMD resource allocation with one-bit capacity signals.

    Many agents share a few resources.  Each raises its demand steadily; when the total passes a
    capacity, a control unit broadcasts one bit, and each agent cuts its demand with a probability
    that comes from its own private cost.  The averages settle at the optimum of the whole.
    """


@main.command(epilog="What a scenario file may say is described in docs/scenario_files.md of the project.")
@click.argument("scenario", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--seed", type=int, help="Replaces the seed of the file; decides everything random.")
@click.option(
    "--agents",
    type=click.Choice(["process", "fleet"]),
    help="Replaces the word of the file: a SimPy process each, or all in compiled code; same results.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=True),
    help="Folder for the results, new or empty.  [default: results/NAME of the file]",
)
@click.option("--overwrite", is_flag=True, help="Replace a folder that an earlier run wrote.")
@click.option("--figures/--no-figures", default=True, show_default=True, help="Draw the figures, too.")
def run(
    scenario: Path, seed: int | None, agents: str | None, out: Path | None, overwrite: bool, figures: bool
) -> None:
    """Run the system that the file SCENARIO describes, and write what came out.

    The folder receives scenario.toml (the run, every value spelled out), summary.csv (a row for
    each resource), signals.parquet, demand.parquet and allocations.parquet (tidy frames), figures
    as PNG, and run.json (digest, seed, versions).  The same scenario and seed give the same digest.
    """
    from aimd_des.errors import InputError, SimulationError
    from aimd_des.optimum import solve_optimum
    from aimd_des.output import check_folder, write_run
    from aimd_des.progress import RunProgress, show_summary
    from aimd_des.scenario import load_scenario

    folder = Path("results") / scenario.stem if out is None else out
    try:
        given: dict[str, Any] = {"seed": seed, "agents": agents}
        changes = {name: value for name, value in given.items() if value is not None}
        loaded = load_scenario(scenario, **changes)
        check_folder(folder, overwrite=overwrite)
    except InputError as refusal:
        raise _Refusal(str(refusal)) from None
    try:
        with RunProgress(loaded.until) as progress:
            result = loaded.run(progress.update)
        optimum = solve_optimum(result.problem)
        write_run(folder, loaded, result, optimum, figures=figures)
    except InputError as refusal:
        raise _Refusal(f"{scenario}: {refusal}") from None
    except SimulationError as failure:
        raise click.ClickException(str(failure)) from None
    except OSError as failure:
        raise _Refusal(f"{folder}: cannot be written ({failure.strerror})") from None
    show_summary(result.summary(optimum))
    click.echo(f"Results in {folder}")
