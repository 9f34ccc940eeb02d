"""How objects show themselves: a few lines of text, and a small table where a notebook shows HTML.

The table sets no colours, so that it is read on light and on dark ground, and holds no script.
"""

from collections.abc import Sequence
from dataclasses import fields
from html import escape
from typing import Any, NamedTuple, TypeVar

import numpy as np

from aimd_des.utils.terminal_text import fit

_Class = TypeVar("_Class", bound=type[Any])

# Lines of text in all, and rows of a table in HTML.
_MOST_LINES, _MOST_ROWS = 5, 20
# Values that are written one by one, and signs of one cell or title.
_MOST_VALUES, _LONGEST = 4, 120


class Shown(NamedTuple):
    """What an object shows of itself."""

    title: str  # one line
    heads: Sequence[str] = ()  # of the columns; empty where rows are pairs of a name and a value
    rows: Sequence[Sequence[str]] = ()


class ShowsItself:
    """Represents an object by what its method `_shown` says."""

    __slots__ = ()

    def _shown(self) -> Shown:
        raise NotImplementedError

    def __repr__(self) -> str:
        return as_text(self._shown())

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        return as_html(self._shown())


def as_text(shown: Shown) -> str:
    """Write a title, and aligned rows below it, in at most five lines.

    Examples
    --------
    >>> print(as_text(Shown("Channel", rows=[["latency", "0.1"], ["loss", "0.25"]])))
    Channel
      latency  0.1
      loss     0.25
    """
    left = _MOST_LINES - 1 - bool(shown.heads)
    kept = shown.rows if len(shown.rows) <= left else shown.rows[: left - 1]
    cells = [[_line(cell) for cell in row] for row in ([shown.heads] if shown.heads else []) + list(kept)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(["", *(cell.ljust(width) for cell, width in zip(row, widths, strict=True))]).rstrip()
        for row in cells
    ]
    return "\n".join([_line(shown.title), *lines, *_rest(shown, kept, "  ")])


def as_html(shown: Shown) -> str:
    """Write a title and a table of the rows, everything escaped."""
    kept = shown.rows[:_MOST_ROWS]
    head = "".join(f"<th>{_escaped(cell)}</th>" for cell in shown.heads)
    rows = [
        f"<tr><th>{_escaped(first)}</th>{''.join(f'<td>{_escaped(cell)}</td>' for cell in rest)}</tr>"
        for first, *rest in kept
    ]
    below = "".join(f"<p>{line}</p>" for line in _rest(shown, kept, ""))
    table = "".join([f"<tr>{head}</tr>" if head else "", *rows])
    # Notebooks take signs between dollars for formulas, but not in elements of this class.
    return (
        f'<div class="tex2jax_ignore"><p><strong>{_escaped(shown.title)}</strong></p>'
        f"{f'<table>{table}</table>' if table else ''}{below}</div>"
    )


def _rest(shown: Shown, kept: Sequence[object], indent: str) -> list[str]:
    """Say how many rows are left out."""
    left = len(shown.rows) - len(kept)
    return [f"{indent}... and {left:,} more"] if left else []


def _line(text: str) -> str:
    """Put a text into one line of limited length that steers no terminal."""
    line = fit(" ".join(text.split()))
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 3]}..."


def _escaped(text: str) -> str:
    return escape(_line(text))


def brief(cls: _Class) -> _Class:
    """Let a dataclass show its fields in one line, arrays by their range; a class decorator."""

    def pairs(self: Any) -> list[tuple[str, str]]:
        return [(one.name, brief_value(getattr(self, one.name))) for one in fields(self) if one.repr]

    def line(self: Any) -> str:
        given = ", ".join(f"{name}={value}" for name, value in pairs(self))
        return f"{type(self).__qualname__}({given})"

    def table(self: Any) -> str:
        return as_html(Shown(type(self).__qualname__, rows=pairs(self)))

    setattr(cls, "__repr__", line)  # noqa: B010
    setattr(cls, "_repr_html_", table)  # noqa: B010
    return cls


def brief_value(value: Any) -> str:
    """Write a value for the one line of `brief`.

    Examples
    --------
    >>> brief_value(np.array([0.1, 0.2])), brief_value(np.linspace(0.0, 1.0, 60)), brief_value("fleet")
    ('[0.1, 0.2]', '<60 values, 0 to 1>', "'fleet'")
    """
    if isinstance(value, np.ndarray):
        if value.size <= _MOST_VALUES:
            return repr(value.tolist())
        if value.dtype.kind in "if":
            return f"<{value.size:,} values, {spread(value)}>"
        return f"<{value.size:,} values>"
    if isinstance(value, list | tuple) and len(value) > _MOST_VALUES:
        return f"<{len(value):,} values>"
    return repr(value)


def spread(values: Any) -> str:
    """Write the range of numbers, or the one number that all of them are.

    Examples
    --------
    >>> spread([0.5, 0.25]), spread(3.0)
    ('0.25 to 0.5', '3')
    """
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
