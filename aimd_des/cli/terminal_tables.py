"""Tables in the terminal, in several parts where a line is too short."""

import sys
from collections.abc import Iterator, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from aimd_des.utils.formatting import given, interval, measured
from aimd_des.utils.terminal_text import fit

_PADDING = 3  # on both sides of a column together
_NARROWEST = 20


def plus_minus() -> str:
    """Give the sign that the terminal can show."""
    # As a console of rich finds out, of which there would be one for every cell.
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return "±" if encoding.lower().startswith("utf") else "+/-"


def plus_or_minus(mean: float, half_width: float) -> str:
    """Write a mean with what it is known to, with signs that the terminal can show."""
    return interval(mean, half_width, plus_minus())


def print_pairs(title: str, pairs: Sequence[tuple[str, Any]]) -> None:
    """Print names and values, one pair a line."""
    console = Console()
    table = _table(show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in pairs:
        table.add_row(_styled(name), _styled(given(value)))
    console.print(_styled(title, "bold"))
    console.print(table)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], labels: int = 1) -> None:
    """Print a table, in several parts one below the other where it is wider than the terminal."""
    console = Console()
    heads = [*map(fit, columns)]
    cells = [[*map(fit, map(given, row[:labels])), *map(fit, map(measured, row[labels:]))] for row in rows]
    right = [_is_numeric([row[place] for row in rows]) for place in range(len(columns))]
    console.print(_styled(title, "bold"))
    for number, part in enumerate(_parts(_least_widths(heads, cells, right), labels, console.width)):
        if number:
            console.print()
        table = _table()
        for place in part:
            # A text may be broken, a number may not: 12 in one line and 34 in the next are another number.
            table.add_column(
                _styled(heads[place]),
                justify="right" if right[place] else "left",
                overflow="fold",
                no_wrap=right[place],
            )
        for row in cells:
            table.add_row(*(_styled(row[place]) for place in part))
        console.print(table)


def _styled(text: str, style: str = "") -> Text:
    """Make a text that steers no terminal, and of which nothing is taken for markup."""
    return Text(fit(text), style=style)


def _table(*, show_header: bool = True) -> Table:
    return Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, show_header=show_header)


def _is_numeric(values: Sequence[Any]) -> bool:
    """Tell whether a column holds numbers, or texts that are written from numbers by `plus_or_minus`."""
    return all(
        value is None or isinstance(value, int | float) or str(value)[:1] in "-0123456789" for value in values
    )


def _least_widths(columns: Sequence[str], cells: Sequence[Sequence[str]], right: Sequence[bool]) -> list[int]:
    """Say how narrow each column may become: numbers stay whole, texts go on in the next line."""
    widths = []
    for place, head in enumerate(columns):
        texts = [head, *(row[place] for row in cells)]
        widest = max(map(cell_len, texts))
        widths.append(_PADDING + (widest if right[place] else min(widest, _NARROWEST)))
    return widths


def _parts(widths: Sequence[int], labels: int, width: int) -> Iterator[list[int]]:
    """Share the columns among tables that fit; one that is too wide by itself stands alone."""
    first = list(range(labels))
    left = width - sum(widths[:labels])
    part: list[int] = []
    for place in range(labels, len(widths)):
        if part and sum(widths[other] for other in [*part, place]) > left:
            yield [*first, *part]
            part = []
        part.append(place)
    yield [*first, *part]
