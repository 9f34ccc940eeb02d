"""Scenarios as examples for sphinx-gallery, which shows them without running them.

A scenario is a study with a command, and takes minutes; its figure is kept in `docs/images`, and its
findings in `docs/findings`.  So each becomes a script for sphinx-gallery: question and answer are its
docstring, then come figure and findings, and its code as it is; of a folder the code of its `study.py`.
Downloads are made here, because scripts of sphinx-gallery hold the page, and its notebooks cannot run:
workers import what they run, and cannot import a notebook.
"""

import ast
import json
import re
import shutil
from base64 import b64encode
from pathlib import Path
from typing import Any, NamedTuple

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.typing import ExtensionMetadata

_HEADER = '''r"""
{title}
{underline}

{answer}

Findings
--------

.. include:: /_examples/findings/{name}.md
   :parser: myst_parser.sphinx_

Code and downloads
------------------

.. code-block:: console

   $ python -m scenarios.{name}                      # in results/{name}
   $ python -m scenarios.{name} --quick --out quick  # a first look, in seconds

Downloads: :download:`script {name}.py </_examples/downloads/{name}.py>` and
:download:`notebook {name}.ipynb </_examples/downloads/{name}.ipynb>`. Save them in the folder of the
project, whose modules they use.
"""

# sphinx_gallery_thumbnail_path = 'images/{name}.png'
'''

_RUN = """from scenarios.{name} import main

main(["--quick", "--out", "quick/{name}", "--overwrite"], standalone_mode=False)
"""
_SHOW = """from pathlib import Path

from IPython.display import Image, display

for figure in sorted(Path("quick/{name}").glob("*.png")):
    display(Image(figure))
"""
_MAIN = """
if __name__ == "__main__":
    main()
"""

_TO_FINDINGS = re.compile(r"\]\(((?:\.\./)*)findings/(\w+)\.md\)")
_TO_ANOTHER = re.compile(r"\]\((\w+)\.md\)")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\([^)]*\)")
_PICTURE = re.compile(r"\]\(\.\./images/([\w.]+)\)")
_NOT_OURS = {"sphx-glr-download-link-note", "sphx-glr-footer"}


class _Scenario(NamedTuple):
    """What the page and the downloads of a scenario are made of."""

    name: str
    title: str  # the question
    answer: str
    findings: str  # Markdown, with links as in `docs/findings`
    source: str  # the module with the code

    @property
    def code(self) -> str:
        """The code below the docstring."""
        end = ast.parse(self.source).body[0].end_lineno
        return "".join(self.source.splitlines(keepends=True)[end:])


def _findings(docs: Path, name: str) -> str:
    """Read the findings, without their title; without any, name the page of the scenario's own."""
    file, own = docs / "findings" / f"{name}.md", docs / f"{name}.md"
    if file.is_file():
        text = file.read_text(encoding="utf-8").partition("\n\n")[2]
        conventions = (docs / "scenarios.md").read_text(encoding="utf-8").partition("## Conventions\n\n")[2]
        return f"{text}\n" + conventions.partition("\n## ")[0]
    if own.is_file():
        title = own.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        figure = f"![Figure of the scenario {name}, explained on its page](../images/{name}.png)"
        return f"{figure}\n\nThey are on a page of their own: [{title}](../{name}.md).\n"
    raise ExtensionError(f"docs/findings/{name}.md: is missing; it holds the findings of the scenario")


def _read(name: str, text: Path, code: Path, docs: Path) -> _Scenario:
    docstring = ast.get_docstring(ast.parse(text.read_text(encoding="utf-8"))) or ""
    title, _, answer = docstring.partition("\n\n")
    return _Scenario(name, title, answer, _findings(docs, name), code.read_text(encoding="utf-8"))


def sources(folder: Path) -> dict[str, tuple[Path, Path]]:
    """Find for each scenario the file with its docstring, and the one with its code: a folder has two."""
    found = {path.stem: (path, path) for path in folder.glob("[!_]*.py")}
    found |= {
        path.parent.name: (path.with_name("__init__.py"), path.with_name("study.py"))
        for path in folder.glob("*/__main__.py")
    }
    return dict(sorted(found.items()))


def example(name: str, text: Path, code: Path, docs: Path) -> str:
    """Turn a scenario into a script for sphinx-gallery."""
    scenario = _read(name, text, code, docs)
    underline = "=" * len(scenario.title)
    header = _HEADER.format(name=name, title=scenario.title, underline=underline, answer=scenario.answer)
    return header + scenario.code


def script(name: str, text: Path, code: Path, docs: Path) -> str:
    """Make the script to download: the module, which runs the study."""
    source = _read(name, text, code, docs).source
    return source if source.endswith(_MAIN) else source + "\n" + _MAIN


def notebook(name: str, text: Path, code: Path, docs: Path) -> dict[str, Any]:
    """Make the notebook to download: the page, cells that run the quick size, and the code to read."""
    scenario = _read(name, text, code, docs)
    picture = b64encode((docs / "images" / f"{name}.png").read_bytes()).decode()
    shown = _PICTURE.sub(r"](attachment:\1)", _LINK.sub(r"\1", scenario.findings))
    page = f"# {scenario.title}\n\n{scenario.answer}\n\n{shown}\nRun this in the folder of the project."
    module = "/".join(code.parts[code.parts.index("scenarios") :])
    listing = f"The code, `{module}`:\n\n```python\n{scenario.source}```"
    cells: list[dict[str, Any]] = [
        {"cell_type": "markdown", "source": page, "attachments": {f"{name}.png": {"image/png": picture}}},
        *(
            {"cell_type": "code", "source": part.format(name=name), "execution_count": None, "outputs": []}
            for part in (_RUN, _SHOW)
        ),
        {"cell_type": "markdown", "source": listing},
    ]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return {
        "nbformat": 4,
        "nbformat_minor": 4,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "cells": [{**cell, "metadata": {}, "source": cell["source"].rstrip()} for cell in cells],
    }


def write_examples(docs: Path, folder: Path) -> None:
    """Write a script for each scenario, what its page includes, its downloads, and the header of all."""
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("pages", "findings", "downloads"):  # pages alone is what sphinx-gallery reads
        (folder / part).mkdir(parents=True)
    for name, files in sources(docs.parent / "scenarios").items():
        made = {
            f"pages/{name}.py": example(name, *files, docs),
            f"findings/{name}.md": _TO_ANOTHER.sub(r"](\1.rst)", _findings(docs, name)),
            f"downloads/{name}.py": script(name, *files, docs),
            f"downloads/{name}.ipynb": json.dumps(notebook(name, *files, docs), indent=1) + "\n",
        }
        for file, content in made.items():
            (folder / file).write_text(content, encoding="utf-8")
    (folder / "pages" / "GALLERY_HEADER.rst").write_text(
        "Gallery of scenarios\n====================\n\n"
        "Studies with one question each: figure, findings, code and downloads. How to run them is on\n"
        ":doc:`a page of its own </scenarios>`.\n",
        encoding="utf-8",
    )


def _prepare(app: Sphinx) -> None:
    write_examples(Path(app.srcdir), Path(app.srcdir) / "_examples")


def link_to_gallery(page: str) -> str:
    """Let links to findings, as the forge follows them, lead to pages of the gallery."""
    return _TO_FINDINGS.sub(r"](\1gallery/\2.rst)", page)


def _read_page(_app: Sphinx, _page: str, source: list[str]) -> None:
    source[0] = link_to_gallery(source[0])


def _drop_downloads(_app: Sphinx, page: nodes.document) -> None:
    """Drop the downloads of sphinx-gallery, before Sphinx collects their files."""
    for node in list(page.findall(nodes.Element)):
        if _NOT_OURS & set(node.get("classes", ())):
            node.parent.remove(node)


def setup(app: Sphinx) -> ExtensionMetadata:
    """Write the scripts before sphinx-gallery looks for them."""
    app.connect("builder-inited", _prepare, priority=100)
    app.connect("source-read", _read_page)
    app.connect("doctree-read", _drop_downloads, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
