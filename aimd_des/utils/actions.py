"""What upper wings do for objects of lower ones, which import none of them.

The package itself, which knows all wings, registers each under a word; its module is imported when it is
asked for.
"""

from importlib import import_module
from typing import Any

_PLACES: dict[str, tuple[str, str]] = {}


def register(word: str, module: str, name: str) -> None:
    """Say which function or class a word stands for."""
    _PLACES[word] = module, name


def registered(word: str) -> Any:
    """Import what a word stands for."""
    module, name = _PLACES[word]
    return getattr(import_module(module), name)
