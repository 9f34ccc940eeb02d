"""A window of runs on an executor: a run whose worker died is tried again alone."""

from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field
from functools import partial

from aimd_des.study.points import PlannedRun
from aimd_des.study.worker_task import Outcome, Task, perform
from aimd_des.study.workers import Pool
from aimd_des.utils.errors import SimulationError

_DIED = (
    "the worker process died while it ran this, and twice again when nothing else ran: it ran out of memory,"
    " was killed from outside, or crashed in compiled code"
)
_NO_WORKERS = (
    "no worker can be started; a script that carries out a study must do so below if __name__ == '__main__':,"
    " and the workers of an executor must have this package"
)
_ATTEMPTS = 2


def execute(
    pool: Pool,
    task: Task,
    due: Callable[[], PlannedRun | None],
    take: Callable[[PlannedRun, Outcome], None],
    halted: Callable[[], bool],
) -> None:
    """Carry out runs until none is due."""
    window = _Window(pool, task, due, take, halted)
    try:
        window.run()
    finally:
        window.close()


@dataclass
class _Window:
    pool: Pool
    task: Task
    due: Callable[[], PlannedRun | None]
    take: Callable[[PlannedRun, Outcome], None]
    halted: Callable[[], bool]
    pending: dict[Future[Outcome], PlannedRun] = field(default_factory=dict)
    executor: Executor | None = None

    def run(self) -> None:
        while True:
            suspects = self._fill()
            if not suspects:
                if not self.pending:
                    return
                suspects = self._collect(wait(self.pending, return_when=FIRST_COMPLETED).done)
            if suspects:
                # A worker died. Runs in flight are lost, or done; which of them killed it is not known.
                suspects += self._collect(wait(self.pending).done)
                self.close()
                for run in suspects:
                    if not self.halted():
                        self._try_alone(run)
                self.close()

    def close(self) -> None:
        """Let go of the executor; the next use starts another."""
        if self.executor is not None:
            self.pool.stop(self.executor)
            self.executor = None

    def _running(self, workers: int) -> Executor:
        if self.executor is None:
            self.executor = self.pool.start(workers)
        return self.executor

    def _fill(self) -> list[PlannedRun]:
        """Keep twice as many runs in flight as there are workers; gives the run that no worker took."""
        while len(self.pending) < 2 * self.pool.workers and not self.halted():
            run = self.due()
            if run is None:
                break
            try:
                future = self._running(self.pool.workers).submit(perform, self.task, run.job())
            except BrokenExecutor:
                return [run]
            self.pending[future] = run
        return []

    def _collect(self, done: set[Future[Outcome]]) -> list[PlannedRun]:
        """Take what has come back; gives the runs whose worker died."""
        lost = []
        for future in [future for future in self.pending if future in done]:
            run = self.pending.pop(future)
            if future.cancelled() or future.exception() is not None:
                lost.append(run)
            else:
                self.take(run, future.result())
        return lost

    def _try_alone(self, run: PlannedRun) -> None:
        """Run one with nothing beside it, so that it is known which run kills workers."""
        for _ in range(_ATTEMPTS):
            self._ask_for_a_worker()
            future = self._running(1).submit(perform, self.task, run.job())
            wait([future])
            if not future.cancelled() and future.exception() is None:
                self.take(run, future.result())
                return
            self.close()
        self.take(run, Outcome("died", _DIED))

    def _ask_for_a_worker(self) -> None:
        try:
            error = self._running(1).submit(partial(max, 0, 1)).exception()
        except (BrokenExecutor, RuntimeError) as refusal:
            error = refusal
        if error is not None:
            raise SimulationError(f"{_NO_WORKERS} ({type(error).__name__}: {error})")
