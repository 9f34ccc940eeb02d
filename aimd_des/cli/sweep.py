"""`aimd-des sweep`: the runs of a study, and a folder that grows with them."""

import shlex
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import click

from aimd_des.cli.errors import INTERRUPTED, refusing
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import changes, check_command, set_option

if TYPE_CHECKING:
    from aimd_des.study.study import Study

_EPILOG = """\b
Examples:
  aimd-des sweep study.toml --out results/study --dry-run
  aimd-des sweep study.toml --out results/study --workers 4
  aimd-des sweep study.toml --out results/study --set replications=50

The same command goes on where an earlier one was stopped.  What a study file may
say, and how to read the folder, is described in docs/studies.md of the project.
"""


@click.command("sweep", short_help="Carry out a study: many runs, here or on a cluster.", epilog=_EPILOG)
@click.argument("study", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=True),
    help="Folder: new, or that of the same study.  [default: results/NAME of the file]",
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes.  [default: one for each processor]")
@set_option("replications=50 or scenario.until=1000")
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler to run on, such as 10.0.0.1:8786.")
@click.option(
    "--dask-workers",
    type=click.IntRange(min=1),
    help="Run on a Dask cluster of so many processes, started here.",
)
@click.option(
    "--dry-run", is_flag=True, help="List the points and how many of their runs are there; run nothing."
)
@click.option("--retry-failed", is_flag=True, help="Try runs again that have failed.")
@click.option("--overwrite", is_flag=True, help="Remove the study that is in the folder first.")
def command(
    study: Path,
    out: Path | None,
    workers: int | None,
    settings: tuple[str, ...],
    scheduler: str | None,
    dask_workers: int | None,
    dry_run: bool,
    retry_failed: bool,
    overwrite: bool,
) -> None:
    """Carry out the study that the file STUDY describes: many runs, on this machine or on many.

    The folder receives Parquet files with the measures of the runs, and further frames if the
    study keeps them.  Runs that are there already are not run again.  Ctrl-C waits for those that
    are under way; a second Ctrl-C does not.
    """
    from aimd_des.study.file import read_study

    if sum(given is not None for given in (workers, scheduler, dask_workers)) > 1:
        raise click.UsageError("--workers, --scheduler and --dask-workers exclude each other.")
    folder = Path("results") / study.stem if out is None else out
    with refusing():
        check_command(study, study=True)
        design = read_study(study, changes(settings))
    if dry_run:
        with refusing(study):
            _list(design, folder)
        return
    from aimd_des.study.run import run_study
    from aimd_des.utils.progress import StudyProgress

    options = [("--set", setting) for setting in settings]
    options += [("--scheduler", scheduler)] if scheduler else []
    options += [("--dask-workers", str(dask_workers))] if dask_workers else []
    again = shlex.join(["aimd-des", "sweep", str(study), "--out", str(folder), *chain(*options)])
    try:
        with (
            refusing(study),
            _executor(scheduler, dask_workers) as (executor, many),
            StudyProgress() as progress,
        ):
            run_study(
                design,
                folder,
                executor,
                workers if executor is None else many,
                overwrite=overwrite,
                retry_failed=retry_failed,
                watch=progress.update,
            )
    except KeyboardInterrupt:
        say(f"Stopped. To go on: {again}", err=True)
        raise SystemExit(INTERRUPTED) from None
    except OSError as failure:
        kept = f"what is written is kept; to go on: {again}"
        raise click.ClickException(f"{folder}: cannot be written ({failure.strerror}); {kept}") from None
    _tell(folder, again)


@contextmanager
def _executor(
    scheduler: str | None, dask_workers: int | None
) -> Iterator[tuple[Executor | None, int | None]]:
    """Give Dask's executor where one is asked for."""
    if scheduler is None and dask_workers is None:
        yield None, None
        return
    from aimd_des.study.workers import dask_executor

    with dask_executor(scheduler, dask_workers) as found:
        yield found


def _list(design: "Study", folder: Path) -> None:
    """Print the points of a study, and how many of their runs are there."""
    from aimd_des.cli.terminal_tables import print_table
    from aimd_des.study.plan_table import planned
    from aimd_des.study.store import Store

    frame = planned(design, Store(folder))
    rows = frame.astype(object).to_numpy().tolist()
    print_table(design.title or "Points", list(frame.columns), rows, labels=len(design.axes) + 1)
    runs, done, failed = (int(frame[name].sum()) for name in ("replications", "done", "failed"))
    more = "" if design.precision is None else " at least"
    say(f"{len(frame):,} points, {runs:,} runs{more}: {done:,} are there, {failed:,} have failed")


def _tell(folder: Path, again: str) -> None:
    """Say what the folder holds now."""
    from aimd_des.study.results import load_study

    results = load_study(folder)
    failed = results.failed
    there = len(results.plan) - len(failed) - len(results.missing)
    say(f"{there:,} of {len(results.plan):,} runs in {folder}")
    if len(failed):
        first = failed["message"].iloc[0]
        raise click.ClickException(
            f"{len(failed):,} runs failed, the first with: {first}; all are described in"
            f" {folder / 'failed'}; to try them again: {again} --retry-failed"
        )
