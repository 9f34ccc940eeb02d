"""Arrays that many hold and only one place writes, or that are not written to at all."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

_Array = TypeVar("_Array", bound=npt.NDArray[Any])


def locked(array: _Array) -> _Array:
    """Let only `put` write into an array."""
    array.setflags(write=False)
    return array


def put(array: npt.NDArray[Any], where: Any, value: Any) -> None:
    """Write into an array that is locked: for the functions of `interventions` alone.

    Parts that hold the array see the change.  A part that writes there itself would be obeyed by parts that
    read the array and not by those that have copied it, and no log would tell of it.
    """
    array.setflags(write=True)
    array[where] = value
    array.setflags(write=False)


def repeated(values: Sequence[float], n: int) -> npt.NDArray[np.float64]:
    """Show each number in all n places of a row, though it is in memory once."""
    # What `numpy.broadcast_to` makes, in a quarter of the time.
    column = np.array(values, dtype=np.float64)
    return locked(np.ndarray((len(column), n), np.float64, column, strides=(column.itemsize, 0)))


def each(value: npt.ArrayLike, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Spread a number, or one for each, over an array; zeros are not written, and so take no memory."""
    row = np.zeros(shape)
    carry_over(np.asarray(value), row)
    return row


def carry_over(kept: npt.NDArray[Any], fresh: npt.NDArray[Any]) -> None:
    """Fill an array of zeros that was not written to with what another one holds."""
    # What is not written to takes no memory, and most counts of most runs are 0.
    if kept.any():
        fresh[...] = kept
