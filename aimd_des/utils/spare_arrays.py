"""Space of which most is never used."""

import math
import mmap
from typing import Any

import numpy as np
import numpy.typing as npt

# From this size on, in bytes, NumPy asks the system for pages of 2 MB, each of which is zeroed as a whole.
_LARGE = 1 << 22


def spare(shape: tuple[int, ...], dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """Make an array that is not filled, and takes memory in small pages where it is written to."""
    return np.empty(shape, dtype=dtype) if (pages := _pages(shape, dtype)) is None else pages


def spare_zeros(shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Make an array of zeros that takes memory where it is written to; what is read elsewhere is one page."""
    # That page stays in the nearest cache, however many rows of zeros are read through it.
    return np.zeros(shape) if (pages := _pages(shape, np.float64)) is None else pages


def _pages(shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any] | None:
    """Take a large array from the system itself, which fills it with zeros when it is read; else None."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < _LARGE or not hasattr(mmap, "MAP_PRIVATE"):  # which Windows has not, nor such pages
        return None
    try:
        pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:  # what NumPy raises there, since it is no fault of a file
        raise MemoryError(f"{error.strerror}: {size} bytes") from None
    return np.frombuffer(pages, dtype=dtype).reshape(shape)
