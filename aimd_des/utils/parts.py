"""The registry of parts: all that files name by a kind is entered here, ours and the user's alike.

It is imported by every module that has such a part, and imports nothing that takes time.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

__all__ = [
    "GROUPS",
    "MODEL",
    "REGISTERED",
    "Registered",
    "built_in",
    "enter",
    "keys_of",
    "part",
    "registered",
]

_Make = TypeVar("_Make", bound=Callable[..., Any])

#: The groups of parts, each with the methods that the framework calls.
GROUPS: dict[str, tuple[str, ...]] = {
    "control_unit": ("process",),
    "latency": ("check", "draw"),
    "loss": ("start",),
    "network": (),
    "averaging": ("parameters",),
    "response": ("parameters",),
    "compensation": ("parameters",),
    "intervention": ("check", "process"),
    "costs": ("value", "gradient", "hessian"),
}

#: Models are registered too, by a decorator of their own.
MODEL = "model"

_HOLDS = "numbers, strings, booleans, lists, tables, arrays, and a path that is called `path`"


@dataclass(frozen=True, eq=False)
class Registered:
    """A class or function that files can name."""

    group: str  # one of `GROUPS`, or "model"
    name: str  # what `kind` says: a word for ours, module and class for others
    make: Callable[..., Any]  # the class or function
    # What holds in a file where `make` asks for a value.
    defaults: Mapping[str, Any] = field(default_factory=dict)


#: Annotations of arrays in any form: the second is one flat union, of which the first is no member.
ARRAY_LIKE = (npt.ArrayLike, npt.ArrayLike | None)

#: By the module, and by the name in it.
REGISTERED: dict[str, dict[str, Registered]] = {}


def part(group: str) -> Callable[[_Make], _Make]:
    """Register a class, or a function that makes an object, so that files can name it.

    A scenario or study file names it by module and class, as in ``kind = "my_module.LogLogistic"``.
    Its keys there are the parameters of the constructor, and what they mean is read from its docstring.

    Parameters
    ----------
    group : str
        What it is: "latency", "loss", "control_unit", "network", "averaging", "response",
        "compensation", "intervention" or "costs".

    Returns
    -------
    callable
        A decorator, which gives back what it decorates.

    Raises
    ------
    InputError
        If there is no such group, a method is missing that the group needs, or a file cannot hold a
        parameter.

    Examples
    --------
    >>> @part("latency")
    ... class Fixed:
    ...     def __init__(self, value: float) -> None:
    ...         self.value = value
    Traceback (most recent call last):
    aimd_des.InputError: part Fixed = 'latency': must be a class with check() and draw()
    """
    validation.known("group of a part", group, GROUPS)

    def register(make: _Make) -> _Make:
        _check(group, make)
        enter(make.__qualname__, Registered(group, f"{make.__module__}.{make.__qualname__}", make))
        return make

    return register


def built_in(group: str, name: str, **defaults: Any) -> Callable[[_Make], _Make]:
    """Register a part of the framework under a word; `defaults` hold in files only."""

    def register(make: _Make) -> _Make:
        enter(make.__qualname__, Registered(group, name, make, defaults))
        return make

    return register


def enter(own: str, thing: Registered) -> None:
    """Put something into the registry under its name in its module, in the place of what had it before."""
    REGISTERED.setdefault(thing.make.__module__, {})[own] = thing


def registered(group: str) -> Iterator[Registered]:
    """Yield what is registered in a group, in the order in which it was."""
    for module in REGISTERED.values():
        yield from (thing for thing in module.values() if thing.group == group)


def keys_of(make: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Give the parameters that stand in files, with their types: those that begin with no underscore."""
    try:
        signature = inspect.signature(make, eval_str=True)
    except (NameError, AttributeError, SyntaxError, TypeError) as error:
        raise InputError(f"{_word(make)}: an annotation of its parameters cannot be read ({error})") from None
    return {name: given for name, given in signature.parameters.items() if not name.startswith("_")}


def _word(make: Callable[..., Any]) -> str:
    return str(getattr(make, "__qualname__", make))


def _check(group: str, make: Any) -> None:
    """Refuse what no file could name or describe."""
    if not callable(make) or not hasattr(make, "__qualname__"):
        raise InputError.of(f"part of group {group}", make, "a class, or a function that makes an object")
    word = f"part {_word(make)}"
    if "<locals>" in make.__qualname__:
        raise InputError.of(word, make.__qualname__, "at the top level of its module")
    methods = GROUPS[group]
    if inspect.isclass(make) and not all(callable(getattr(make, name, None)) for name in methods):
        needed = " and ".join(f"{name}()" for name in methods)
        raise InputError.of(word, group, f"a class with {needed}")
    for name, given in keys_of(make).items():
        _check_key(f"parameter {name!r} of {_word(make)}", name, given)


def _check_key(word: str, name: str, given: inspect.Parameter) -> None:
    if name == "kind":
        raise InputError(f"{word}: must have another name, which `kind` in a file would hide; rename it")
    if given.kind in (given.POSITIONAL_ONLY, given.VAR_POSITIONAL, given.VAR_KEYWORD):
        raise InputError.of(word, str(given), "one that can be given by its name")
    if not _held_by_files(given.annotation) or (name != "path" and Path in _leaves(given.annotation)):
        raise InputError.of(word, str(given), f"of a type that a file holds: {_HOLDS}")
    if not _is_data(given.default) and given.default is not given.empty:
        raise InputError.of(word, str(given), f"with a default that a file holds: {_HOLDS}")


def _held_by_files(hint: Any) -> bool:
    """Tell whether a file can hold every value of a type."""
    if hint in (Any, inspect.Parameter.empty, bool, int, float, str, Path, None, NoneType, list, dict):
        return True
    if hint is np.ndarray or hint in ARRAY_LIKE or get_origin(hint) is np.ndarray:
        return True
    arguments = [argument for argument in get_args(hint) if argument is not ...]
    if get_origin(hint) is Literal:
        return all(isinstance(argument, str | int) for argument in arguments)
    containers = (Union, UnionType, list, tuple, dict, Sequence, Mapping)
    return get_origin(hint) in containers and all(map(_held_by_files, arguments))


def _leaves(hint: Any) -> set[Any]:
    return {hint}.union(*map(_leaves, get_args(hint))) if get_origin(hint) is not Literal else set()


def _is_data(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_data, value))
    if isinstance(value, Mapping):
        return all(map(_is_data, value.values()))
    return value is None or isinstance(value, bool | int | float | str | Path | np.ndarray | np.generic)
