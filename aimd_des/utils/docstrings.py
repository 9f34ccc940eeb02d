"""What several docstrings share: said by one, and shown with all of them."""

import inspect
import re
from collections.abc import Callable
from typing import Any, TypeVar

_Described = TypeVar("_Described", bound=Callable[..., object])


def described_like(model: Callable[..., object]) -> Callable[[_Described], _Described]:
    """Add to a docstring what a model says besides: of parameters, what is returned, what is raised."""
    _, shared = _read(model)

    def complete(described: _Described) -> _Described:
        head, own = _read(described)
        entries = {**_entries(shared), **_entries(own)}
        listed = dict.fromkeys(entries.get(name) for name in inspect.signature(described).parameters)
        own["Parameters"] = "\n".join(filter(None, listed))
        order = dict.fromkeys([*shared, *own])
        found = {name: own.get(name) or shared[name] for name in order}
        parts = [f"{name}\n{'-' * len(name)}\n{text}" for name, text in found.items()]
        described.__doc__ = "\n\n".join([head, *parts])
        return described

    return complete


def _read(described: Any) -> tuple[str, dict[str, str]]:
    """Split a docstring into what stands before its sections, and these."""
    head, *sections = re.split(r"\n\n(?=\w+\n-+\n)", inspect.cleandoc(described.__doc__ or ""))
    parts = (section.split("\n", 2) for section in sections)
    return head, {part[0]: part[2] for part in parts}


def _entries(sections: dict[str, str]) -> dict[str, str]:
    """Find what a section says of each parameter; several may share an entry."""
    entries = re.split(r"\n(?=\S)", sections.get("Parameters", ""))
    return {name.strip(" *"): entry for entry in entries for name in entry.partition(" : ")[0].split(",")}
