"""How compiled code is made: one decorator for kernels, one for formulas that serve both worlds.

A *formula* is a small function of numbers.  Agent processes call it as plain Python; kernels
compile the same source.  No fast-math and no contraction to fused operations, so both give the
same bits.  A *kernel* is a function over arrays, which Python and other kernels call in machine code.

Numba takes as long to import as all else that a command needs to check a file, so it is imported when a
kernel is first called.  Until then formulas and records are noted, and no more.  Numba is taught what is
noted before it compiles anything: a kernel of ours, or a function of a user's that calls a formula, since it
calls what the entry point ``numba_extensions`` of this package names.  Where the package is not installed
Numba finds no entry point: it is imported, and taught, at once.

With ``NUMBA_DISABLE_JIT=1`` nothing is compiled: kernels are the functions of Python they are written as,
a hundred times as slow, and give the same bits.
"""

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial, update_wrapper
from pathlib import Path
from threading import RLock
from typing import Any, TypeVar, cast

_Function = TypeVar("_Function", bound=Callable[..., Any])

# When the first source was imported that kernels are made of.
_IMPORTED = time.time()

# One thread at a time teaches Numba, or makes what compiles a kernel.
_LOCK = RLock()

# What Numba will be taught; None when it has been, and is taught all else as it comes.
_noted: list[Callable[[], object]] | None = []


def note(teach: Callable[[], object]) -> None:
    """Call a function before Numba compiles anything; at once, if it may have."""
    with _LOCK:
        if _noted is None:
            teach()
        else:
            _noted.append(teach)


def teach_numba() -> None:
    """Teach Numba what has been noted: Numba calls this before it first compiles, for anyone."""
    global _noted  # noqa: PLW0603 - what Numba has been taught is the same for the whole process
    with _LOCK:
        noted, _noted = _noted or [], None
        try:
            while noted:
                noted[0]()
                del noted[0]
        finally:
            _noted = noted or None  # what an interrupt has kept from being taught is taught the next time


class Kernel:
    """A function that is compiled when it is first called; Numba is not imported before."""

    # What a call runs is looked up here by the interpreter itself: no function of Python stands between a
    # caller and machine code.
    __slots__ = ("__call__", "__dict__", "_dispatcher", "_options", "py_func")
    __call__: Callable[..., Any]
    _dispatcher: Any

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self.py_func, self._options, self._dispatcher = function, options, None
        self.__call__ = self._first_call
        update_wrapper(self, function)

    def _first_call(self, *args: Any, **named: Any) -> Any:
        if self._options.get("inner") and hasattr(self.dispatcher, "overloads"):
            raise TypeError(f"{self.py_func.__name__}: only compiled code can call it")
        return self.dispatcher(*args, **named)

    @property
    def dispatcher(self) -> Any:
        """What Numba has made of the function, and calls from now on go to."""
        with _LOCK:
            if self._dispatcher is None:
                from aimd_des.utils.compiling import compiled

                teach_numba()
                self._dispatcher = compiled(self.py_func, _IMPORTED, **self._options)
                if not self._options.get("inner"):  # else a call from Python would end the process
                    self.__call__ = self._dispatcher
        return self._dispatcher

    @property
    def _numba_type_(self) -> Any:
        """The type of what compiled code calls: Numba asks for it by this name."""
        from numba import typeof

        return typeof(self.dispatcher)

    def __reduce__(self) -> str:
        """Pickle as functions are: by name."""
        return self.py_func.__qualname__


def formula(function: _Function) -> _Function:
    """Mark a function of numbers that kernels compile and processes call unchanged."""

    def teach() -> None:
        from aimd_des.utils.compiling import enter_formula

        enter_formula(function)

    note(teach)
    return function


def row_formula(function: _Function) -> _Function:
    """Mark a formula of arrays that do not overlap: LLVM need not compare where they lie, loop by loop."""

    def teach() -> None:
        from aimd_des.utils.compiling import enter_formula

        enter_formula(function, separate=True)

    note(teach)
    return function


def instruction(function: _Function) -> _Function:
    """Mark a function for which kernels have an instruction: what `instructions` builds under its name."""

    def teach() -> None:
        from aimd_des.utils.instructions import enter_instruction

        enter_instruction(function)

    note(teach)
    return function


def kernel(function: _Function) -> _Function:
    """Compile a function over arrays when it is first called, and keep the result on disk.

    Kernels that call it hold a copy of its code at each call.
    """
    return cast(_Function, Kernel(function, forceinline=True))


def routine(function: _Function) -> _Function:
    """Compile a function as `kernel` does, but once in each kernel, for all the calls that are in it.

    For what is large or used in many places, where a copy at each would take long to compile.
    """
    return cast(_Function, Kernel(function))


def deferred(function: _Function) -> _Function:
    """Compile a function by itself, when it is first called, to machine code that all its callers share.

    For what not every run needs, and for what several kernels call once for many agents.  Its result has the
    type that its annotation says.  Python cannot call it: what would take its records apart takes as long to
    compile as a small kernel.
    """
    return cast(_Function, Kernel(function, apart=True, inner=True))


def shared(function: _Function) -> _Function:
    """Compile a function as `deferred` does, for Python to call as well."""
    return cast(_Function, Kernel(function, apart=True))


def announced(what: str) -> Callable[[_Function], _Function]:
    """Make a routine that takes so long to compile that users are told."""
    return cast(Callable[[_Function], _Function], partial(Kernel, announced=what))


def _is_found_by_numba() -> bool:
    """Look for the entry point of this package: `importlib.metadata` takes ten times as long to import."""
    wanted = f"{teach_numba.__module__}:{teach_numba.__name__}"
    for folder in sys.path:
        with suppress(OSError):  # Python passes over folders that the user may not enter
            found = Path(folder).glob("aimd_des-*info/entry_points.txt")
            if any(wanted in path.read_text(encoding="utf-8") for path in found):
                return True
    return False


if not _is_found_by_numba():
    teach_numba()
