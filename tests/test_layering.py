"""Imports go one way, and SimPy's privates stay in one file: both are read from the source."""

import ast
from collections.abc import Callable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Each module of the framework imports only from those above it. A package counts as one module.
ORDER = [
    "_version",
    "utils",
    "_deprecated",
    "checks",
    "channel",
    "latency",
    "loss",
    "topology",
    "problem",
    "costs",
    "dynamics",
    "averaging",
    "compensation",
    "responses",
    "theory",
    "results",
    "metrics",
    "engine",
    "control_units",
    "synchronous",
    "lowlevel",
    "plots",
    "fleet",
    "interventions",
    "watch",
    "scenario",
    "study",
    "report",
    "live",
    "emulate",
    "cli",
    "__main__",
]

# Whom the files of a folder may import, among the folders of this project.
ALLOWED = {
    "aimd_des": {"aimd_des"},
    "models": {"aimd_des", "models"},
    "scenarios": {"aimd_des", "models", "scenarios"},
}
OURS = {*ALLOWED, "tests", "benchmarks"}

# Read off SimPy 4.1: state of environments, events and processes that no documented interface hands out.
PRIVATES = {
    "_queue",
    "_eid",
    "_now",
    "_active_proc",
    "_value",
    "_ok",
    "_defused",
    "_generator",
    "_target",
    "_resume",
}

FILES = sorted(path.relative_to(ROOT) for top in ALLOWED for path in (ROOT / top).rglob("*.py"))


def imports(tree: ast.Module, path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and full dotted name of everything imported, wherever in the file.

    What is taken from the package itself by a dot (`aimd_des.Problem`) counts as imported.
    """
    package = path.parts[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "aimd_des":
            yield node.lineno, f"aimd_des.{node.attr}"


def wrong_imports(source: str, path: Path) -> list[str]:
    """Every import in `source`, thought to stand at `path`, that goes the wrong way."""
    top = path.parts[0]
    # aimd_des/__init__.py collects the public names: it stands below all modules and above none.
    is_facade = path == Path("aimd_des/__init__.py")
    own = "" if is_facade or top != "aimd_des" else Path(path.parts[1]).stem
    if own and own not in ORDER:
        return [f"{path}: module {own!r} is not in ORDER of tests/test_layering.py: add it where it belongs"]
    wrong = []
    for line, name in imports(ast.parse(source), path):
        target = name.split(".")
        if target[0] not in OURS:
            continue
        if target[0] not in ALLOWED[top]:
            wrong.append(f"{path}:{line}: {top} must not import {name}")
        elif top == target[0] == "aimd_des" and not is_facade:
            module = target[1] if len(target) > 1 else "the package"
            if module not in ORDER:
                wrong.append(f"{path}:{line}: import {name} from the module that defines it")
            elif ORDER.index(module) > ORDER.index(own):
                wrong.append(f"{path}:{line}: {own} stands above {module} and must not import it")
    return wrong


def circle(sources: Mapping[Path, str]) -> list[str]:
    """Modules of which each imports the one before, and the first the last; imports for types alone count."""
    modules = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): path for path in sources}

    def module_of(name: str) -> str:
        while name and name not in modules:
            name = name.rpartition(".")[0]
        return name

    imported = {
        module: {module_of(name) for _, name in imports(ast.parse(sources[path]), path)} - {"", module}
        for module, path in modules.items()
    }
    try:
        TopologicalSorter(imported).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def classes_on_simpy(tree: ast.Module) -> set[ast.ClassDef]:
    """Classes whose base is written with a name that comes from simpy."""
    names = {
        alias.asname or alias.name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
        if (node.module or "" if isinstance(node, ast.ImportFrom) else alias.name).split(".")[0] == "simpy"
    }
    return {
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        and any(
            isinstance(part, ast.Name) and part.id in names for base in node.bases for part in ast.walk(base)
        )
    }


def simpy_privates(source: str, path: Path) -> list[str]:
    """Every use of SimPy's private names in `source`, thought to stand at `path`."""
    if path == Path("aimd_des/engine/environment.py"):
        return []
    tree = ast.parse(source)
    # `self._value` is our own business, except in a class that is a SimPy event itself.
    own = {
        id(node)
        for cls in {node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
        - classes_on_simpy(tree)
        for node in ast.walk(cls)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in {"self", "cls"}
    }
    wrong = [
        f"{path}:{node.lineno}: .{node.attr} is private to SimPy: ask environment.py for it"
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and node.attr in PRIVATES and id(node) not in own
    ]
    for line, name in imports(tree, path):
        parts = name.split(".")
        if parts[0] == "simpy" and any(part.startswith("_") for part in parts):
            wrong.append(f"{path}:{line}: {name} is private to SimPy")
    return wrong


def test_the_list_names_each_module_once() -> None:
    assert len(set(ORDER)) == len(ORDER)
    assert FILES


@pytest.mark.parametrize("find", [wrong_imports, simpy_privates])
def test_all_files_keep_to_it(find: Callable[[str, Path], list[str]]) -> None:
    found = [line for path in FILES for line in find((ROOT / path).read_text(encoding="utf-8"), path)]
    assert found == []


def test_no_files_import_each_other_in_a_circle() -> None:
    assert circle({path: (ROOT / path).read_text(encoding="utf-8") for path in FILES}) == []


@pytest.mark.parametrize(
    "sources",
    [
        {"run": "from aimd_des.engine.fork import branch", "fork": "from .run import Run"},
        {
            "run": "from aimd_des.engine.fork import branch",
            "fork": "if TYPE_CHECKING:\n    from aimd_des.engine.run import Run",
        },
        {"run": "def later():\n    from .fork import branch", "fork": "import aimd_des.engine.run"},
        {
            "run": "from .fork import branch",
            "fork": "from .simulation import Simulation",
            "simulation": "from . import run",
        },
        {"__init__": "from aimd_des.engine.run import Run", "run": "from aimd_des.engine import Run"},
    ],
)
def test_a_circle_of_imports_is_found(sources: dict[str, str]) -> None:
    """Within one folder, where the list of modules has no order."""
    found = {Path(f"aimd_des/engine/{name}.py"): source for name, source in sources.items()}
    assert {wrong for path, source in found.items() for wrong in wrong_imports(source, path)} == set()
    assert len(set(circle(found))) == len(sources)


def test_no_two_classes_have_one_name() -> None:
    """Whoever reads a name knows what it is, wherever it stands."""
    homes: dict[str, set[Path]] = {}
    for path in (path for path in FILES if path.parts[0] == "aimd_des"):
        for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, set()).add(path)
    shared = {name: sorted(map(str, paths)) for name, paths in homes.items() if len(paths) > 1}
    # Where results go, which is public, and where an event stands in the queue.
    assert shared.keys() == {"Place"}, shared


def test_files_that_share_another_are_no_circle() -> None:
    sources = {"a": "from .c import C\nfrom .b import B", "b": "from .c import C", "c": "import math"}
    assert circle({Path(f"aimd_des/engine/{name}.py"): source for name, source in sources.items()}) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("aimd_des/utils/errors.py", "from aimd_des.problem import Problem"),
        ("aimd_des/problem/costs/base.py", "from aimd_des import interventions"),
        ("aimd_des/problem/costs/base.py", "from ...results import Result"),
        ("aimd_des/problem/costs/base.py", "def later():\n    import aimd_des.cli"),
        ("aimd_des/problem/costs/base.py", "from aimd_des import Problem"),
        ("aimd_des/cli/main.py", "import aimd_des"),
        ("aimd_des/scenario.py", "import aimd_des.cli"),
        ("aimd_des/cli/main.py", "from models import smart_cameras"),
        ("aimd_des/__init__.py", "import scenarios.paper"),
        ("models/smart_cameras.py", "from scenarios import paper"),
        ("scenarios/paper.py", "from tests.test_layering import ORDER"),
        ("aimd_des/novelty.py", "import math"),
    ],
)
def test_an_import_that_goes_the_wrong_way_is_found(path: str, source: str) -> None:
    assert len(wrong_imports(source, Path(path))) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        (
            "aimd_des/problem/costs/base.py",
            "from aimd_des.utils.validation import number\nfrom aimd_des.utils import errors",
        ),
        ("aimd_des/problem/costs/base.py", "from .polynomial import PolynomialCosts"),
        (
            "aimd_des/problem/__init__.py",
            "from .problem import Problem\nfrom ..utils.errors import InputError",
        ),
        ("aimd_des/__init__.py", "from aimd_des.cli import main"),
        ("aimd_des/cli/main.py", "from aimd_des._version import __version__"),
        ("aimd_des/utils/errors.py", "import numpy"),
        ("models/smart_cameras.py", "from aimd_des import Problem"),
        ("scenarios/paper.py", "from models import smart_cameras\nimport aimd_des.theory"),
    ],
)
def test_an_import_that_goes_the_right_way_is_let_through(path: str, source: str) -> None:
    assert wrong_imports(source, Path(path)) == []


@pytest.mark.parametrize(
    "source",
    [
        "environment._queue.clear()",
        "class Own:\n    def next(self):\n        return self.environment._now",
        "import simpy\nclass Own(simpy.Event):\n    def set(self):\n        self._ok = True",
        "from simpy.events import Event as E\nclass Own(E):\n    def set(self):\n        self._ok = True",
        "from simpy.core import _secret",
    ],
)
def test_a_use_of_simpys_privates_is_found(source: str) -> None:
    assert len(simpy_privates(source, Path("aimd_des/engine/simulation.py"))) == 1
    assert simpy_privates(source, Path("aimd_des/engine/environment.py")) == []


def test_private_names_of_our_own_are_let_through() -> None:
    source = "class Own:\n    def set(self):\n        self._value = 1"
    assert simpy_privates(source, Path("aimd_des/engine/simulation.py")) == []
