"""What there is to run: models, scripts and scenario files on the path and in the working directory."""

import ast
import sys
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from aimd_des.cli.docstrings import Described, described, first_line
from aimd_des.errors import InputError

__all__ = ["files", "models", "scripts"]

# Where files of scenarios and studies are looked for.
_FOLDERS = (".", "scenarios")


def models() -> list[Described]:
    """Find the models of the package `models`, and those of modules in the working directory.

    Returns
    -------
    list of Described
        By the names under which scenario files know them.
    """
    from aimd_des.registry import named_model

    found = []
    for name in _modules_with_models():
        try:
            found.append(described(name, named_model(name)))
        except InputError:
            continue  # its decorator is somebody else's
    return found


def _modules_with_models() -> Iterator[str]:
    """Name the modules in whose source something is decorated with `model`; nothing is run to find them."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    for path in sorted(Path().glob("[!_.]*.py")):
        if path.stem.isidentifier() and _registers(path):
            yield path.stem
    spec = find_spec("models")
    for folder in list(spec.submodule_search_locations or []) if spec else []:
        for path in sorted(Path(folder).glob("[!_.]*.py")):
            if path.stem.isidentifier() and _registers(path):
                yield f"models.{path.stem}"


def _registers(path: Path) -> bool:
    tree = _parsed(path)
    decorators = (
        decorator
        for node in (tree.body if tree else [])
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
    )
    return any(ast.unparse(decorator).rpartition(".")[2] == "model" for decorator in decorators)


def _parsed(path: Path) -> ast.Module | None:
    """Read a module, or nothing where it is not one."""
    try:
        return ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError):
        return None


def scripts() -> list[Described]:
    """Find the scripts of the folder `scenarios`.

    Returns
    -------
    list of Described
        How to run each, and the first line of its docstring.
    """
    trees = ((path.stem, _parsed(path)) for path in sorted(Path("scenarios").glob("[!_.]*.py")))
    return [
        Described(f"python -m scenarios.{name}", first_line(ast.get_docstring(tree)))
        for name, tree in trees
        if tree is not None
    ]


def files() -> list[Described]:
    """Find files of scenarios and studies in the working directory and in its folder `scenarios`.

    Returns
    -------
    list of Described
        Paths and titles.
    """
    found = []
    for path in sorted(path for folder in _FOLDERS for path in Path(folder).glob("*.toml")):
        data = _toml(path)
        if "axes" in data:
            found.append(Described(str(path), f"study: {data.get('title', '')}"))
        elif "until" in data:
            found.append(Described(str(path), str(data.get("title", ""))))
    return found


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
