"""What the processes of an emulation write down, as rows of one form that travel and are kept as bytes."""

import struct
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt


class RowKind(IntEnum):
    """What a row tells."""

    SENT = 0
    """The unit has looked and sends a signal: planned (`due`) and actual time of the look (`time`), departure
    (`heard`), total demand (`before`) and threshold (`after`)."""
    HEARD = 1
    """A process has received a datagram."""
    REPEATED = 2
    """A process has received a datagram for the second time."""
    LOST = 3
    """The scenario's loss takes an agent's copy."""
    ANSWER = 4
    """An agent has answered: datagram received (`heard`), arrival (`due`), answer (`time`), demand `before`
    and `after`, state of its average, lambda."""


class Row(NamedTuple):
    """One row; times are in units of the run."""

    kind: int
    process: int
    agent: int  # -1 where it is about a process
    resource: int
    number: int  # among the signals for the resource
    sequence: int  # among all signals
    copy: int = 0  # 1 for a duplicate
    flags: int = 0  # of an answer: 1 responded, 2 saturated
    heard: float = 0.0
    due: float = 0.0
    time: float = 0.0
    before: float = 0.0
    after: float = 0.0
    state: float = 0.0
    probability: float = 0.0


_LAYOUT = struct.Struct("<BHiiiqBB7d")

#: The same for NumPy.
ROWS = np.dtype(
    list(zip(Row._fields, ["u1", "<u2", "<i4", "<i4", "<i4", "<i8", "u1", "u1", *7 * ["<f8"]], strict=True))
)

ROW_SIZE = _LAYOUT.size


def packed(row: Row) -> bytes:
    """Write a row as bytes."""
    return _LAYOUT.pack(*row)


def read_rows(content: bytes) -> npt.NDArray[Any]:
    """Read whole rows; a last one that was cut off is left out."""
    whole = len(content) // ROW_SIZE * ROW_SIZE
    return np.frombuffer(content[:whole], dtype=ROWS)
