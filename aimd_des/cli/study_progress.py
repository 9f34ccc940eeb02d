"""What the command line shows while a study is carried out."""

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from aimd_des.study.run import Tally

__all__ = ["StudyProgress"]


class StudyProgress:
    """A bar with runs done, their rate, the time left and failures.

    Use it as a context, and hand `update` to `run_study`.
    """

    def __init__(self) -> None:
        self.tally = Tally()
        self._bar = Progress(
            TextColumn("{task.completed:,.0f} of {task.total:,.0f} runs"),
            BarColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[failures]}", style="red"),
            console=Console(stderr=True),
        )
        self._task = self._bar.add_task("runs", total=1.0, rate="", failures="", start=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar.live.is_started:
            self._bar.stop()

    def update(self, tally: Tally) -> None:
        """Take note of how far the study is."""
        self.tally = tally
        task = self._bar.tasks[0]
        made = tally.done + tally.failed
        if not task.started:
            self._bar.start()
            # What was there before says nothing about how long the rest will take.
            self._bar.update(self._task, completed=tally.found)
            self._bar.start_task(self._task)
        rate = f"{task.finished_speed or task.speed or 0.0:,.1f} runs/s" if made else ""
        failures = f"{tally.failed:,} failed" if tally.failed else ""
        self._bar.update(
            self._task, total=tally.total, completed=tally.found + made, rate=rate, failures=failures
        )
