"""Faces that import what is asked of them only then, since much of it is slow to import."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def on_demand(face: str, home: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a face, by the module below it where each name lives.

    No name may be that of a module: where this was imported, Python gives it in place of the name.
    """

    def get(name: str) -> Any:
        if name in home:
            return getattr(import_module(f"{face}.{home[name]}"), name)
        raise AttributeError(f"module {face!r} has no attribute {name!r}")

    return get, lambda: sorted(home)
