"""What the command line shows while a run goes on."""

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

__all__ = ["RunProgress"]

_PATIENCE = 1.0


class RunProgress:
    """A bar with simulated time and how much of it passes in a second, shown for runs of a second or more.

    The rate is counted from the first news of the run: before that, code may have been compiled.
    """

    def __init__(self, until: float) -> None:
        self._until = until
        self._began = time.monotonic()
        self._bar = Progress(
            TextColumn("simulated time {task.completed:,.0f} of {task.total:,.0f}"),
            BarColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
        )
        self._task = self._bar.add_task("run", total=until, rate="")
        self._first: tuple[float, float] | None = None
        self._shown = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._shown:
            self._bar.stop()

    def update(self, now: float, events: int) -> None:
        """Take note of how far the run is."""
        clock = time.monotonic()
        if self._first is None:
            self._first = clock, now
        began, start = self._first
        if not self._shown and clock - self._began > _PATIENCE and now < self._until:
            self._bar.start()
            self._shown = True
        if self._shown:
            rate = f"{(now - start) / (clock - began):,.4g} a second" if clock > began else ""
            self._bar.update(self._task, completed=now, rate=rate)
