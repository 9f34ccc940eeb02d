"""Calls of kernels from Python that do not ask each time of which types the arguments are."""

from collections.abc import Callable
from typing import Any

import numpy as np

# Machine code by the kernel and what its types follow from.
_FOUND: dict[tuple[Any, ...], Callable[..., Any]] = {}


def _likeness(value: object) -> Any:
    """Return what the type of an argument follows from; Numba's own type takes twenty times as long."""
    if isinstance(value, np.ndarray):
        # Not its letter alone, which is the same for any order of bytes.
        return value.dtype, value.ndim, value.flags.num
    return (type(value), *map(_likeness, value)) if isinstance(value, tuple) else type(value)


def direct(kernel: Callable[..., Any], *arguments: object) -> Callable[..., Any]:
    """Return the machine code of a kernel for arguments like these, which those of each call must be.

    A kernel asks at each call for the types of all that it is given, which takes longer for a record than
    most kernels run.  Where nothing is compiled it is the kernel itself.
    """
    key = (kernel, *map(_likeness, arguments))
    entry = _FOUND.get(key)
    if entry is None:
        dispatcher: Any = kernel.dispatcher  # type: ignore[attr-defined]  # all kernels are a `Kernel`
        if not hasattr(dispatcher, "overloads"):
            return kernel
        kinds = tuple(map(dispatcher.typeof_pyval, arguments))
        if kinds not in dispatcher.overloads:
            dispatcher.compile(kinds)
        entry = _FOUND[key] = dispatcher.overloads[kinds].entry_point
    return entry
