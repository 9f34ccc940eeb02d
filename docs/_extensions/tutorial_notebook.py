"""The tutorial as a notebook and as a script to download, made of `tutorial.md` when the pages are built.

Its blocks of Python become cells, and its named blocks cells that save them as files.  Printed output is left
out, as running the cells prints it.
"""

import json
import re
from pathlib import Path
from textwrap import indent
from typing import Any, NamedTuple

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

#: Where the files are made, as seen from `docs`: the page names them there.
FOLDER = "_build/downloads"

_FENCE = re.compile(r"^```(?P<language>[^\n]*)\n(?P<body>.*?)^```\n", re.MULTILINE | re.DOTALL)
_DOWNLOAD = re.compile(r"^[^\n]*\{download\}.*?\n\n", re.MULTILINE | re.DOTALL)
_IMAGE = re.compile(r"^!\[[^\]]*\]\([^)]*\)$", re.MULTILINE)
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")


class Cell(NamedTuple):
    """Text or code, as in a notebook."""

    kind: str  # "markdown" or "code"
    source: str


def _text(page: str) -> str:
    """Leave out links, images and downloads: they lead to files that are not beside a notebook."""
    return _LINK.sub(r"\1", _IMAGE.sub("", _DOWNLOAD.sub("", page))).strip()


def _saved(name: str, body: str) -> str:
    """Write a named block under its name."""
    imports = "from pathlib import Path\nfrom textwrap import dedent"
    return f"{imports}\n\n_ = Path(\"{name}\").write_text(dedent(r'''\n{body}''').lstrip())"


def cells(page: str) -> list[Cell]:
    """Divide a page into cells; a block of the console stays in the text."""
    found: list[Cell] = []
    text, end = "", 0
    for block in _FENCE.finditer(page):
        language, _, name = block["language"].partition(" ")
        text += page[end : block.start()]
        end = block.end()
        if language == "console":
            text += block.group()
        elif language == "python" or name != "output":
            found.append(Cell("markdown", _text(text)))
            found.append(Cell("code", _saved(name, block["body"]) if name else block["body"].rstrip()))
            text = ""
    found.append(Cell("markdown", _text(text + page[end:])))
    return [cell for cell in found if cell.source]


def notebook(page: str) -> str:
    """Write a page as a notebook, format 4.4."""
    made: list[dict[str, Any]] = [
        {"cell_type": cell.kind, "metadata": {}, "source": cell.source.splitlines(keepends=True)}
        for cell in cells(page)
    ]
    for cell in made:
        if cell["cell_type"] == "code":
            cell.update(execution_count=None, outputs=[])
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 4}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def script(page: str) -> str:
    """Write a page as a script whose text is comments, with the marks by which editors find cells.

    Workers of a study read the script that starts them, so all code is below a guard.
    """
    parts = ['if __name__ == "__main__":  # the workers of the study read this file, too\n']
    for cell in cells(page):
        if cell.kind == "code":
            parts.append(f"# %%\n{indent(cell.source, '    ')}\n")
        else:
            lines = (f"# {line}".rstrip() for line in cell.source.splitlines())
            parts.append("# %% [markdown]\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _make(app: Sphinx) -> None:
    source = Path(app.srcdir)
    page = (source / "tutorial.md").read_text(encoding="utf-8")
    folder = source / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tutorial.ipynb").write_text(notebook(page), encoding="utf-8")
    (folder / "tutorial.py").write_text(script(page), encoding="utf-8")


def setup(app: Sphinx) -> ExtensionMetadata:
    """Make the files before the page that names them is read."""
    app.connect("builder-inited", _make)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
