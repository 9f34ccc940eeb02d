"""How the pages are built, by `make docs`: nothing is fetched, neither then nor when they are read."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS / "_extensions"), str(DOCS.parent)]

from aimd_des import __version__  # noqa: E402 - the path is set above

project = "aimd_des"
author = "The aimd_des authors"
copyright = author  # noqa: A001 - Sphinx's name
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "accessible",
    "mathml",
    "scenario_gallery",
    "signatures",
    "tutorial_notebook",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    "_build",
    "_examples",
    "_templates",
    "findings",
]  # findings are parts of pages in the gallery

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

# Every reference must lead somewhere, but for types: these are words ("array_like, shape (n,)"), or others'.
nitpicky = True
nitpick_ignore_regex = [("py:class", ".*"), ("py:exc", "pydantic.*"), ("py:obj", "random_optimum")]

# Docstrings write names in single backticks, and types in words; signatures have the hints of the source.
default_role = "code"
autodoc_typehints = "none"
maximum_signature_line_length = 88
python_display_short_literal_types = True
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_param = False  # names that share a text are one entry, as in the source
napoleon_custom_sections = [("Attributes", "params_style")]
napoleon_use_rtype = False

sphinx_gallery_conf = {
    "examples_dirs": "_examples/pages",
    "gallery_dirs": "gallery",
    "plot_gallery": False,
    "within_subsection_order": "FileNameSortKey",
    "backreferences_dir": "gallery/uses",
    "doc_module": ("aimd_des",),
    "thumbnail_size": (800, 420),
    "remove_config_comments": True,
    "log_level": {"backreference_missing": "info"},  # no scenario uses it, and that is all right
    "notebook_extensions": set(),  # notebooks that run are made by `scenario_gallery`
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
}

html_theme = "furo"
html_title = f"aimd_des {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_js_files = ["scrolling.js"]
templates_path = ["_templates"]


def _keep_colons(
    _app: Sphinx, what: str, _name: str, _obj: object, _options: object, lines: list[str]
) -> None:
    """Keep Napoleon from taking what stands before the first colon for a type: these lines are prose."""
    if what in {"attribute", "property"}:
        lines.insert(0, "\\ ")  # nothing, in reStructuredText


def setup(app: Sphinx) -> None:
    """Add what no extension does."""
    app.connect("autodoc-process-docstring", _keep_colons, priority=100)
