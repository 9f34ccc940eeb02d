"""How Numba compiles kernels and formulas, and keeps their machine code on the disk.

Compiled code counts no references, so nothing can be allocated in it: what tries is refused when it is
compiled.  A kernel that Python calls is machine code, cached on disk, and compiled by one process while
others wait; the kernels that it calls are parts of it, or deferred: compiled when they are first called
(`numba_internals`).  Numba keys that cache by the file a kernel stands in; a kernel here may use formulas of
other files, so the key is the source of all of the package that a kernel can depend on.  Where nothing can be
written, kernels are compiled anew in each process.

This module imports Numba, and is imported by `jit` when a kernel is first called or Numba first compiles.
"""

import gc
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from functools import lru_cache, wraps
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.types.misc import unliteral
from numba.extending import register_jitable

try:
    from aimd_des.utils import numba_internals
except ImportError:  # another Numba, which keeps in other places what is private to it
    numba_internals = None  # type: ignore[assignment]

if sys.platform != "win32":  # where processes compile side by side
    import fcntl

_Function = Callable[..., Any]

# Warnings are seen without setting up logging, which can silence them.
_LOGGER = logging.getLogger("aimd_des")

_FORMULAS = "formulas (some seconds)"

_CHANGED = "the sources have changed since they were imported"
_RESTART = "start Python again, and code is compiled only once"
_NAME_A_FOLDER = "set NUMBA_CACHE_DIR to a folder that can be written, and code is compiled only once"

# What users of this process have been told of.
_TOLD: set[str] = set()

#: Whether what only compiled code calls is compiled as a part of its callers alone.
PARTS = numba_internals is not None and numba_internals.are_as_expected()
#: And whether some kernels are compiled apart, at their first call.
DEFERS = PARTS and numba_internals.can_defer()

# Divisions as arrays have them, and nothing that is allocated.
_SEMANTICS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}

# No way in from Python: kernels call parts, and processes the source of formulas.
_PART: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
# The same for what is given arrays that do not overlap.
_SEPARATE = dict(_PART)
_KERNEL: dict[str, Any] = {"no_cfunc_wrapper": True}
if PARTS:
    _KERNEL["pipeline_class"] = numba_internals.KernelCompiler
    _PART["pipeline_class"] = numba_internals.PartCompiler
    _SEPARATE["pipeline_class"] = numba_internals.SeparatePartCompiler

#: What is built on the simulation: no kernel is here, and none uses what is.
ABOVE_KERNELS = frozenset(
    {
        "__init__",
        "__main__",
        "_deprecated",
        "_version",
        "averaging",
        "cli",
        "compensation",
        "emulate",
        "latency",
        "live",
        "loss",
        "lowlevel",
        "plots",
        "report",
        "scenario",
        "study",
        "theory",
        "topology",
        "watch",
    }
)


@lru_cache
def _package_stamp(imported: float) -> str:
    """Return a digest of the sources; empty where one has changed since the first was imported."""
    digest = sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        if Path(path.relative_to(root).parts[0]).stem not in ABOVE_KERNELS:
            if path.stat().st_mtime > imported:
                return ""
            digest.update(path.read_bytes())
    return digest.hexdigest()


class _PackageCache(FunctionCache):  # type: ignore[misc]  # numba has no type information
    """A cache on disk that is out of date as soon as a file changes that a kernel may depend on."""

    def __init__(self, py_func: Callable[..., Any], stamp: str, announced: str = "") -> None:
        super().__init__(py_func)
        self._announced = announced
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=stamp,
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load what an earlier run compiled, if it is there and whole."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - unpickling what is damaged can raise anything
            found = None
            with suppress(OSError):
                self.flush()  # keeping what is compiled now would read it again
        if found is None:
            _announce(self._announced)
        return found

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Let no other process compile this kernel: it waits, and then finds the code on the disk.

        The system gives the lock up with the process.  A kernel is locked before those it calls, and none
        calls itself, so no processes wait for each other.
        """
        with ExitStack() as held:
            with suppress(OSError):  # what can be read need be neither written nor locked
                path = Path(self.cache_path, f"{self._impl.filename_base}.lock")
                lock = held.enter_context(path.open("w"))
                if sys.platform != "win32":
                    fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; if the disk refuses it is used all the same."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say_that_nothing_is_kept(error.strerror)


class _NoCache(NullCache):  # type: ignore[misc]  # numba has no type information
    """In place of a cache where nothing can be kept."""

    def __init__(self, announced: str, reason: str) -> None:
        self._announced, self._reason = announced, reason

    def alone(self) -> AbstractContextManager[None]:
        """Do not wait for other processes, which can leave nothing here."""
        return nullcontext()

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Say that compiling takes its time, and that it will next time."""
        _say_that_nothing_is_kept(self._reason)
        _announce(self._announced, once="")


def _announce(announced: str, once: str = ", which is done once on a machine") -> None:
    """Say what is compiled: the first of many kernels speaks for all except those that take long."""
    what = announced or ("" if _TOLD else _FORMULAS)
    if what and what not in _TOLD:
        _TOLD.add(what)
        _LOGGER.warning("compiling %s%s; please wait", what, once)


@lru_cache(maxsize=1)
def _say_that_nothing_is_kept(reason: str | None) -> None:
    remedy = _RESTART if reason == _CHANGED else _NAME_A_FOLDER
    _LOGGER.warning("compiled code is not kept (%s) and will be compiled anew next time; %s", reason, remedy)


def _cache_for(function: Callable[..., Any], imported: float, announced: str) -> Any:
    # What is imported may be older than its source: its code must not be kept as that of the source.
    if not (stamp := _package_stamp(imported)):
        return _NoCache(announced, _CHANGED)
    try:
        return _PackageCache(function, stamp, announced)
    except (RuntimeError, OSError):  # numba finds no place, or loses it meanwhile
        return _NoCache(announced, "no folder for it can be written")


def enter_formula(function: _Function, *, separate: bool = False) -> None:
    """Let Numba compile a function as a part of what calls it."""
    options = _SEPARATE if separate else _PART
    register_jitable(**_SEMANTICS, **options, forceinline=True)(function)


@contextmanager
def _without_collector() -> Iterator[None]:
    """Keep the garbage collector from searching what is being compiled, which takes an eighth of the time."""
    runs = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if runs:
            gc.enable()


def compiled(
    function: _Function,
    imported: float,
    announced: str = "",
    *,
    apart: bool = False,
    inner: bool = False,
    **options: bool,
) -> Any:
    """Compile to machine code, inner or for Python; kernels that call it take in a part, or call it apart."""
    if numba.config.DISABLE_JIT:
        return _interpreted(function)
    way_in = {"no_cpython_wrapper": True} if inner else {}
    dispatcher = numba.njit(nogil=True, **_KERNEL, **way_in, **_SEMANTICS, **options)(function)
    cache = dispatcher._cache = _cache_for(function, imported, announced)
    compile_now = dispatcher.compile

    def compile_alone(signature: Any) -> Any:
        """Compile what no other process is compiling; threads of this one wait for each other first."""
        with global_compiler_lock, cache.alone(), _without_collector():
            return compile_now(signature)

    dispatcher.compile = compile_alone
    if DEFERS and apart:
        numba_internals.defer(dispatcher)
    elif PARTS:
        numba_internals.take_in(dispatcher, numba.njit(**_SEMANTICS, **_PART, **options)(function))
    typed = dispatcher.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        """Compile once for all integers, not once more for each that is written out where it is called."""
        return typed([*map(unliteral, args)], {name: unliteral(kws[name]) for name in kws})

    dispatcher.get_call_template = get_call_template
    return dispatcher


def _interpreted(function: _Function) -> _Function:
    """Run a kernel uncompiled, with machine arithmetic: divisions by zero and overflows are no errors."""

    @wraps(function)
    def run(*args: Any, **named: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*args, **named)

    return run
