"""Which runs of a study are left: those that are due and not in its folder, or damaged there."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from uuid import uuid4

from aimd_des.study.points import PlannedRun
from aimd_des.study.run_tables import run_schema
from aimd_des.study.schedule import Schedule
from aimd_des.study.store import AGAIN, Store
from aimd_des.study.stored_rows import read_rows
from aimd_des.study.study import Study
from aimd_des.study.warm_ups import WarmUps
from aimd_des.study.worker_task import Outcome, Task, failure

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


class RunsLeft:
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
