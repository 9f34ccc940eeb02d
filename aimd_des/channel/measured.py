"""Columns of a CSV file with what was measured on a real network."""

import warnings
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

import pandas as pd

from aimd_des.errors import InputError

__all__ = ["read_columns"]

_Cell = TypeVar("_Cell")


def read_columns(
    path: str | Path, columns: Sequence[str] | None, parse: Callable[[str], _Cell], allowed: str
) -> list[list[_Cell]]:
    """Read columns of a CSV file whose first line holds their names.

    Parameters
    ----------
    path : str or Path
        The file, in UTF-8, with commas between the cells.
    columns : sequence of str, optional
        Names of the columns; all of them, in the order of the file, unless given.
    parse : callable
        Turns the text of a cell into its value; raises ValueError where it cannot.
    allowed : str
        What a cell may hold, to be read after "must be".

    Returns
    -------
    list of list
        The values of each column.

    Raises
    ------
    InputError
        If the file cannot be read or has no rows, a column is missing (naming the nearest one), or
        a cell is refused (naming its row, counted from 1 below the names).
    """
    table = _table(path)
    known = [str(name) for name in table.columns]
    if table.empty:
        raise InputError(f"{path}: has no rows below the names of its columns")
    values = []
    for column in known if columns is None else columns:
        if column not in known:
            near = get_close_matches(str(column), known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else ""
            raise InputError.of(f"{path}: column", column, f"one of {', '.join(known)}", hint)
        values.append(_parsed(f"{path}: column {column!r}", table[column].tolist(), parse, allowed))
    return values


def _table(path: str | Path) -> pd.DataFrame:
    """Read all cells as text: what pandas would take for a missing value is shown as it stands."""
    try:
        with warnings.catch_warnings():
            # A row with more cells than there are names is an error, not a warning.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                Path(path),  # and not an address on the net, which pandas would follow
                dtype=str,
                keep_default_na=False,
                index_col=False,
                skipinitialspace=True,
                encoding="utf-8-sig",
            )
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (OSError, ValueError, pd.errors.ParserWarning) as error:  # ParserError is a ValueError
        raise InputError(f"{path}: cannot be read as CSV ({str(error).strip()})") from None
    return table.fillna("")  # cells that are not there at all, at the end of a short row


def _parsed(place: str, cells: list[str], parse: Callable[[str], _Cell], allowed: str) -> list[_Cell]:
    values = []
    for row, cell in enumerate(cells, start=1):
        try:
            values.append(parse(cell))
        except ValueError:
            raise InputError.of(f"{place}, row {row}", cell, allowed) from None
    return values
