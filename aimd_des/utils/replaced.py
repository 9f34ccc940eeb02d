"""The same object but for some of what its constructor took."""

import inspect
from collections.abc import Mapping
from typing import Any, TypeVar

from aimd_des.utils import validation

_Thing = TypeVar("_Thing")


def replaced(thing: _Thing, parts: Mapping[str, Any]) -> _Thing:
    """Make an object anew with other arguments; what is not named is read off its attributes."""
    names = inspect.signature(type(thing)).parameters
    for name in parts:
        validation.known(f"argument of {type(thing).__name__}.replace", name, names)
    return type(thing)(**{**{name: getattr(thing, name) for name in names}, **parts})
