"""Time of an emulation: units of the run on the monotonic clock, as finely as the system wakes a process."""

import asyncio
import selectors
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Pace:
    """When the run begins, on the monotonic clock of this process, and how long a unit of it takes."""

    start: float  # seconds
    unit: float  # seconds for a unit of time

    def now(self) -> float:
        """Return the time of the run, below 0 before it begins."""
        return (time.monotonic() - self.start) / self.unit

    def clock(self, moment: float) -> float:
        """Return what the monotonic clock shows at a time of the run."""
        return self.start + moment * self.unit

    async def reach(self, moment: float) -> None:
        """Sleep until a time of the run, or a little longer."""
        loop = asyncio.get_running_loop()
        reached = loop.create_future()
        timer = loop.call_at(self.clock(moment), reached.set_result, None)
        try:
            await reached
        finally:
            timer.cancel()


def fine_loop() -> asyncio.AbstractEventLoop:
    """Make a loop that wakes up within microseconds: the usual one counts its sleep in milliseconds."""
    return asyncio.SelectorEventLoop(selectors.SelectSelector())
