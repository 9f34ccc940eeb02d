"""Columns of tidy frames."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from aimd_des.utils.validation import IntArray

if TYPE_CHECKING:
    import pandas as pd

# What a spreadsheet takes for the beginning of a formula, and the sign by which it takes it for text.
_FORMULAS = ("=", "+", "-", "@", "\t", "\r")
_TEXT = "'"


# Columns of frames that were stored before 0.1.0, by their names of then.
_RENAMED = {"camera": "agent"}


def columns_now(names: Iterable[str]) -> list[str]:
    """Give the columns of a stored frame the names that they have now."""
    return [_RENAMED.get(name, name) for name in names]


def categorical(codes: IntArray, names: Sequence[str]) -> "pd.Categorical":
    """Turn indices into names."""
    import pandas as pd

    # Generic in the stubs only: a subscript in the annotation would not survive at run time.
    return pd.Categorical.from_codes(codes, categories=pd.Index(names))  # type: ignore[return-value]


def safe_names(names: Iterable[str]) -> list[str]:
    """Write names for a CSV file so that no spreadsheet takes them for formulas."""
    return [_TEXT + name if name.startswith((*_FORMULAS, _TEXT)) else name for name in names]


def name_as_written(word: str) -> str:
    """Undo `safe_names`."""
    rest = word.removeprefix(_TEXT)
    return rest if rest.startswith((*_FORMULAS, _TEXT)) else word
