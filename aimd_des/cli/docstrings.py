"""What is read from docstrings: the first line, and what each parameter means."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import Parameter, cleandoc, signature
from typing import Any

__all__ = ["Described", "Meaning", "described", "first_line"]

_HEADING = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
_ENTRY = re.compile(r"^(\w[\w, ]*)( : .*)?$")


@dataclass(frozen=True)
class Meaning:
    """A parameter.

    Attributes
    ----------
    name : str
        How it is called.
    default : object
        Its value unless given; `inspect.Parameter.empty` where it must be.
    meaning : str
        What its docstring says, in one line.
    """

    name: str
    default: Any
    meaning: str

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is Parameter.empty


@dataclass(frozen=True)
class Described:
    """Something with a name that takes parameters.

    Attributes
    ----------
    name : str
        How it is called where it is used.
    meaning : str
        The first line of its docstring.
    parameters : tuple of Meaning
        What it takes.
    """

    name: str
    meaning: str
    parameters: tuple[Meaning, ...] = ()


def described(name: str, thing: Callable[..., Any]) -> Described:
    """Describe a function or a class by its signature and its docstring.

    Parameters
    ----------
    name : str
        How it is called where it is used.
    thing : callable
        With a docstring in NumPy's convention.

    Returns
    -------
    Described
        Without parameters that begin with an underscore.
    """
    text = cleandoc(thing.__doc__ or "")
    meanings = _meanings(text)
    parameters = tuple(
        Meaning(key, parameter.default, meanings.get(key, ""))
        for key, parameter in signature(thing).parameters.items()
        if not key.startswith("_")
    )
    return Described(name, first_line(text), parameters)


def first_line(docstring: str | None) -> str:
    """Take the first line of a docstring.

    Parameters
    ----------
    docstring : str or None
        As it stands in the source.

    Returns
    -------
    str
        Without the full stop; empty where there is none.
    """
    return cleandoc(docstring or "").partition("\n")[0].rstrip(".")


def _meanings(text: str) -> Mapping[str, str]:
    """Read what parameters mean: the indented lines below their names, up to a blank line."""
    parts = _HEADING.split(text)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    found: dict[str, str] = {}
    names: list[str] = []
    for line in [*sections.get("Parameters", "").splitlines(), *sections.get("Attributes", "").splitlines()]:
        if entry := _ENTRY.match(line):
            names = [name.strip() for name in entry[1].split(",")]
        elif line.startswith(" "):
            for name in names:
                found[name] = f"{found.get(name, '')} {line.strip()}".strip()
    return {name: meaning.rstrip(".") for name, meaning in found.items()}
