"""Columns of a CSV file with what was measured on a real network."""

import csv
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

_Cell = TypeVar("_Cell")

# Of spreadsheets, where a comma stands in numbers.
_OTHER_SEPARATORS = re.compile("[;\t]")

# What stands for a truth value; a number says what it is by itself.
_TRUTHS = {"true", "false"}


def read_columns(
    path: str | Path, columns: Sequence[str] | None, parse: Callable[[str], _Cell], allowed: str
) -> list[list[_Cell]]:
    """Read columns of a CSV file whose first line holds their names."""
    known, rows = _rows(validation.path("path", path))
    _refuse_values(path, known, parse)
    values = []
    if columns is None:
        columns = known
    for column in validation.instances("columns", columns, str, "the name of a column"):
        validation.known(f"{path}: column", column, known)
        if known.count(column) > 1:
            allowed = f"one of {', '.join(known)}, which stands there more than once"
            raise InputError.of(f"{path}: column", column, allowed)
        cells = [row[known.index(column)] for row in rows]
        values.append(_parsed(f"{path}: column {column!r}", cells, parse, allowed))
    return values


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    """Read the names of the columns and the rows below them, all as text."""
    try:
        # The mark that some programs put before UTF-8 is no part of the first name.
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, skipinitialspace=True, strict=True)
            rows = list(reader)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error})") from None
    # Empty lines are no rows, but in a column on its own one between others is a cell that is missing.
    lines = [number for number, row in enumerate(rows) if any(row) or len(row) > 1]
    if len(lines) < 2:
        raise InputError(f"{path}: has no rows below the names of its columns")
    names = rows[lines[0]]
    if len(names) == 1 and (found := _OTHER_SEPARATORS.search(names[0])):
        remedy = "save it with commas between columns, and points in numbers"
        raise InputError.of(f"{path}: separator of columns", found[0], "a comma", remedy)
    kept = range(lines[0], lines[-1] + 1) if len(names) == 1 else lines
    below = [rows[number] for number in kept[1:]]
    for number, row in enumerate(below, start=1):
        if len(row) > len(names):
            allowed = f"at most {len(names)} cells, as there are names of columns"
            raise InputError.of(f"{path}: length of row {number}", len(row), allowed)
    # Cells that are not there at all, at the end of a short row, are empty ones.
    return names, [row + [""] * (len(names) - len(row)) for row in below]


def _holds(parse: Callable[[str], object], cell: str) -> bool:
    """Say whether a cell is one that a column may hold."""
    try:
        parse(cell)
    except ValueError:
        return False
    return True


def _refuse_values(path: str | Path, names: list[str], parse: Callable[[str], object]) -> None:
    """Refuse a first line of values: taken for names, it would be a row that is silently missing."""

    def is_value(name: str) -> bool:
        # What is no number is a value that is missing, in every column.
        number = name.lower() in _TRUTHS or _holds(float, name)
        return name.lower() == "nan" or (number and _holds(parse, name))

    if all(map(is_value, names)):
        raise InputError.of(
            f"{path}: first line",
            ",".join(names),
            "the names of the columns, and these are values",
            "put a line with names above it, which are no values themselves",
        )


def _parsed(place: str, cells: list[str], parse: Callable[[str], _Cell], allowed: str) -> list[_Cell]:
    values = []
    for row, cell in enumerate(cells, start=1):
        try:
            values.append(parse(cell))
        except ValueError:
            raise InputError.of(f"{place}, row {row}", cell, allowed) from None
    return values
