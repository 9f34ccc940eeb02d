"""Every example is run: those in docstrings, and the Python blocks of the README and of the pages in docs.

A block ```` ```text output ```` right after a Python block is what that block prints, and one with the
name of a file, such as ```` ```toml study.toml ````, is saved under that name.
"""

import doctest
import importlib
import io
import pkgutil
import re
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pytest

import aimd_des
import models
from aimd_des.utils.parts import REGISTERED

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(
    info.name
    for package in (aimd_des, models)
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not info.name.endswith("__main__")
)
PAGES = [Path("README.md"), *sorted(path.relative_to(ROOT) for path in (ROOT / "docs").rglob("*.md"))]
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
BLOCK = re.compile(
    r"^(?P<indent> *)```(?P<language>[^\n]*)\n(?P<body>.*?)^(?P=indent)```\s*?$", re.MULTILINE | re.DOTALL
)


class Block(NamedTuple):
    """Source, its first line, and what it is said to print: nothing is said if that is None."""

    line: int
    source: str
    output: str | None


def python_blocks(page: str) -> list[Block]:
    """Every Python block of a page."""
    blocks: list[Block] = []
    end = -1
    for match in BLOCK.finditer(page):
        body = re.sub(f"^{match['indent']}", "", match["body"], flags=re.MULTILINE)
        if match["language"] == "text output":
            assert blocks, "an output before any Python block"
            assert not page[end : match.start()].strip(), f"what stands before the output {body!r}?"
            blocks[-1] = blocks[-1]._replace(output=body)
        elif match["language"] in {"python", "pycon"}:
            blocks.append(Block(page.count("\n", 0, match.start("body")) + 1, body, None))
        end = match.end()
    return blocks


def files(page: str) -> dict[str, str]:
    """The blocks of a page that have the name of a file."""
    found = ((match["language"].split(), match["body"]) for match in BLOCK.finditer(page))
    languages = {"python", "toml"}
    return {words[1]: body for words, body in found if len(words) == 2 and words[0] in languages}


def run_page(page: str, name: str) -> int:
    """Run the blocks of a page in order, in one fresh namespace; return how many there were."""
    namespace: dict[str, object] = {"__name__": "__page__"}
    blocks = python_blocks(page)
    for file, text in files(page).items():
        Path(file).write_text(text, encoding="utf-8")
    for line, source, output in blocks:
        if source.lstrip().startswith(">>>"):
            example = doctest.DocTestParser().get_doctest(source, namespace, name, name, line - 1)
            outcome = doctest.DocTestRunner(optionflags=OPTIONS).run(example, clear_globs=False)
            assert outcome.failed == 0, f"{name}:{line}"
            namespace = example.globs
        else:
            with redirect_stdout(io.StringIO()) as printed:
                # The empty lines let a traceback name the line of the page.
                exec(compile("\n" * (line - 1) + source, name, "exec"), namespace)
            if output is not None:
                same = doctest.OutputChecker().check_output(output, printed.getvalue(), OPTIONS)
                assert same, f"{name}:{line} prints\n{printed.getvalue()}"
    return len(blocks)


@pytest.fixture(autouse=True)
def _in_an_empty_folder_without_a_screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # a page imports the files that it saves
    mpl.use("Agg")
    loaded = set(sys.modules)
    yield
    REGISTERED.pop("__page__", None)  # no other test finds what a page has registered
    for path in tmp_path.glob("*.py"):
        if path.stem not in loaded:
            sys.modules.pop(path.stem, None)


def test_examples_in_docstrings() -> None:
    outcomes = {
        name: doctest.testmod(importlib.import_module(name), extraglobs={"np": np}, optionflags=OPTIONS)
        for name in MODULES
    }
    assert [name for name, outcome in outcomes.items() if outcome.failed] == []
    assert sum(outcome.attempted for outcome in outcomes.values()) > 30


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_examples_in_pages(page: Path) -> None:
    run_page((ROOT / page).read_text(encoding="utf-8"), str(page))


def test_the_readme_shows_python() -> None:
    assert python_blocks((ROOT / "README.md").read_text(encoding="utf-8"))


def test_what_is_printed_is_compared() -> None:
    page = "```python\nprint(1 + 1)\n```\n\n```text output\n{}\n```\n"
    assert run_page(page.format(2), "page") == 1
    with pytest.raises(AssertionError, match="page:2 prints"):
        run_page(page.format(3), "page")
    with pytest.raises(AssertionError, match="what stands before"):
        run_page(page.replace("```\n\n", "```\n\ntext\n").format(2), "page")


def test_blocks_share_a_page_and_a_wrong_one_fails() -> None:
    page = "text\n```python\na = 1\n```\n```text\nnot python\n```\n"
    page += "- item\n  ```python\n  >>> a + 1\n  2\n  ```\n"
    assert run_page(page, "page") == 2
    with pytest.raises(AssertionError, match="page:2"):
        run_page("```python\n>>> 1 + 1\n3\n```\n", "page")
    with pytest.raises(NameError):
        run_page("```python\na\n```\n", "page")


def test_blocks_with_the_name_of_a_file_are_saved_and_not_run() -> None:
    page = "```python\nfrom pathlib import Path\nprint(Path('mine.py').read_text())\n```\n"
    page += "```text output\nx = y\n```\n```python mine.py\nx = y\n```\n"
    assert run_page(page, "page") == 1
    assert Path("mine.py").read_text(encoding="utf-8") == "x = y\n"
