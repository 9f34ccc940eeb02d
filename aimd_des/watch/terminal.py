"""What a terminal, or a log, shows of a run that goes on."""

import time as real
from collections import deque
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from rich.cells import cell_len
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from aimd_des.plots.style import colour, resource_label
from aimd_des.problem.problem import Problem
from aimd_des.utils.formatting import grouped, percent
from aimd_des.utils.terminal_text import fit
from aimd_des.watch.monitor import Snapshot

# How often a run is looked at, in lines and as fast as it goes.
_LINES, _LOOKS = 20, 1000
# Seconds between two pictures.
_FRAME = 0.1
# Where a bar of demand ends, in multiples of the capacity.
_WIDEST = 1.2
# Where a terminal has sixteen colours: the nearest ones of those of figures may be one and the same.
_SIXTEEN = ("blue", "red", "green", "magenta", "yellow", "cyan", "bold")
# Looks that are kept, at most one for each column of the terminal.
_KEPT = 400
_KEYS = "space: pause  s: step  n: next signal  +/-: speed  tab, digits: agent  Ctrl-C: end"
# Lines beside the table and the tall curves, and the width of the column of copies in flight.
_BESIDE, _IN_FLIGHT = 6, 10
_EIGHTHS = " ▏▎▍▌▋▊▉"
_HEIGHTS = "▁▂▃▄▅▆▇█"
_ASCII_HEIGHTS = "_.-~=*#@"
_NARROWEST, _BROADEST = 8, 40
# What is left of a line for the bar and the curve when all numbers are written.
_NUMBERS = 41


class View(Protocol):
    """Shows samples; a context within which the run goes on."""

    #: Whether samples come so often that not all of them need all measures.
    sparing: bool

    def interval(self, speed: float | None) -> float:
        """Say how much simulated time lies between the samples that it wants."""
        ...

    def __enter__(self) -> Self:
        """Begin."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End, also where the run is stopped."""

    def show(self, look: Snapshot) -> None:
        """Show a look, or take note of it."""

    def end(self, look: Snapshot) -> None:
        """Show the last look."""


class PlainView:
    """A line for each look, for files and pipes."""

    sparing = False

    def __init__(self, problem: Problem, until: float, write: Callable[[str], None]) -> None:
        self._problem, self._until, self._write = problem, until, write

    def interval(self, speed: float | None) -> float:
        """Ask for twenty samples over the run."""
        return self._until / _LINES

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None

    def show(self, look: Snapshot) -> None:
        """Write a line."""
        parts = [
            f"{resource_label(resource)} {look.demand[j]:.4g} of {look.capacity[j]:.4g},"
            f" {look.signals[j]:,d} signals, used {_percent(look.utilisation[j])},"
            f" misallocation {_percent(look.misallocation[j])}"
            for j, resource in enumerate(self._problem.resources)
        ]
        self._write(f"time {grouped(look.time)} of {grouped(self._until)}: {'; '.join(parts)}")

    def end(self, look: Snapshot) -> None:
        """Write the last line."""
        self.show(look)


class LiveView:
    """A picture that is drawn anew ten times a second."""

    sparing = True

    def __init__(
        self,
        problem: Problem,
        until: float,
        title: str = "",
        console: Console | None = None,
        clock: Callable[[], float] = real.monotonic,
        *,
        full: bool = False,
    ) -> None:
        self._problem, self._until, self._title, self._clock = problem, until, title, clock
        self._console = Console() if console is None else console
        # The whole terminal, where keys are read: what is drawn has its size at that moment.
        self._full = full
        self._live = Live(console=self._console, auto_refresh=False, screen=full)
        self._past: deque[Snapshot] = deque(maxlen=_KEPT)
        self._drawn = -np.inf

    def interval(self, speed: float | None) -> float:
        """Ask for a sample for each picture, or a thousand where the speed is unknown."""
        return self._until / _LOOKS if speed is None else speed * _FRAME

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._past:
            self._draw()
        self._live.stop()
        if self._full and self._past:
            self._console.print(self._picture())

    def show(self, look: Snapshot) -> None:
        """Take note of a look, and draw if the last picture is old enough."""
        self._past.append(look)
        if self._clock() - self._drawn >= _FRAME:
            self._draw()

    def end(self, look: Snapshot) -> None:
        """Draw the last look."""
        self._past.append(look)
        self._draw()

    def _draw(self) -> None:
        self._live.update(self._page() if self._full else self._picture(), refresh=True)
        self._drawn = self._clock()

    def _picture(self) -> Group:
        """Put together what is shown, as wide as the terminal allows."""
        look, plain = self._past[-1], self._console.options.ascii_only
        resources = [*map(fit, self._problem.resource_names)]
        names = max(cell_len(name) for name in ("resource", *resources))
        left = self._console.width - _NUMBERS - names
        flight = look.in_flight if left >= 2 * _NARROWEST + _IN_FLIGHT else None
        left -= 0 if flight is None else _IN_FLIGHT
        curve = left >= 2 * _NARROWEST
        width = int(np.clip(left // 2 if curve else left, _NARROWEST, _BROADEST))
        table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
        for title in ("resource", "demand"):
            table.add_column(title, no_wrap=True)
        table.add_column(justify="right", no_wrap=True)
        if curve:
            table.add_column("last samples", no_wrap=True)
        for title in ("signals", *(["in flight"] if flight is not None else []), "used", "misalloc."):
            table.add_column(title, justify="right", no_wrap=True)
        for j, name in enumerate(resources):
            past = [float(one.demand[j] / one.capacity[j]) for one in list(self._past)[-width:]]
            table.add_row(
                Text(name),
                _bar(past[-1], width, self._style(j), plain),
                Text(_percent(past[-1]), style="reverse" if past[-1] > 1.0 else ""),
                *([Text(sparkline(past, plain), style=self._style(j))] if curve else []),
                Text(f"{look.signals[j]:,d}"),
                *([Text(f"{flight[j]:,d}")] if flight is not None else []),
                Text(_percent(look.utilisation[j])),
                Text(_percent(look.misallocation[j])),
            )
        return Group(*self._heading(look), Text(), table)

    def _page(self) -> Group:
        """Fill the terminal: the picture, a tall curve of each resource, the chosen agent, and the keys."""
        look, m = self._past[-1], self._problem.n_resources
        width, plain = max(self._console.width, 1), self._console.options.ascii_only
        height = (self._console.height - _BESIDE - m) // m - 1
        curves: list[Text] = []
        for j, name in enumerate(self._problem.resource_names if height > 0 else ()):
            past = [float(one.demand[j] / one.capacity[j]) for one in list(self._past)[-width:]]
            lines = tall_curve(past, height, _WIDEST, plain)
            curves += [Text(fit(name)), *(Text(line, style=self._style(j)) for line in lines)]
        keys = Text(f"{'PAUSED  ' if look.paused else ''}{_KEYS}", style="reverse" if look.paused else "")
        keys.truncate(width)
        return Group(self._picture(), self._agent_line(look, width), *curves, keys)

    def _agent_line(self, look: Snapshot, width: int) -> Text:
        """Say what the chosen agent demands, and what it has on average."""
        if look.agent is None:
            return Text()
        shares = [
            f"{name} {look.agent.demand[j]:.4g} (average {look.agent.average[j]:.4g})"
            for j, name in enumerate(self._problem.resource_names)
        ]
        line = Text(fit(f"agent {self._problem.agent_names[look.agent.number]}: {', '.join(shares)}"))
        line.truncate(width)
        return line

    def _style(self, resource: int) -> str:
        """Give a resource its colour; black is not seen on a black ground."""
        if self._console.color_system in ("standard", "windows"):
            return _SIXTEEN[resource % len(_SIXTEEN)]
        return colour(resource) if colour(resource) != "#000000" else "bold"

    def _heading(self, look: Snapshot) -> list[Text | Table]:
        """Say what is run, and how far it is."""
        clock = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=self._until, completed=look.time, width=20)
        clock.add_row(Text(f"time {grouped(look.time)} of {grouped(self._until)}"), bar)
        return [*([Text(fit(self._title), style="bold")] if self._title else []), clock]


def _percent(share: float) -> str:
    return percent(share, decimals=1, missing="-")


def _bar(share: float, width: int, style: str, plain: bool) -> Text:
    """Draw total demand as a bar, with a mark at the capacity."""
    filled = min(max(share, 0.0) / _WIDEST, 1.0) * width
    whole = int(filled)
    if plain:
        cells = list(("#" * whole).ljust(width))
    else:
        rest = _EIGHTHS[int(8 * (filled - whole))] if whole < width else ""
        cells = list(("█" * whole + rest).ljust(width))
    mark = min(int(width / _WIDEST), width - 1)
    cells[mark] = "|" if plain else "┃"
    text = Text("".join(cells), style=style)
    text.stylize("bold default", mark, mark + 1)
    return text


def sparkline(values: Sequence[float], plain: bool = False) -> str:
    """Draw a curve with one sign for each value, from the least to the greatest of them."""
    signs = _ASCII_HEIGHTS if plain else _HEIGHTS
    low, span = min(values), max(values) - min(values)
    if span <= 0.0:
        return signs[len(signs) // 2] * len(values)
    return "".join(signs[min(int(8 * (value - low) / span), 7)] for value in values)


def tall_curve(values: Sequence[float], height: int, top: float, plain: bool = False) -> list[str]:
    """Draw a curve over several lines, from 0 below to `top` above, with one column for each value."""
    steps = 1 if plain else 8
    filled = [round(min(max(value, 0.0), top) / top * height * steps) for value in values]
    lines = []
    for row in reversed(range(height)):
        parts = [min(max(many - row * steps, 0), steps) for many in filled]
        lines.append("".join((" #" if plain else f"{_EIGHTHS[0]}{_HEIGHTS}")[part] for part in parts))
    return lines
