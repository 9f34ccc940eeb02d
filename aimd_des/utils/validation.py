"""Checks of arguments: each returns the clean value or raises an `InputError` that names the field."""

import math
import os
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence, Set
from contextlib import suppress
from difflib import get_close_matches
from numbers import Integral, Real
from pathlib import Path
from typing import TypedDict, TypeVar

import numpy as np
import numpy.typing as npt

from aimd_des.utils.docstrings import described_like
from aimd_des.utils.errors import InputError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_Value = TypeVar("_Value")

# They count as integers for Python and for NumPy, and mean something else.
_NO_NUMBERS = (bool, np.bool_, np.timedelta64)


class _Bounds(TypedDict):
    low: float
    high: float
    low_open: bool
    high_open: bool


def _interval(low: float, high: float, low_open: bool, high_open: bool) -> str:
    """Say the allowed range in words that need no key."""
    parts = []
    if math.isfinite(low):
        parts.append(f"{'greater than' if low_open else 'at least'} {low:g}")
    if math.isfinite(high):
        parts.append(f"{'less than' if high_open else 'at most'} {high:g}")
    return " ".join(["a finite number", " and ".join(parts)]).rstrip()


def _outside(values: FloatArray, low: float, high: float, low_open: bool, high_open: bool) -> BoolArray:
    below = values <= low if low_open else values < low
    above = values >= high if high_open else values > high
    return ~np.isfinite(values) | below | above


def _scalar(value: object) -> object:
    """Take the number out of an array without axes, as NumPy's functions often return one."""
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def _laid_out(value: object) -> bool:
    """Say whether NumPy may look into a value: not into a graph, whose nodes it would take for numbers."""
    if isinstance(value, str | bytes | type):
        return False
    return isinstance(value, Sequence) or hasattr(value, "__array__")


def axes(value: object) -> int:
    """Count the axes along which NumPy lays out a value."""
    if not _laid_out(value):
        return 0
    try:
        return np.ndim(value)  # type: ignore[arg-type]  # that is what is asked
    except ValueError:
        return 1


def number(
    field: str,
    value: object,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    low_open: bool = False,
    high_open: bool = False,
    remedy: str = "",
) -> float:
    """Return `value` as a float within the range, or refuse it by name.

    Parameters
    ----------
    field : str
        What the value is called where it was given.
    value : object
        A number; truth values and texts are none.
    low, high : float
        Bounds, included unless told otherwise.
    low_open, high_open : bool
        Whether a bound is excluded.
    remedy : str
        What the refusal advises.

    Returns
    -------
    float
        The number.

    Raises
    ------
    InputError
        With the field, the value, the range and the remedy.
    """
    given = _scalar(value)
    if type(given) is not float and not isinstance(given, _NO_NUMBERS) and isinstance(given, Real):
        with suppress(OverflowError):  # an int beyond the range of floats
            given = float(given)
    if isinstance(given, float):
        below = given <= low if low_open else given < low
        above = given >= high if high_open else given > high
        if math.isfinite(given) and not below and not above:
            return given
    # Put into words here, not before: most numbers are fine.
    raise InputError.of(field, given, _interval(low, high, low_open, high_open), remedy)


@described_like(number)
def integer(
    field: str, value: object, *, low: int | None = None, high: int | None = None, remedy: str = ""
) -> int:
    """Return `value` as an int within the range, or refuse it by name.

    Parameters
    ----------
    value : object
        An integer; truth values and floats are none.
    low, high : int, optional
        Bounds, included.

    Returns
    -------
    int
        The integer.
    """
    given = _scalar(value)
    if type(given) is not int and not isinstance(given, _NO_NUMBERS) and isinstance(given, Integral):
        given = int(given)
    if type(given) is int and (low is None or given >= low) and (high is None or given <= high):
        return given
    allowed = "an integer"
    if low is not None:
        allowed += f" of at least {low}"
    if high is not None:
        allowed += f"{' and' if low is not None else ''} at most {high}"
    raise InputError.of(field, given, allowed, remedy)


@described_like(number)
def array(
    field: str,
    value: object,
    shape: Sequence[int | str],
    *,
    low: float = -math.inf,
    high: float = math.inf,
    low_open: bool = False,
    high_open: bool = False,
    remedy: str = "",
) -> FloatArray:
    """Return `value` as a read-only float array, or refuse it by name and by element.

    Parameters
    ----------
    value : object
        Numbers, as NumPy reads them.
    shape : sequence of int or str
        A length for each axis, or a word where any length will do.

    Returns
    -------
    ndarray
        A copy of the numbers that cannot be written.
    """
    wanted = f"({', '.join(str(length) for length in shape)}{',' if len(shape) == 1 else ''})"
    try:
        raw = np.asarray(value) if _laid_out(value) or isinstance(value, Real) else None
        if raw is None or raw.dtype.kind not in "iuf":
            raise TypeError
        clean = np.array(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError.of(field, value, f"an array of numbers of shape {wanted}", remedy) from None
    fits = clean.ndim == len(shape) and all(
        isinstance(want, str) or want == have for want, have in zip(shape, clean.shape, strict=True)
    )
    if not fits:
        raise InputError.of(f"shape of {field}", clean.shape, wanted, remedy)
    bad = np.argwhere(_outside(clean, low, high, low_open, high_open))
    if len(bad):
        where = tuple(int(index) for index in bad[0])
        element = f"{field}[{', '.join(map(str, where))}]"
        raise InputError.of(element, float(clean[where]), _interval(low, high, low_open, high_open), remedy)
    clean.setflags(write=False)
    return clean


@described_like(number)
def per_agent(
    field: str,
    value: object,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    low_open: bool = False,
    high_open: bool = False,
    remedy: str = "",
) -> float | FloatArray:
    """Return a scalar for all agents as a float, or one value per agent as a read-only (n,) array.

    Parameters
    ----------
    value : object
        A number, or a number for each agent.

    Returns
    -------
    float or ndarray, shape (n,)
        The number or the numbers.
    """
    bounds: _Bounds = {"low": low, "high": high, "low_open": low_open, "high_open": high_open}
    if axes(value):
        clean = array(field, value, ("n_agents",), **bounds, remedy=remedy)
        if not len(clean):
            raise InputError.of(f"shape of {field}", clean.shape, "(n_agents,), one for each agent")
        return clean
    return number(field, value, **bounds, remedy=remedy)


def choice(field: str, value: object, words: Sequence[str]) -> str:
    """Return `value` if it is one of some words, or refuse it by name."""
    if not isinstance(value, str) or value not in words:
        raise InputError.of(field, value, " or ".join(map(repr, words)))
    return value


def known(field: str, value: object, names: Collection[Hashable], allowed: str = "") -> None:
    """Refuse what is none of some names, and say which one is most like it."""
    if value not in names:
        listed = allowed or f"one of {', '.join(map(str, names))}"
        raise InputError.of(field, value, listed, nearest(value, names))


def nearest(name: object, names: Iterable[Hashable]) -> str:
    """Ask whether the name that is most like it was meant."""
    shown = {str(one): one for one in names}
    found = get_close_matches(str(name), shown, n=1)
    return f"did you mean {shown[found[0]]!r}?" if found else ""


def flag(field: str, value: object) -> bool:
    """Return `value` as a bool, or refuse it by name: "no" and 0.0 are no answers."""
    value = _scalar(value)
    if not isinstance(value, bool | np.bool_):
        raise InputError.of(field, value, "True or False")
    return bool(value)


def path(field: str, value: object) -> Path:
    """Return `value` as a path, or refuse it by name."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):  # which no system takes
        raise InputError.of(field, value, "the name of a file or folder, a string or a Path")
    return Path(value)


def instance(field: str, value: _Value, kind: type, allowed: str, remedy: str = "") -> _Value:
    """Return `value` if it is an object of a kind, or refuse it by name."""
    if isinstance(value, type) and (isinstance(value, kind) or kind in value.__mro__):
        raise InputError.of(field, value, allowed, f"make an object of it: {value.__name__}(...)")
    if not _belongs(value, kind):
        raise InputError.of(field, value, allowed, remedy)
    return value


def _belongs(value: object, kind: type) -> bool:
    """Tell whether a value is of a kind; of a class Python keeps the answer, of an object of it none."""
    try:
        if issubclass(type(value), kind):
            return True
    except TypeError:  # a protocol with more than methods, which only objects have
        pass
    return isinstance(value, kind)


def elements(field: str, value: Iterable[_Value], allowed: str) -> list[_Value]:
    """Return the elements of a list, tuple, series or other ordered collection, or refuse it by name."""
    try:
        if isinstance(value, str | bytes | Mapping | Set):
            raise TypeError
        return list(value)
    except TypeError:
        raise InputError.of(field, value, allowed) from None


def instances(field: str, value: Iterable[_Value], kind: type, allowed: str) -> tuple[_Value, ...]:
    """Return the elements of a list if all are objects of a kind, or refuse them by name."""
    given = elements(field, value, f"a list, each of it {allowed}")
    return tuple(instance(f"{field}[{position}]", each, kind, allowed) for position, each in enumerate(given))


def fits(field: str, value: npt.ArrayLike, n_agents: int) -> None:
    """Refuse an array that has not one value for each agent; scalars fit always."""
    if np.ndim(value) and np.shape(value) != (n_agents,):
        remedy = "give one number for all agents or one for each"
        raise InputError.of(f"shape of {field}", np.shape(value), f"({n_agents},)", remedy)
