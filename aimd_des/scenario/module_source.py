"""Modules looked up and read as text: nothing of them, nor of the packages they are in, is run."""

import ast
import sys
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from pkgutil import get_importer, iter_modules


def source_of(name: str) -> str | None:
    """Read the source of a module."""
    spec = _spec(name)
    if spec is None:
        return None
    read = getattr(spec.loader, "get_source", None)  # a folder without a file has no loader
    return (read(spec.name) if read else None) or ""


def _spec(name: str) -> ModuleSpec | None:
    """Find a module; `importlib.util.find_spec` would import the packages that it is in."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    top, *rest = name.split(".")
    if not all(part.isidentifier() for part in (top, *rest)):
        return None
    try:
        spec = find_spec(top)
    except ValueError:  # a module without a specification, such as the program itself
        return None
    for part in rest:
        if spec is None:
            return None
        spec = _inside(spec, part)
    return spec


def _inside(package: ModuleSpec, part: str) -> ModuleSpec | None:
    """Find a module in a package; a folder without a file of its own may be in several places."""
    name = f"{package.name}.{part}"
    portions: list[str] = []
    for place in package.submodule_search_locations or ():
        importer = get_importer(place)
        found = importer.find_spec(name) if importer else None
        if found is not None and found.loader is not None:
            return found
        portions += (found.submodule_search_locations or ()) if found else ()
    if not portions:
        return None
    spec = ModuleSpec(name, None, is_package=True)
    spec.submodule_search_locations = portions
    return spec


def modules_in(package: str = "") -> list[str]:
    """Name the modules of a package, or those of the working directory."""
    spec = _spec(package) if package else None
    places = (spec.submodule_search_locations or ()) if spec else () if package else (str(Path.cwd()),)
    return sorted(info.name for info in iter_modules(places, f"{package}." if package else ""))


# Each group of parts is asked for by itself, and all look through the same modules.
@lru_cache(maxsize=256)
def decorated(source: str, decorators: frozenset[str]) -> tuple[str, ...]:
    """Name the functions and classes at the top level of a module that have one of some decorators."""
    tree = ast.parse(source)
    meant = dict(_imported(tree, decorators))
    return tuple(
        dict.fromkeys(
            definition.name
            for definition in _definitions(tree)
            if any(_dotted(mark, meant) in decorators for mark in definition.decorator_list)
        )
    )


def _imported(tree: ast.Module, wanted: frozenset[str]) -> Iterator[tuple[str, str]]:
    """Say what the names mean that a module takes from others."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                top = alias.name.partition(".")[0]
                yield (alias.asname, alias.name) if alias.asname else (top, top)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            for alias in node.names:
                if alias.name == "*":
                    names = (name.rpartition(".") for name in wanted)
                    yield from ((last, f"{home}.{last}") for home, _, last in names if home == node.module)
                else:
                    yield alias.asname or alias.name, f"{node.module}.{alias.name}"


def _definitions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Yield the functions and classes that running a module may define in it: also below an if or a try."""
    left: list[ast.AST] = [tree]
    for node in left:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node
        elif not isinstance(node, ast.AsyncFunctionDef | ast.expr):
            left.extend(ast.iter_child_nodes(node))


def _dotted(node: ast.expr, meant: dict[str, str]) -> str:
    """Write a name, or that of what is called, with the module that it comes from; empty if it is none."""
    parts: list[str] = []
    node = node.func if isinstance(node, ast.Call) else node
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([meant.get(node.id, node.id), *reversed(parts)]) if isinstance(node, ast.Name) else ""
