"""What holds of the files themselves: nothing of one machine, nothing half done, nothing too long."""

import ast
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

MODULE_LINES = 500
FUNCTION_LINES = 60  # without the docstring

# Patterns are written so that they do not match themselves.
MACHINE = re.compile(
    r"(?<![\w.~-])/(?:[w]ork|[r]oot|[h]ome/\w+|[U]sers/\w+|[t]mp/\w+)\b(?=[/\s\"'`)]|$)", re.MULTILINE
)
UNFINISHED = re.compile(r"\b(?:[T]ODO|[F]IXME|[X]XX)\b")
INDEX = re.compile(r"[i]ndex-url|[f]ind-links[ =]|[t]rusted-host[ =]")
# Files of Python in the pages about the sources; modules, and things in them, in comments of the sources.
SOURCE = re.compile(r"`([\w./-]+\.py)`")
PLACE = re.compile(r"(?<!`)`(aimd_des(?:\.\w+)+|[a-z_]+\.[A-Z]\w*)`")
LINK = re.compile(r"[a-z]+://([^/\s\"'`<>)\]}]+)")

# This machine, a name that a program puts together, and one that a test lets nobody in by.
NO_READERS = ("127.0.0.1", "localhost", "{", "evil.example")

# Where links may lead: to what a reader should read. Package registries have no place here.
HOSTS = {
    "arxiv.org",
    "doi.org",
    "github.com",
    "ieeexplore.ieee.org",
    "json-schema.org",
    "inet.omnetpp.org",
    "keepachangelog.com",
    "matplotlib.org",
    "networkx.org",
    "numba.readthedocs.io",
    "numpy.org",
    "numpydoc.readthedocs.io",
    "omnetpp.org",
    "pandas.pydata.org",
    "scipy.org",
    "semver.org",
    "simpy.readthedocs.io",
    "toml.io",
    "www.control.lth.se",
    "www.nsnam.org",
    "www.salabim.org",
    "www.w3.org",
}


def files_of_the_project() -> list[Path]:
    """All files that git tracks or would track; without git, all but caches and what make makes."""
    if shutil.which("git") and (ROOT / ".git").exists():
        command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
        paths = [ROOT / name for name in listed.split("\0") if name]
    else:
        hidden = {
            ".venv",
            ".git",
            "__pycache__",
            "build",
            "dist",
            "results",
            "_build",
            "_examples",
            "gallery",
        }
        paths = [path for path in ROOT.rglob("*") if not hidden & set(path.relative_to(ROOT).parts)]
        paths = [path for path in paths if not any(part.endswith("_cache") for part in path.parts)]
    return sorted(path for path in paths if path.is_file())


def texts() -> dict[str, str]:
    """Name and content of all files that are text."""
    contents = {str(path.relative_to(ROOT)): path.read_bytes() for path in files_of_the_project()}
    return {name: raw.decode("utf-8") for name, raw in contents.items() if b"\0" not in raw}


def findings(pattern: re.Pattern[str], contents: dict[str, str]) -> list[str]:
    return [
        f"{name}:{content.count(chr(10), 0, match.start()) + 1}: {match.group()}"
        for name, content in contents.items()
        for match in pattern.finditer(content)
    ]


def strange_hosts(contents: dict[str, str]) -> list[str]:
    hosts = [(found, found.split("://")[1]) for found in findings(LINK, contents)]
    return [found for found, host in hosts if host not in HOSTS and not host.startswith(NO_READERS)]


def lost_places(contents: dict[str, str]) -> list[str]:
    """Files that the map or the design names, and places that a comment names, which are not there."""
    modules: dict[str, set[str]] = {}
    for name, content in contents.items():
        if name.startswith("aimd_des/") and name.endswith(".py"):
            path = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
            for known in (path, path.rpartition(".")[2]):
                modules.setdefault(known, set()).update(re.findall(r"\w+", content))
    lost = []
    for name, content in contents.items():
        if name in ("CONTRIBUTING.md", "docs/design.md"):
            files = [file for file in SOURCE.findall(content) if "NAME" not in file]
            lost += [
                file for file in files if not any(f"/{there}".endswith(f"/{file}") for there in contents)
            ]
        elif name.startswith("aimd_des/"):
            for place in PLACE.findall(content):
                module, _, inside = place.rpartition(".")
                if place not in modules and inside not in modules.get(module, set()):
                    lost.append(f"{name}: {place}")
    return lost


def too_long(source: str, name: str) -> list[str]:
    """The module if it is too long, and every function whose code is."""
    long = [f"{name}: {lines} lines"] if (lines := len(source.splitlines())) > MODULE_LINES else []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or 0) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                length -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            if length > FUNCTION_LINES:
                long.append(f"{name}: {node.name} has {length} lines")
    return long


def project() -> dict[str, object]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_constraints_name_versions_and_no_address() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if "://" in line or " @ " in line] == []
    pins = [line for line in lines if line and not line.lstrip().startswith("#")]
    assert [line for line in pins if not re.fullmatch(r"[a-z0-9-]+==[\w.]+", line)] == []


def test_constraints_pin_every_dependency() -> None:
    pinned = set(
        re.findall(r"^([a-z0-9-]+)==", (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE)
    )
    table = project()["project"]
    assert isinstance(table, dict)
    wanted = [
        *table["dependencies"],
        *(item for extra in table["optional-dependencies"].values() for item in extra),
    ]
    names = {re.split(r"[<>=\[; ]", item)[0] for item in wanted} - {table["name"]}
    assert names - pinned == set()


def test_every_dependency_is_bounded_on_both_sides() -> None:
    table = project()["project"]
    assert isinstance(table, dict)
    wanted = [
        *table["dependencies"],
        *(item for extra in table["optional-dependencies"].values() for item in extra),
    ]
    bounded = re.compile(r"[a-z0-9-]+>=[\d.]+,<\d+")
    assert [
        item for item in wanted if not bounded.fullmatch(item) and not item.startswith(table["name"])
    ] == []


def test_the_wheel_has_one_top_level_name() -> None:
    tool = project()["tool"]
    assert isinstance(tool, dict)
    assert tool["hatch"]["build"]["targets"]["wheel"] == {"packages": ["aimd_des"]}


def test_every_folder_of_the_project_is_in_the_sdist() -> None:
    tool = project()["tool"]
    assert isinstance(tool, dict)
    included = set(tool["hatch"]["build"]["targets"]["sdist"]["include"])
    tops = {f"/{path.relative_to(ROOT).parts[0]}" for path in files_of_the_project()}
    # Hatchling adds these by itself, or they are of no use outside a checkout.
    assert tops - included - {"/pyproject.toml", "/PKG-INFO"} == set()


def test_no_file_holds_a_path_of_one_machine() -> None:
    assert findings(MACHINE, texts()) == []


def test_no_file_names_a_package_index() -> None:
    # The way to compile the constraints names options that keep addresses out.
    shown = {name: re.sub(r"--no-emit-[\w-]+", "", content) for name, content in texts().items()}
    assert findings(INDEX, shown) == []


def test_links_lead_to_hosts_for_readers() -> None:
    assert strange_hosts(texts()) == [], "a page that readers need? add its host to HOSTS"


def test_nothing_is_half_done() -> None:
    assert findings(UNFINISHED, texts()) == []


def test_what_the_map_and_comments_refer_to_is_there() -> None:
    assert lost_places(texts()) == []


@pytest.mark.parametrize("top", ["aimd_des", "models", "scenarios"])
def test_modules_and_functions_are_short(top: str) -> None:
    long = [
        found
        for path in sorted((ROOT / top).rglob("*.py"))
        for found in too_long(path.read_text(encoding="utf-8"), str(path.relative_to(ROOT)))
    ]
    assert long == []


def test_the_checks_see_what_they_look_for() -> None:
    slash = "/"
    assert findings(MACHINE, {"a": f"see {slash}work/main"}) == ["a:1: /" + "work"]
    assert findings(MACHINE, {"a": f"\n'{slash}root/x' {slash}home/me/x"}) == [
        "a:2: /" + "root",
        "a:2: /" + "home/me",
    ]
    assert findings(MACHINE, {"a": "docs/roots/x and a/rooted/b and ./home/me"}) == []
    assert findings(UNFINISHED, {"a": "TO" + "DO: later"}) == ["a:1: TO" + "DO"]
    assert strange_hosts({"a": "https" + "://packages.example/simple"}) == [
        "a:1: https" + "://packages.example"
    ]
    assert strange_hosts({"a": "https://doi.org/10.1"}) == []
    page, used = (
        "`a/b.py`, `b.py`, `d.py`, `test_NAME.py`",
        "# `b.Yes`, `b.No`, `aimd_des.a.b`, `aimd_des.a.d`",
    )
    there = {"aimd_des/a/b.py": "class Yes: ...", "aimd_des/c.py": used, "CONTRIBUTING.md": page}
    assert lost_places(there) == ["aimd_des/c.py: b.No", "aimd_des/c.py: aimd_des.a.d", "d.py"]
    assert too_long("def f():\n" + "    pass\n" * 60, "a") == ["a: f has 61 lines"]
    assert too_long('def f():\n    """A\n' + "\n" * 60 + '    """\n', "a") == []
    assert too_long("\n" * 501, "a") == ["a: 501 lines"]
