"""Checks of what parts of one's own hand back, at the place of the call, naming the part's class and method.

What is built in is trusted: these stand where the framework may call a user's part.
"""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import BoolArray, FloatArray

_Kind = TypeVar("_Kind")


def said_by(part: object, method: str = "") -> str:
    """Name what has handed something back: "Class.method()", or "function()"."""
    name = getattr(part, "__qualname__", None) or type(part).__qualname__
    name = name.rpartition("<locals>.")[2]
    return f"{name}.{method}()" if method else f"{name}()"


def check(part: Any, *against: object) -> None:
    """Let a part check its parameters against something; anything that it raises is a refusal."""
    try:
        part.check(*against)
    except InputError:
        raise
    except Exception as error:
        cause = f"{type(error).__name__}: {error}".rstrip(": ")
        raise InputError(f"{said_by(part, 'check')} refuses ({cause})") from error


# How a note on an exception of a part begins.
_RAISED_IN = "raised in "


@contextmanager
def calling(method: str) -> Iterator[None]:
    """Note on what a part raises which method it was; our own exceptions name their cause themselves."""
    try:
        yield
    except (InputError, SimulationError):
        raise
    except Exception as error:
        if raised_in(error) is None:
            error.add_note(f"{_RAISED_IN}{method}")
        raise


def raised_in(error: BaseException) -> str | None:
    """Say in one sentence which part has raised an exception, and what; None if it was no part."""
    notes = getattr(error, "__notes__", ())
    method = next((note[len(_RAISED_IN) :] for note in notes if note.startswith(_RAISED_IN)), None)
    cause = f"{type(error).__name__}: {error}".rstrip(": ")
    return None if method is None else f"{method} raises {cause}"


def named(method: str, process: Generator[Any, Any, Any]) -> Generator[Any, Any, Any]:
    """Run a process of a part, and note on what it raises which method it was."""
    with calling(method):
        return (yield from process)


def flags(field: str, value: object, shape: tuple[int], of: str) -> BoolArray:
    """Take in booleans, or numbers that are 0 or 1."""
    if not (isinstance(value, np.ndarray) and value.dtype == np.bool_):
        try:
            raw = np.asarray(value)
            wrong = raw.dtype.kind not in "biuf" or not np.isin(raw, (0, 1)).all()
        except (TypeError, ValueError):  # nothing of which there is an array
            wrong = True
        if wrong:
            raise InputError.of(field, value, f"an array of booleans, or of 0 and 1, one for each {of}")
        value = raw.astype(np.bool_)
    _fits(field, value, shape, of)
    return value


def numbers(field: str, value: object, shape: tuple[int], of: str, low: float) -> FloatArray:
    """Take in numbers from a lower bound on; inf is one."""
    if not (isinstance(value, np.ndarray) and value.dtype == np.float64):
        try:
            raw = np.asarray(value)
            if raw.dtype.kind not in "iuf":
                raise TypeError
        except (TypeError, ValueError):
            raise InputError.of(field, value, f"an array of numbers, one for each {of}") from None
        value = raw.astype(np.float64)
    _fits(field, value, shape, of)
    if not value.min() >= low:  # a minimum finds NaN, too
        validation.array(field, np.where(value == np.inf, low, value), shape, low=low)
    return value


def _fits(field: str, value: npt.NDArray[np.generic], shape: tuple[int], of: str) -> None:
    if value.shape != shape:
        raise InputError.of(f"shape of {field}", value.shape, f"{shape}, one for each {of}")


def instance(field: str, value: object, kind: type[_Kind], allowed: str) -> _Kind:
    """Take in an object of a kind."""
    if not isinstance(value, kind):
        raise InputError.of(field, value, allowed)
    return value


def having(field: str, value: object, methods: Sequence[str]) -> None:
    """Refuse an object without the methods that will be called."""
    if isinstance(value, type) or not all(callable(getattr(value, method, None)) for method in methods):
        raise InputError.of(field, value, f"an object with {' and '.join(f'{name}()' for name in methods)}")


def attach(part: object, system: object) -> None:
    """Give the run in progress, before anything happens in it, to a part that has a method `attach`."""
    if hasattr(part, "attach"):
        with calling(said_by(part, "attach")):
            part.attach(system)


def generator(field: str, value: object) -> None:
    """Refuse what SimPy cannot run as a process."""
    if not hasattr(value, "throw"):
        remedy = "if it has no events to wait for, end it with `yield from ()`"
        raise InputError.of(field, value, "a generator, which a function with `yield` gives", remedy)
