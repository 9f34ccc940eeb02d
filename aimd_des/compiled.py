"""How compiled code is made: one decorator for kernels, one for formulas that serve both worlds.

A *formula* is a small function of numbers.  The camera processes call it as plain Python; kernels
compile the same source.  No fast-math and no contraction to fused operations, so both give the
same bits.  Compiled code counts no references, so nothing can be allocated in it: what tries is
refused when it is compiled.  Kernels are cached on disk.  Numba keys that cache by the file a kernel
stands in; a kernel here may use formulas of other files, so the key is the source of all of the package
that a kernel can depend on.
"""

import logging
from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar, TypeVar, cast

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.types.misc import unliteral
from numba.extending import register_jitable

__all__ = ["announced", "formula", "kernel", "routine"]

# Nobody has to set up logging to see a warning; whoever does can silence it.
_LOGGER = logging.getLogger("aimd_des")

_FORMULAS = "formulas (about ten seconds)"

_Function = TypeVar("_Function", bound=Callable[..., Any])


#: What is built on the simulation: no kernel is here, and none uses what is.
ABOVE_KERNELS = frozenset(
    {
        "__init__",
        "__main__",
        "cli",
        "output",
        "plots",
        "progress",
        "report",
        "scenario",
        "stored",
        "study",
        "theory",
        "watch",
    }
)


@lru_cache
def _package_stamp() -> str:
    digest = sha256()
    root = Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        if Path(path.relative_to(root).parts[0]).stem not in ABOVE_KERNELS:
            digest.update(path.read_bytes())
    return digest.hexdigest()


class _PackageCache(FunctionCache):  # type: ignore[misc]  # numba has no type information
    """A cache on disk that is out of date as soon as a file changes that a kernel may depend on."""

    # What users of this process have been told of.
    told: ClassVar[set[str]] = set()

    def __init__(self, py_func: Callable[..., Any], announced: str = "") -> None:
        super().__init__(py_func)
        self._announced = announced
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=_package_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load what an earlier run compiled; say so where there is nothing and compiling takes its time."""
        found = super().load_overload(sig, target_context)
        # Many kernels are compiled for one run: the first speaks for all but those that take long.
        what = self._announced or ("" if self.told else _FORMULAS)
        if found is None and what and what not in self.told:
            self.told.add(what)
            _LOGGER.warning("compiling %s, which is done once on a machine; please wait", what)
        return found


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


def _compiled(function: _Function, announced: str = "", **options: bool) -> _Function:
    dispatcher = numba.njit(error_model="numpy", nogil=True, _nrt=False, **options)(function)
    dispatcher._cache = _PackageCache(function, announced)
    typed = dispatcher.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        """Compile once for all integers, not once more for each that is written out where it is called."""
        return typed([*map(unliteral, args)], {name: unliteral(kws[name]) for name in kws})

    dispatcher.get_call_template = get_call_template
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


def announced(what: str) -> Callable[[_Function], _Function]:
    """Make a routine that takes so long to compile that users are told.

    Parameters
    ----------
    what : str
        What is being compiled, and about how long it takes.

    Returns
    -------
    callable
        A decorator like `routine`.
    """
    return lambda function: _compiled(function, announced=what)
