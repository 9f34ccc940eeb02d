"""What terminals and notebooks show while a run goes on, or a study is carried out."""

import time
from collections.abc import Callable
from importlib.util import find_spec
from types import TracebackType
from typing import Any, Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn

from aimd_des.utils.formatting import grouped

_PATIENCE = 1.0


class _Counts(Protocol):
    """How far a study is: a `Tally`."""

    total: int
    found: int
    done: int
    failed: int


def both(first: Callable[..., object], second: Callable[..., object] | None) -> Callable[..., None]:
    """Tell two functions the same news."""

    def tell(*news: Any) -> None:
        first(*news)
        if second is not None:
            second(*news)

    return tell


def _console() -> Console:
    """Write to the terminal, or into the notebook where it has the widgets that rich draws with."""
    return Console(stderr=True, force_jupyter=None if find_spec("ipywidgets") else False)


class _Progress:
    """A bar with a count, its rate and the time left: a context, at the end of which it stops."""

    def __init__(self, count: str, total: float, *more: ProgressColumn, start: bool) -> None:
        rate = TextColumn("{task.fields[rate]}")
        columns = (TextColumn(count), BarColumn(), rate, TimeRemainingColumn(), *more)
        self._bar = Progress(*columns, console=_console())
        self._task = self._bar.add_task("", total=total, start=start, rate="", failures="")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar.live.is_started:
            self._bar.stop()


class RunProgress(_Progress):
    """Simulated time and how much of it passes in a second, shown for runs of a second or more.

    The rate is counted from the first news of the run: before that, code may have been compiled.
    """

    def __init__(self, until: float) -> None:
        super().__init__("simulated time {task.completed:,.0f} of {task.total:,.0f}", until, start=True)
        self._until = until
        self._began = time.monotonic()
        self._first: tuple[float, float] | None = None

    def update(self, now: float, events: int) -> None:
        """Take note of how far the run is."""
        clock = time.monotonic()
        if self._first is None:
            self._first = clock, now
        began, start = self._first
        if clock - self._began > _PATIENCE and now < self._until:
            self._bar.start()
        if self._bar.live.is_started:
            rate = f"{grouped((now - start) / (clock - began), 4)} a second" if clock > began else ""
            self._bar.update(self._task, completed=now, rate=rate)


class StudyProgress(_Progress):
    """Runs done, their rate, the time left and failures; `update` is for `run_study`."""

    def __init__(self) -> None:
        failures = TextColumn("{task.fields[failures]}", style="red")
        super().__init__("{task.completed:,.0f} of {task.total:,.0f} runs", 1.0, failures, start=False)

    def update(self, tally: _Counts) -> None:
        """Take note of how far the study is."""
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
