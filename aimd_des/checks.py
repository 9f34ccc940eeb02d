"""Checks at the door: each returns the clean value or raises an `InputError` that names the field."""

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from aimd_des.errors import InputError

__all__ = ["FloatArray", "array", "fits", "integer", "number", "per_agent"]

FloatArray = npt.NDArray[np.float64]


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


def _outside(
    values: FloatArray, low: float, high: float, low_open: bool, high_open: bool
) -> npt.NDArray[np.bool_]:
    below = values <= low if low_open else values < low
    above = values >= high if high_open else values > high
    return ~np.isfinite(values) | below | above


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
        The name under which the user gave the value.
    value : object
        What was given.
    low, high, low_open, high_open
        The range.
    remedy : str
        What to do about it.

    Returns
    -------
    float
        Finite.

    Raises
    ------
    InputError
        If it is no real number, not finite, or outside the range.
    """
    allowed = _interval(low, high, low_open, high_open)
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        raise InputError.of(field, value, allowed, remedy)
    try:
        clean = float(value)
    except OverflowError:  # an int beyond the range of floats
        raise InputError.of(field, value, allowed, remedy) from None
    if _outside(np.array(clean), low, high, low_open, high_open):
        raise InputError.of(field, clean, allowed, remedy)
    return clean


def integer(
    field: str, value: object, *, low: int | None = None, high: int | None = None, remedy: str = ""
) -> int:
    """Return `value` as an int within the range, or refuse it by name.

    Parameters
    ----------
    field : str
        The name under which the user gave the value.
    value : object
        What was given.
    low, high : int, optional
        The range.
    remedy : str
        What to do about it.

    Returns
    -------
    int
        Of Python.

    Raises
    ------
    InputError
        If it is no integer (2.0 is none) or outside the range.
    """
    allowed = "an integer"
    if low is not None:
        allowed += f" of at least {low}"
    if high is not None:
        allowed += f"{' and' if low is not None else ''} at most {high}"
    if isinstance(value, bool | np.bool_) or not isinstance(value, Integral):
        raise InputError.of(field, value, allowed, remedy)
    clean = int(value)
    if (low is not None and clean < low) or (high is not None and clean > high):
        raise InputError.of(field, clean, allowed, remedy)
    return clean


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
    field : str
        The name under which the user gave the value.
    value : object
        Anything that NumPy turns into an array of numbers.
    shape : sequence of int or str
        The shape wanted; a string stands for a length that is free and names it in the message.
    low, high, low_open, high_open
        The range of each element.
    remedy : str
        What to do about it.

    Returns
    -------
    ndarray of float64
        A copy that cannot be written to.

    Raises
    ------
    InputError
        If the shape differs, or an element is not finite or outside the range.
    """
    wanted = f"({', '.join(str(length) for length in shape)}{',' if len(shape) == 1 else ''})"
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
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
    field : str
        The name under which the user gave the value.
    value : object
        A number, or an array, list or tuple of numbers.
    low, high, low_open, high_open
        The range of each value.
    remedy : str
        What to do about it.

    Returns
    -------
    float or ndarray, shape (n,)
        Clean.

    Raises
    ------
    InputError
        As `number` and `array` do.
    """
    bounds: _Bounds = {"low": low, "high": high, "low_open": low_open, "high_open": high_open}
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0):
        return array(field, value, ("n_agents",), **bounds, remedy=remedy)
    return number(field, value, **bounds, remedy=remedy)


def fits(field: str, value: npt.ArrayLike, n_agents: int) -> None:
    """Refuse an array that has not one value for each agent; scalars fit always.

    Parameters
    ----------
    field : str
        The name under which the user gave the value.
    value : float or array_like
        What was given.
    n_agents : int
        n.

    Raises
    ------
    InputError
        Naming both lengths.
    """
    if np.ndim(value) and np.shape(value) != (n_agents,):
        remedy = "give one number for all agents or one for each"
        raise InputError.of(f"shape of {field}", np.shape(value), f"({n_agents},)", remedy)
