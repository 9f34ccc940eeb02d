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
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < _LARGE or not hasattr(mmap, "MAP_PRIVATE"):  # which Windows has not, nor such pages
        return np.empty(shape, dtype=dtype)
    pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return np.frombuffer(pages, dtype=dtype).reshape(shape)
