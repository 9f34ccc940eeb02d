"""Scenarios as examples for sphinx-gallery, which shows them without running them.

A scenario is a study with a command, and takes minutes; its figure is kept in `docs/images`.  So each
becomes a script for sphinx-gallery: its docstring as a page (question, answer, figure, command), and
its code below as it is; of a folder the code of its `study.py`.
"""

import ast
import re
import shutil
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.typing import ExtensionMetadata

_HEADER = '''r"""
{title}
{underline}

{answer}

.. figure:: /images/{name}.png
   :alt: {title}

.. code-block:: console

   $ python -m scenarios.{name}                      # in results/{name}
   $ python -m scenarios.{name} --quick --out quick  # a first look, in seconds

{more}
"""

# sphinx_gallery_thumbnail_path = 'images/{name}.png'
'''


def _details(docs: Path, name: str) -> str:
    """Say where the findings are: on a page of the scenario's own, or in its section of `scenarios.md`."""
    if (docs / f"{name}.md").is_file():
        return f"Findings and numbers: :doc:`/{name}`."
    sections = re.split(r"^## ", (docs / "scenarios.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = [section.partition("\n")[0] for section in sections if f"\n`{name}`" in section]
    if len(found) != 1:
        raise ExtensionError(
            f"docs/scenarios.md needs one section with a paragraph that begins with `{name}`"
        )
    anchor = re.sub(r"[^\w\- ]", "", found[0].lower()).replace(" ", "-")
    return f"Findings and numbers: `{found[0]} <../scenarios.html#{anchor}>`__"


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
    docstring = ast.get_docstring(ast.parse(text.read_text(encoding="utf-8"))) or ""
    title, _, answer = docstring.partition("\n\n")
    source = code.read_text(encoding="utf-8")
    below = "".join(source.splitlines(keepends=True)[ast.parse(source).body[0].end_lineno :])
    header = _HEADER.format(
        name=name, title=title, underline="=" * len(title), answer=answer, more=_details(docs, name)
    )
    return header + below


def write_examples(docs: Path, folder: Path) -> None:
    """Write a script for each scenario, and the header of the gallery."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, (text, code) in sources(docs.parent / "scenarios").items():
        (folder / f"{name}.py").write_text(example(name, text, code, docs), encoding="utf-8")
    (folder / "GALLERY_HEADER.rst").write_text(
        "Gallery of scenarios\n====================\n\n"
        "Studies to run, one question each. What they found stands on :doc:`one page </scenarios>`.\n",
        encoding="utf-8",
    )


def _prepare(app: Sphinx) -> None:
    write_examples(Path(app.srcdir), Path(app.srcdir) / "_examples")


def setup(app: Sphinx) -> ExtensionMetadata:
    """Write the scripts before sphinx-gallery looks for them."""
    app.connect("builder-inited", _prepare, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
