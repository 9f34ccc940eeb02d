"""Docstrings of what is public say everything: each parameter of each signature, and what comes back.

Public is what the faces of the package hand out, what the pages of the API list, and the models.  Internals
have a sentence.
"""

import ast
import enum
import functools
import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, get_type_hints

import click
import pandas as pd
from matplotlib.figure import Figure

import aimd_des
import models
from aimd_des import Simulation
from aimd_des.lowlevel import Run
from aimd_des.theory import Convergence
from aimd_des.utils.docstrings import described_like
from tests.test_public_names import FACES, TOP

MODULES = sorted(
    {"models"}
    | {
        info.name
        for package in (aimd_des, models)
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not info.name.endswith("__main__")
    }
)

#: What annotations name that is imported where types are checked alone.
LATER = {
    "Figure": Figure,
    "pd": pd,
    "Convergence": Convergence,
    "Run": Run,
    "Simulation": Simulation,
}


API = Path(__file__).resolve().parents[1] / "docs" / "api"


def meant(name: str) -> object:
    """What a dotted name means, its module imported."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            thing: object = importlib.import_module(".".join(parts[:count]))
        except ImportError:
            continue
        return functools.reduce(getattr, parts[count:], thing)
    raise ImportError(name)


@functools.cache
def public() -> set[int]:
    """The identities of everything that is promised to users, with the classes that they inherit from."""
    names = {f"aimd_des.{face}.{name}" for face in FACES for name in FACES[face].split()}
    names |= {f"aimd_des.{name}" for name in TOP.split()}
    for page in API.glob("*.rst"):
        names.update(re.findall(r"^(?:\.\. auto\w+::| ) +(aimd_des[\w.]+)$", page.read_text(), re.MULTILINE))
    things = [inspect.unwrap(thing) if callable(thing) else thing for thing in map(meant, sorted(names))]
    return {id(base) for thing in things for base in (thing.__mro__ if isinstance(thing, type) else (thing,))}


def sections(docstring: str | None) -> dict[str, list[str]]:
    """Split a NumPy docstring: the lines below each underlined heading."""
    lines = inspect.cleandoc(docstring or "").splitlines()
    found: dict[str, list[str]] = {}
    current: list[str] = []
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if line and re.fullmatch("-{3,}", following):
            current = found.setdefault(line, [])
        else:
            current.append(line)
    return found


def documented(docstring: str | None, *headings: str) -> set[str]:
    """Names that stand in the sections: `a, b : type` and `*args` without its stars."""
    lines = (line for heading in headings for line in sections(docstring).get(heading, ()))
    entries = (line.split(" : ")[0] for line in lines if line and not line.startswith((" ", "-")))
    return {name.strip().lstrip("*") for entry in entries for name in entry.split(",")}


def parameters(thing: Callable[..., Any]) -> set[str]:
    """Names in the signature, without `self`, `cls` and what is private."""
    return {
        name
        for position, name in enumerate(inspect.signature(thing).parameters)
        if not name.startswith("_") and not (position == 0 and name in {"self", "cls"})
    }


def compare(name: str, wanted: set[str], found: set[str]) -> Iterator[str]:
    yield from (f"{name}: parameter {missing!r} is not documented" for missing in sorted(wanted - found))
    yield from (f"{name}: documents {stale!r}, which it does not take" for stale in sorted(found - wanted))


def function_gaps(
    name: str, function: Callable[..., Any], inherited: set[str] | None = None
) -> Iterator[str]:
    """What the docstring of a function or method leaves out; `inherited` is documented with its class."""
    text = function.__doc__
    if not text:
        yield f"{name}: no docstring"
        return
    wanted = parameters(function)
    yield from compare(
        name, wanted, documented(text, "Parameters", "Other Parameters") | (wanted & (inherited or set()))
    )
    # Modules that are slow to import are there for type checkers alone.
    returned = get_type_hints(function, localns=LATER).get("return", type(None))
    if returned is not type(None) and not {"Returns", "Yields"} & set(sections(text)):
        yield f"{name}: no Returns"


def class_parameters(cls: type) -> set[str]:
    """What the constructor takes; nothing for classes that are not constructed by our own signature."""
    own = any(
        "__init__" in vars(base) for base in cls.__mro__[:-1] if base.__module__ not in {"builtins", "typing"}
    )
    if not own or issubclass(cls, enum.Enum) or getattr(cls, "_is_protocol", False):
        return set()
    return parameters(cls)


def described_fields(cls: type) -> set[str]:
    """Fields of a pydantic model that are described where they are declared."""
    fields = getattr(cls, "model_fields", {})
    return {name for name, field in fields.items() if getattr(field, "description", None)}


@functools.cache
def contracts() -> list[type]:
    """Protocols: what a class owes to one is described there, once for all classes."""
    return [
        thing
        for name in MODULES
        for thing in vars(importlib.import_module(name)).values()
        if isinstance(thing, type) and thing.__module__ == name and getattr(thing, "_is_protocol", False)
    ]


def owed(cls: type) -> set[str]:
    """Methods that a base or a contract asks for: what they take and return is said there."""
    found = {name for base in cls.__mro__[1:-1] for name in vars(base)}
    for contract in contracts():
        names = {name for name in {*vars(contract), *contract.__annotations__} if not name.startswith("_")}
        found |= names if all(hasattr(cls, name) for name in names) else set()
    return found


def class_gaps(name: str, cls: type) -> Iterator[str]:
    """What the docstrings of a class and of its own public methods leave out."""
    if not cls.__doc__:
        yield f"{name}: no docstring"
        return
    listed = documented(cls.__doc__, "Parameters", "Other Parameters")
    # A base alone has no readers: the class that inherits from it may say what its fields mean.
    heirs = [heir.__doc__ for heir in cls.__subclasses__() if heir.__doc__]
    known = listed.union(*(documented(text, "Attributes") for text in [cls.__doc__, *heirs]))
    if not issubclass(cls, BaseException):  # the exceptions take the one message that all exceptions take
        wanted = class_parameters(cls)
        # What a run hands out lists its fields as attributes.
        yield from compare(name, wanted, listed | (wanted & (known | described_fields(cls))))
    for key, member in vars(cls).items():
        if key.startswith("_") and key != "__call__":
            continue
        is_property = isinstance(member, property)
        function = member.fget if is_property else inspect.unwrap(getattr(member, "__func__", member))
        if not inspect.isfunction(function):
            continue
        one_line = "\n" not in (function.__doc__ or "\n").strip()
        if getattr(cls, "_is_protocol", False) and (one_line or key in known):
            continue  # a contract says it in a sentence
        if function.__doc__ and not is_property and key in owed(cls):
            continue
        if is_property:
            if not function.__doc__ and key not in known:
                yield f"{name}.{key}: no docstring"
        else:
            yield from function_gaps(f"{name}.{key}", function, listed)


def command_gaps(name: str, command: click.Command) -> Iterator[str]:
    """A command is documented for those who type it: by its help and by that of its options."""
    if not command.help:
        yield f"{name}: no help"
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not parameter.help:
            yield f"{name}: option {parameter.opts[0]} has no help"
    if isinstance(command, click.Group):
        for key, inner in command.commands.items():
            yield from command_gaps(f"{name} {key}", inner)


def gaps(module: ModuleType) -> list[str]:
    """What the docstrings of a module leave out."""
    found = [] if module.__doc__ else [f"{module.__name__}: no docstring"]
    for key, thing in vars(module).items():
        # A command is an object of click's; what it does is a function of ours.
        home = getattr(thing.callback if isinstance(thing, click.Command) else thing, "__module__", None)
        if key.startswith("_") or home not in {module.__name__, None}:
            continue
        name = f"{module.__name__}.{key}"
        function = getattr(thing, "py_func", thing)  # what numba compiled
        promised = id(thing) in public() or module.__name__.split(".")[0] != "aimd_des"
        if isinstance(thing, click.Command):
            found += command_gaps(name, thing)
        elif not promised:
            described = thing.__doc__ or not (inspect.isclass(thing) or inspect.isfunction(function))
            found += [] if described else [f"{name}: no docstring"]
        elif inspect.isclass(thing):
            found += class_gaps(name, thing)
        elif inspect.isfunction(function):
            found += function_gaps(name, inspect.unwrap(function))
    return found


def test_docstrings_are_complete() -> None:
    assert [gap for name in MODULES for gap in gaps(importlib.import_module(name))] == []


def repeated(docstring: str | None) -> list[str]:
    """Texts that several entries of a docstring have: they are one entry, or say what differs."""
    entries = re.findall(
        r"^\S.* : .*\n((?:    .*(?:\n|$))+)", inspect.cleandoc(docstring or ""), re.MULTILINE
    )
    texts = [" ".join(text.split()) for text in entries]
    return sorted({text for text in texts if texts.count(text) > 1})


def test_no_two_parameters_have_one_text() -> None:
    found = [
        f"{path.name}: {text}"
        for package in (aimd_des, models)
        for path in sorted(Path(package.__path__[0]).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
        for text in repeated(ast.get_docstring(node))
    ]
    assert found == []
    assert repeated(_full.__doc__) == []
    assert repeated("a : int\n    One.\nb, c : int\n    One.\nd : int\n    Two.") == ["One."]


class _Fake:
    """A class.

    Parameters
    ----------
    first, second : int
        Two numbers.
    """

    def __init__(self, first: int, second: int, third: int) -> None:
        """Take three."""

    def method(self, first: int) -> int:
        """Do."""
        return first

    @property
    def size(self) -> int:
        return 0


def test_what_docstrings_share_is_said_once() -> None:
    @described_like(_full)
    def own(options: int, first: int, second: int = 0) -> int:
        """Take away.

        Parameters
        ----------
        second : int
            Two.

        Notes
        -----
        Below 0, too.
        """
        return options - first - second

    parameters = "first : int\n    One - and a line\n    of more.\nsecond : int\n    Two."
    rest = "Returns\n-------\nint\n    The sum.\n\nNotes\n-----\nBelow 0, too."
    assert own.__doc__ == f"Take away.\n\nParameters\n----------\n{parameters}\n\n{rest}"


class _Rule(Protocol):
    """A protocol."""

    def method(self, first: int) -> int:
        """Do."""
        ...


def _full(first: int, *rest: int, **options: int) -> int:
    """Add.

    Parameters
    ----------
    first : int
        One - and a line
        of more.
    *rest : int
        More.
    **options
        Any.

    Returns
    -------
    int
        The sum.
    """
    return first + sum(rest) + sum(options.values())


def _stale(first: int) -> None:
    """Add.

    Parameters
    ----------
    second : int
        Was here once.
    """


def test_what_is_left_out_is_found() -> None:
    assert list(function_gaps("full", _full)) == []
    assert list(function_gaps("stale", _stale)) == [
        "stale: parameter 'first' is not documented",
        "stale: documents 'second', which it does not take",
    ]
    assert list(class_gaps("fake", _Fake)) == [
        "fake: parameter 'third' is not documented",
        "fake.method: no Returns",
        "fake.size: no docstring",
    ]
    assert list(class_gaps("rule", _Rule)) == []
    assert list(function_gaps("none", lambda: None)) == ["none: no docstring"]
    bare = click.Command("bare", params=[click.Option(["--seed"])], callback=_full)
    expected = ["bare: no help", "bare: option --seed has no help"]
    assert list(command_gaps("bare", bare)) == expected
    module = ModuleType(__name__, "A module.")
    vars(module)["bare"] = bare
    assert gaps(module) == [f"{__name__}.{line}" for line in expected]
