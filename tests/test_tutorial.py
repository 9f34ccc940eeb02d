"""The notebook and the script that are made of the tutorial: their code is the tutorial's."""

import ast
import json
import re
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

from tests.test_docs import DOCS, extension
from tests.test_doctests import BLOCK, files, python_blocks

PAGE = (DOCS / "tutorial.md").read_text(encoding="utf-8")
MADE = extension("tutorial_notebook")
CODE = [cell.source for cell in MADE.cells(PAGE) if cell.kind == "code"]


def test_the_code_is_that_of_the_page_in_its_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plain = [source for source in CODE if ".write_text(" not in source]
    assert plain == [block.source.rstrip() for block in python_blocks(PAGE)]
    for source in CODE:
        if source not in plain:
            exec(source, {})
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == files(PAGE)
    named = [
        block["language"]
        for block in BLOCK.finditer(PAGE)
        if block["language"].startswith(("python", "toml"))
    ]
    assert [".write_text(" in source for source in CODE] == [" " in language for language in named]


def test_notebook_and_script_hold_these_cells() -> None:
    made: dict[str, Any] = json.loads(MADE.notebook(PAGE))
    assert ["".join(cell["source"]) for cell in made["cells"] if cell["cell_type"] == "code"] == CODE
    script = MADE.script(PAGE)
    (guard,) = ast.parse(script).body
    assert isinstance(guard, ast.If)
    assert ast.unparse(guard.test) == "__name__ == '__main__'"
    parts = re.split(r"^# %%", script, flags=re.MULTILINE)[1:]
    assert [dedent(part).strip() for part in parts if not part.startswith(" [markdown]")] == CODE


def test_the_text_leads_to_no_file_that_is_not_there() -> None:
    page = "# A\n\nGet: {download}`it <a.py>`.\n\n[b](c.md#d)\n\n![e](f.png)\n\n```text output\n1\n```\n"
    assert MADE.cells(page) == [("markdown", "# A\n\nb")]
    assert MADE.cells("```console\n$ ls\n```\n") == [("markdown", "```console\n$ ls\n```")]
