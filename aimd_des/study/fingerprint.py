"""What a problem is, as digests: its numbers, and the source of functions and classes of one's own."""

import ast
import inspect
import sys
import sysconfig
import textwrap
from collections.abc import Iterator, Mapping
from functools import cache, cached_property, partial
from hashlib import sha256
from pathlib import Path
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from aimd_des.problem.problem import Problem

#: Raised where the same problem gets other digests than before: they cannot be compared then.
FORM = 1

_PLAIN = (str, bytes, bool, int, float, complex, type(None))
_DIGITS = 16
_OURS = __name__.partition(".")[0]
# Whose source is no part of a study: a key holds the version of results, a run those of the libraries.
_LIBRARIES = tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")})
# What NumPy's functions draw from is of the process: distributions of SciPy refer to it.
_COMMON_GENERATOR = np.random.mtrand._rand  # noqa: SLF001 - as SciPy does
_FIELDS = ("name", "capacity", "increase", "decrease", "normalization", "threshold", "unit")


def problem_digests(problem: Problem) -> dict[str, str]:
    """Describe a problem part by part."""
    fields = {name: [getattr(resource, name) for resource in problem.resources] for name in _FIELDS}
    whole = {**fields, "costs": problem.costs, "agent names": problem.agent_names}
    return {name: fingerprint(value) for name, value in whole.items()}


def fingerprint(value: object) -> str:
    """Digest a value: the same in every process, and another where what it does may be another."""
    digest = sha256()
    for part in _words(value, {}):
        digest.update(part)
        digest.update(b"\0")
    return digest.hexdigest()[:_DIGITS]


def _words(value: Any, above: dict[int, Any]) -> Iterator[bytes]:
    """Write a value down; `above` has what is being written, since things may refer to each other."""
    if isinstance(value, _PLAIN):
        yield repr(value).encode("utf-8", "backslashreplace")
    elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        yield f"{value.dtype.str} {value.shape}".encode()
        yield value.tobytes()
    elif id(value) not in above:
        above[id(value)] = value
        yield type(value).__qualname__.encode()
        for part in _parts(value):
            yield from _words(part, above)
        # Functions are written once, however many call them; equal data are written alike in every place.
        if not isinstance(value, type | FunctionType):
            del above[id(value)]


def _parts(value: Any) -> Iterator[Any]:
    """Take apart what is no number."""
    if isinstance(value, Mapping):
        for pair in value.items():
            yield from pair
    elif isinstance(value, set | frozenset):
        yield from sorted(map(fingerprint, value))
    elif isinstance(value, list | tuple | np.ndarray):
        yield from value
    elif isinstance(value, partial):
        yield from (value.func, value.args, value.keywords)
    elif isinstance(value, MethodType):
        yield from (value.__func__, value.__self__)
    elif isinstance(value, type):
        yield from _class(value)
    elif isinstance(value, FunctionType):
        yield from _function(value)
    elif isinstance(value, ModuleType | BuiltinFunctionType | np.ufunc):
        yield value.__name__
    elif (function := getattr(value, "py_func", getattr(value, "__wrapped__", None))) is not None:
        yield function  # of what is compiled, or cached
    elif (made := _made(value)) is not None:
        yield from made
    else:
        yield type(value)
        yield _state(value)
        yield [getattr(value, name, None) for name in _slots(type(value))]


def _made(value: Any) -> list[Any] | None:
    """Say what makes a thing anew that has a way of its own, such as a path, a date or a generator."""
    if value is _COMMON_GENERATOR:
        return ["numpy.random"]
    if getattr(type(value), "__reduce__", None) == object.__reduce__:
        return None
    try:
        parts = value.__reduce_ex__(2)
    except Exception:  # noqa: BLE001 - of others: files, for one, raise TypeError
        return None
    return [list(part) if isinstance(part, Iterator) else part for part in parts]


def _state(value: Any) -> dict[str, Any] | None:
    """Take the attributes, except those that are cached after the first access."""
    held = getattr(value, "__dict__", None)
    if held is None:
        return None
    kind = type(value)
    return {
        name: part
        for name, part in held.items()
        if not isinstance(inspect.getattr_static(kind, name, None), cached_property)
    }


def _slots(kind: type) -> Iterator[str]:
    """Name the slots of a class and of those above it."""
    for one in kind.__mro__:
        names = vars(one).get("__slots__", ())
        yield from (names,) if isinstance(names, str) else names


def _is_own(module: str) -> bool:
    """Tell whether source is that of a user."""
    path = getattr(sys.modules.get(module), "__file__", None)
    of_a_library = path is None or path.startswith(_LIBRARIES)
    return module == "__main__" or not (of_a_library or module.partition(".")[0] == _OURS)


def _class(given: type) -> Iterator[Any]:
    """Yield what instances do: the source, and what methods take from elsewhere."""
    yield given.__qualname__
    if _is_own(given.__module__):
        yield _source(given)
        yield given.__bases__
        for part in vars(given).values():
            function = getattr(part, "__func__", getattr(part, "fget", part))
            # What a decorator has made up, such as that of dataclasses, has no file.
            if isinstance(function, FunctionType) and not function.__code__.co_filename.startswith("<"):
                yield function


def _function(function: FunctionType) -> Iterator[Any]:
    """Yield what a function does: its own source, and what it takes from elsewhere."""
    yield [_held(cell) for cell in function.__closure__ or ()]
    if not _is_own(function.__module__):
        yield function.__qualname__
        return
    yield _source(function.__code__)
    yield from (function.__defaults__, function.__kwdefaults__)
    names = sorted(set(_names(function.__code__)))
    for name in names:
        if name in function.__globals__:
            found = function.__globals__[name]
            yield name
            if isinstance(found, ModuleType) and _is_own(found.__name__):
                yield from (getattr(found, inner) for inner in names if hasattr(found, inner))
            elif isinstance(found, dict | list | set):
                # It may be a memory that fills as the process goes on: what is written counts.
                yield _assigned(name, function.__globals__.get("__file__"))
            else:
                yield found


def _held(cell: CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # nothing yet
        return None


def _assigned(name: str, path: str | None) -> list[str]:
    """Read what a module assigns to a name."""
    try:
        found = Path(str(path)).stat()
        return _assignments(_File(str(path), found.st_mtime_ns, found.st_size)).get(name, [])
    except (OSError, SyntaxError):
        return []


class _File(NamedTuple):
    """A file as it is now: another one where it is written again."""

    path: str
    changed: int  # in nanoseconds
    size: int


@cache
def _assignments(file: _File) -> dict[str, list[str]]:
    """Read what a module assigns to each name."""
    found: dict[str, list[str]] = {}
    for one in ast.parse(Path(file.path).read_bytes()).body:
        if isinstance(one, ast.Assign | ast.AnnAssign | ast.AugAssign):
            text = ast.unparse(one)
            for name in {part.id for part in ast.walk(one) if isinstance(part, ast.Name)}:
                found.setdefault(name, []).append(text)
    return found


def _names(code: CodeType) -> Iterator[str]:
    """Name what code refers to, also in functions within it."""
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _names(inner)


@cache
def _source(given: type | CodeType) -> str:
    """Read the source without comments and formatting; unchanged where it is a part of a line."""
    try:
        text = textwrap.dedent(inspect.getsource(given))
    except (OSError, TypeError):  # typed in by hand: there is the code alone
        if isinstance(given, type):
            return given.__qualname__
        return repr(
            (given.co_code, given.co_names, [one for one in given.co_consts if isinstance(one, _PLAIN)])
        )
    try:
        return ast.unparse(ast.parse(text))
    except SyntaxError:
        return " ".join(text.split())
