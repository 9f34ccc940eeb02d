"""A study carried out: what is there is kept, what is missing is run, and it may be stopped at any moment."""

import logging
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from uuid import uuid4

from aimd_des.study.executor import execute
from aimd_des.study.plan_table import digests_of, earlier_replications, plan_table, points_table
from aimd_des.study.points import PlannedRun, expand
from aimd_des.study.results import StudyResults, load_study, run_away_words
from aimd_des.study.run_tables import run_schema
from aimd_des.study.schedule import Schedule
from aimd_des.study.store import AGAIN, Store
from aimd_des.study.stored_rows import put_in_order, read_rows
from aimd_des.study.study import Study
from aimd_des.study.warm_ups import WarmUps
from aimd_des.study.worker_task import Outcome, Task, failure, present
from aimd_des.study.workers import Given, Pool, Processes
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, OverloadWarning, level_outside

_LOGGER = logging.getLogger("aimd_des")

# Of what is damaged so much is named.
_MOST_TOLD = 5
_NOW = "what it held is run again"


@dataclass
class Tally:
    """How far a sweep is.

    Attributes
    ----------
    total : int
        Runs of the study, as far as they are known.
    found : int
        Those that an earlier sweep has dealt with.
    done, failed : int
        Those that this one has.
    saturated : int
        Those of them in which response probabilities were above 1.
    """

    total: int = 0
    found: int = 0
    done: int = 0
    failed: int = 0
    saturated: int = 0


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
        sweep = _Sweep(study, store, schedule, warm_ups, watch)
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


class _Sweep:
    """Between the schedule and the workers: knows what is there, and keeps count."""

    def __init__(
        self,
        study: Study,
        store: Store,
        schedule: Schedule,
        warm_ups: WarmUps,
        watch: Callable[[Tally], None] | None,
    ) -> None:
        measure = None if study.precision is None else study.precision.measure
        self.task = Task(
            str(store.folder),
            uuid4().hex,
            study.columns(),
            tuple(study.keep),
            measure,
            warm_ups=warm_ups.shared,
        )
        self.unwritten: Outcome | None = None
        self._store, self._schedule, self._warm_ups, self._watch = store, schedule, warm_ups, watch
        self._rows, self._failed = read_rows(store, run_schema(study)), store.failed()
        self._damaged = 0
        for sentence in self._rows.damage:
            self._tell_damage(sentence)
        for name in self._rows.damaged:
            store.forget(name)
        self._tally = Tally(total=len(schedule))

    def due(self) -> PlannedRun | None:
        """Give the next run that is not there as a whole, and need not wait for another one."""
        while (run := self._schedule.next(self._warm_ups.waits)) is not None:
            done = run.key in self._rows.spans
            if (done or run.key in self._failed) and not self._is_damaged(run.key, done=done):
                self._schedule.record(run, self._values(run) if done else [])
                self._warm_ups.end(run, done=done)
            else:
                self._warm_ups.begin(run)
                return run
            self._tally.found += 1
        self._tell()
        return None

    def _is_damaged(self, key: str, *, done: bool) -> bool:
        """Tell whether a run that is there is none, and make room for it."""
        fault = self._store.fault(key, self.task.keep, done=done)
        if fault:
            self._tell_damage(fault)
            for kind in ("failed", *self.task.keep):
                self._store.forget(self._store.name(kind, key))
        return bool(fault)

    def _tell_damage(self, sentence: str) -> None:
        self._damaged += 1
        if self._damaged <= _MOST_TOLD:
            _LOGGER.warning("%s", sentence.replace(AGAIN, _NOW))
        elif self._damaged == _MOST_TOLD + 1:
            _LOGGER.warning("%s: more is damaged; it is run again", self._store.folder)

    def _values(self, run: PlannedRun) -> list[tuple[str, float]]:
        """Read what precision is wanted of."""
        if self.task.measure is None:
            return []
        rows = self._rows.of([run.key]).select(["resource", self.task.measure])
        return list(zip(*(column.to_pylist() for column in rows.columns), strict=True))

    def take(self, run: PlannedRun, outcome: Outcome) -> None:
        """Take note of what became of a run."""
        if outcome.kind == "died":
            try:
                failure(self._store, run.job(), outcome.message)
            except OSError as error:
                outcome = Outcome("unwritten", error.strerror or str(error), errno=error.errno or 0)
        if outcome.kind == "unwritten":
            self.unwritten = outcome
            return
        self._tally.done += outcome.kind == "done"
        self._tally.failed += outcome.kind != "done"
        self._tally.saturated += outcome.saturated
        self._schedule.record(run, outcome.values)
        self._warm_ups.end(run, done=outcome.kind == "done")
        self._tell()

    def _tell(self) -> None:
        self._tally.total = len(self._schedule)
        if self._watch is not None:
            self._watch(self._tally)


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
