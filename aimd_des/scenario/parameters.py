"""Parameters of models: anything that a file can hold, and nothing else."""

import sys
from datetime import date, datetime, time
from typing import Any

import numpy as np

from aimd_des.utils.errors import InputError

_PLAIN = (str, bool, float, date, datetime, time, type(None))

# Tables and lists in each other; what reads and writes them calls itself for each.
_DEEPEST = 32


def refuse_no_data(field: str, value: Any, depth: int = 0) -> None:
    """Refuse what cannot be written to a file and read back the same."""
    if depth > _DEEPEST:
        raise InputError(f"{field}: is nested deeper than {_DEEPEST} tables and lists; make it flatter")
    if isinstance(value, dict):
        for key, item in value.items():
            refuse_no_data(f"{field}.{key}", item, depth + 1)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            refuse_no_data(f"{field}.{number}", item, depth + 1)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InputError.of(field, value, "an integer of 64 bits")
    elif not isinstance(value, (*_PLAIN, int)):
        raise InputError.of(field, value, "a string, number, truth value, date, time, list or table")


def as_data(value: Any, depth: int = 0) -> Any:
    """Write values as a file has them."""
    if _is_array(value):
        value = value.tolist()
    if depth > 2 * _DEEPEST:
        return value
    if isinstance(value, dict):
        return {key: as_data(item, depth + 1) for key, item in value.items()}
    return [as_data(item, depth + 1) for item in value] if isinstance(value, list | tuple | range) else value


def _is_array(value: Any) -> bool:
    """Tell arrays and NumPy's numbers, and the series and indices of pandas."""
    # Pandas is slow to import, and code that has a series has imported it.
    pandas = sys.modules.get("pandas")
    return isinstance(value, np.ndarray | np.generic) or (
        pandas is not None and isinstance(value, pandas.Series | pandas.Index)
    )
