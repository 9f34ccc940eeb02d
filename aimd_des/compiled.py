"""How compiled code is made: one decorator for kernels, one for formulas that serve both worlds.

A *formula* is a small function of numbers.  The camera processes call it as plain Python; kernels
compile the same source.  No fast-math and no contraction to fused operations, so both give the
same bits.  Kernels are cached on disk.  Numba keys that cache by the file a kernel stands in; a
kernel here may use formulas of other files, so the key is the source of the whole package.
"""

from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.extending import register_jitable

__all__ = ["formula", "kernel", "routine"]

_Function = TypeVar("_Function", bound=Callable[..., Any])


@lru_cache
def _package_stamp() -> str:
    digest = sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


class _PackageCache(FunctionCache):  # type: ignore[misc]  # numba has no type information
    """A cache on disk that is out of date as soon as any file of the package changes."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=_package_stamp(),
        )


def formula(function: _Function) -> _Function:
    """Mark a function of numbers that kernels compile and processes call as it stands.

    Parameters
    ----------
    function : callable
        Arithmetic on numbers only; the same order of operations in both worlds.

    Returns
    -------
    callable
        The function itself.
    """
    return cast(_Function, register_jitable(error_model="numpy", forceinline=True, _nrt=False)(function))


def _compiled(function: _Function, **options: bool) -> _Function:
    dispatcher = numba.njit(error_model="numpy", nogil=True, _nrt=False, **options)(function)
    dispatcher._cache = _PackageCache(function)
    return cast(_Function, dispatcher)


def kernel(function: _Function) -> _Function:
    """Compile a function over arrays when it is first called, and keep the result on disk.

    Kernels that call it hold a copy of its code.

    Parameters
    ----------
    function : callable
        A function that Numba can compile without Python objects.

    Returns
    -------
    callable
        The compiled function; its source stays reachable as ``.py_func``.
    """
    return _compiled(function, forceinline=True)


def routine(function: _Function) -> _Function:
    """Compile a function as `kernel` does, but into one piece of code that all others call.

    For what is large or used in many places, where a copy in each would take long to compile.

    Parameters
    ----------
    function : callable
        A function that Numba can compile without Python objects.

    Returns
    -------
    callable
        The compiled function; its source stays reachable as ``.py_func``.
    """
    return _compiled(function)
