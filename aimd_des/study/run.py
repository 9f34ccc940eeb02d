"""A study carried out: what is there is kept, what is missing is run, and it may be stopped at any moment."""

import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from aimd_des.study.executor import execute
from aimd_des.study.plan_table import digests_of, earlier_replications, plan_table, points_table
from aimd_des.study.points import expand
from aimd_des.study.results import StudyResults, load_study, run_away_words
from aimd_des.study.run_tables import run_schema
from aimd_des.study.runs_left import RunsLeft, Tally
from aimd_des.study.schedule import Schedule
from aimd_des.study.store import Store
from aimd_des.study.stored_rows import put_in_order, read_rows
from aimd_des.study.study import Study
from aimd_des.study.warm_ups import WarmUps
from aimd_des.study.worker_task import present
from aimd_des.study.workers import Given, Pool, Processes
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, OverloadWarning, level_outside


def run_study(
    study: Study,
    out: str | Path,
    executor: Executor | None = None,
    workers: int | None = None,
    *,
    overwrite: bool = False,
    retry_failed: bool = False,
    watch: Callable[[Tally], None] | None = None,
    progress: bool = False,
) -> StudyResults:
    """Carry out what is missing of a study.

    Parameters
    ----------
    study : Study
        What to run.
    out : str or Path
        The folder: new, or that of the same study, which may have grown by values and replications.
    executor : concurrent.futures.Executor, optional
        Where to run, such as a pool of threads or a cluster's; default: processes of this machine.
    workers : int, optional
        How many runs are carried out at a time; default: one for each processor.
    overwrite : bool
        Whether an earlier study in the folder is removed.
    retry_failed : bool
        Whether runs that have failed are tried again.
    watch : callable, optional
        Called with a `Tally` whenever something has happened.
    progress : bool
        Whether a bar with runs done, failures and the time left is shown.

    Returns
    -------
    StudyResults
        As `load_study` gives them; runs that failed are among them with their messages.

    Raises
    ------
    InputError
        If a scenario of the study is refused, or the folder is another's.
    SimulationError
        If no worker can be started.
    OSError
        If the disk is full or refuses; what is written stays, and the same call goes on from there.
    KeyboardInterrupt
        After Ctrl-C, once the runs under way are done; after a second one at once.

    Warns
    -----
    OverloadWarning
        Once, if demand has run away from a capacity in some of the runs: `StudyResults.run_away` lists them.
    """
    validation.instance("study", study, Study, "a Study, such as read_study(path)")
    if validation.flag("progress", progress):
        from aimd_des.utils.progress import StudyProgress, both  # rich is slow to import

        again = {"overwrite": overwrite, "retry_failed": retry_failed}
        with StudyProgress() as shown:
            return run_study(study, out, executor, workers, **again, watch=both(shown.update, watch))
    points = expand(study)
    many = validation.integer("workers", (os.cpu_count() or 1) if workers is None else workers, low=1)
    store = Store(Path(out).absolute())
    with store.taken(overwrite=overwrite):
        schedule = Schedule(study, points, earlier_replications(store, study, points))
        versions = (store.manifest() or {}).get("versions", {})
        digests, scenarios = digests_of(points), points_table(points)

        def write_study() -> None:
            store.write_study(study, plan_table(study, schedule.runs), scenarios, digests, versions)

        write_study()
        if retry_failed:
            for name in store.names("failed"):
                store.forget(f"failed/{name}")
        warm_ups = WarmUps(study, store.folder, len(points))
        sweep = RunsLeft(study, store, schedule, warm_ups, watch)
        try:
            with _pool(executor, many, store) as pool, _interrupted(pool) as interrupted, warm_ups.kept():
                execute(
                    pool,
                    sweep.task,
                    sweep.due,
                    sweep.take,
                    lambda: sweep.unwritten is not None or interrupted(),
                )
                stopped = interrupted()
        finally:
            write_study()
            put_in_order(store, read_rows(store, run_schema(study)), [run.key for run in schedule.runs])
        # All runs are back, so that no worker writes: what is left is of workers that were killed.
        store.tidy()
        if sweep.unwritten is not None:
            raise OSError(sweep.unwritten.errno, sweep.unwritten.message, str(out))
        if stopped:
            raise KeyboardInterrupt
    results = load_study(out)
    if len(results.run_away):
        warnings.warn(run_away_words(results), OverloadWarning, stacklevel=level_outside())
    return results


@contextmanager
def _pool(executor: Executor | None, workers: int, store: Store) -> Iterator[Pool]:
    if executor is None:
        with Processes(workers) as processes:
            yield processes
        return
    if not executor.submit(present, str(store.folder), "manifest.json").result():
        remedy = "choose one that all machines see under the same path"
        raise InputError.of("output folder", str(store.folder), "seen by the workers of the executor", remedy)
    yield Given(executor, workers)


@contextmanager
def _interrupted(pool: Pool) -> Iterator[Callable[[], bool]]:
    """Take the first Ctrl-C as a wish, the second as an order."""
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set  # signals are for others
        return

    def press(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - of a signal handler
        if pressed.is_set():
            pool.end_at_once()
            raise KeyboardInterrupt
        pressed.set()

    earlier = signal.signal(signal.SIGINT, press)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, earlier)
