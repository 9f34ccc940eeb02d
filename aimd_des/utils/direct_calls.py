"""Calls of kernels from Python that do not ask each time of which types the arguments are."""

from collections.abc import Callable
from operator import is_
from typing import Any

import numpy as np

# Machine code by the kernel and what its types follow from.
_FOUND: dict[tuple[Any, ...], Callable[..., Any]] = {}


def _likeness(value: object) -> Any:
    """Return what the type of an argument follows from; Numba's own type takes twenty times as long."""
    if isinstance(value, np.ndarray):
        # Not its letter alone, which is the same for any order of bytes.
        return value.dtype, value.ndim, value.flags.num
    if isinstance(value, tuple):
        from aimd_des.utils.numba_internals import fingerprint

        # It is the same for any order of bytes; arrays in records are ours.
        return fingerprint(value) if fingerprint else (type(value), *map(_likeness, value))
    return type(value)


def direct(kernel: Callable[..., Any], *arguments: object) -> Callable[..., Any]:
    """Return the machine code of a kernel for arguments like these, which those of each call must be.

    A kernel asks at each call for the types of all that it is given, which takes longer for a record than
    most kernels run.  Where nothing is compiled it is the kernel itself.
    """
    dispatcher: Any = kernel.dispatcher  # type: ignore[attr-defined]  # all kernels are a `Kernel`
    if not hasattr(dispatcher, "overloads"):
        return kernel
    key = (kernel, *map(_likeness, arguments))
    entry = _FOUND.get(key)
    if entry is None:
        kinds = tuple(map(dispatcher.typeof_pyval, arguments))
        if kinds not in dispatcher.overloads:
            dispatcher.compile(kinds)
        entry = _FOUND[key] = dispatcher.overloads[kinds].entry_point
    return entry


class Direct:
    """A kernel that is given the same records again and again: it asks for types where one is another."""

    def __init__(self, kernel: Callable[..., Any]) -> None:
        self._kernel = self._code = kernel
        self._records: tuple[object, ...] = ()

    def __call__(self, records: tuple[object, ...], *others: object) -> Any:
        """Call it with records, and with arguments that have the same types at each call."""
        if len(records) != len(self._records) or not all(map(is_, records, self._records)):
            self._code, self._records = direct(self._kernel, *records, *others), records
        return self._code(*records, *others)
