"""The page itself: its parts, and how they become one HTML file with everything in it."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from aimd_des._version import __version__
from aimd_des.report.script import bundled
from aimd_des.utils.errors import InputError
from aimd_des.utils.whole_files import write_file

_LIBRARIES = ("altair", "jinja2", "vl_convert")


@dataclass(frozen=True)
class Verdict:
    """One of the numbers that say how it went."""

    name: str  # what is measured
    numbers: Sequence[tuple[str, str]]  # each with its unit, and of what it is
    words: str  # what they say; empty where nothing is to be judged
    meaning: str  # what the measure means


@dataclass(frozen=True)
class Slider:
    """A control that moves along values."""

    id: str  # by which charts are bound to it
    label: str  # what it changes
    values: Sequence[str]  # what is shown at each position
    start: int = 0  # the position at first
    # The axis of a study that it moves along, as the control `along` calls it: it rests while charts run
    # along that axis.
    axis: str | None = None
    kind: ClassVar[str] = "slider"


@dataclass(frozen=True)
class Choice:
    """A control that chooses one of several."""

    id: str  # by which charts are bound to it
    label: str  # what it changes
    options: Sequence[tuple[str, str]]  # what charts get, and what is shown
    start: str  # what is chosen at first
    kind: ClassVar[str] = "choice"


@dataclass(frozen=True)
class Chart:
    """A chart."""

    id: str  # of the element
    title: str  # above it
    text: str  # what is to be seen: below it, and for screen readers
    spec: dict[str, Any]  # Vega-Lite, with its data
    wide: bool = True  # whether it takes the whole width, where there is room for several side by side

    def json(self) -> str:
        """Write the specification so that nothing in it can end a script."""
        described = {**self.spec, "description": f"{self.title}. {self.text}"}
        text = json.dumps(described, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


@dataclass(frozen=True)
class PageTable:
    """A table."""

    title: str  # its caption
    heads: Sequence[str]  # of the columns
    rows: Sequence[Sequence[str]]  # the cells
    labels: int = 1  # how many cells of a row, from the left, say what it is
    words: bool = False  # whether the last column has sentences, not numbers
    # Of rows that charts and other rows refer to: the position of the row, and its anchor.
    anchors: Mapping[int, str] = field(default_factory=dict)
    # Of rows that have more to tell, by their position: what JavaScript lists on demand.
    details: Mapping[int, Sequence[str]] = field(default_factory=dict)
    hint: str = ""  # how it is used


@dataclass(frozen=True)
class Page:
    """What a page says."""

    kind: str  # "Run" or "Study"
    title: str  # the heading
    headline: str  # how it went, in one sentence
    more: str  # what else to know of it, or empty
    facts: Sequence[tuple[str, str]]  # what was run
    verdicts: Sequence[Verdict]  # how it went
    controls: Sequence[Slider | Choice]  # of the charts
    charts: Sequence[Chart]  # in the order in which they are shown
    hint: str  # how the controls are used
    tables: Sequence[PageTable]  # in the order in which they are shown
    provenance: Sequence[tuple[str, str]]  # seed, digest, versions
    source: str  # the scenario or the study, as TOML
    notes: Sequence[str] = field(default_factory=list)  # what is not shown, and why


def check_page(path: Path, *, overwrite: bool) -> None:
    """Refuse to make a page that cannot be made, before anything is read.

    Parameters
    ----------
    path : Path
        Where it shall go.
    overwrite : bool
        Whether what is there may be replaced.

    Raises
    ------
    InputError
        If a library is missing, the file exists already, or its folder does not.
    """
    missing = [name for name in _LIBRARIES if find_spec(name) is None]
    if missing:
        remedy = "pip install 'aimd-des[report]'"
        raise InputError(f"a report needs {', '.join(missing)}, which is not installed; say {remedy}")
    if path.is_dir():
        raise InputError.of("report", str(path), "a file", "it is a folder; choose another name")
    if path.exists() and not overwrite:
        raise InputError.of("report", str(path), "a new file", "choose another, or say --overwrite")
    if not path.absolute().parent.is_dir():
        raise InputError.of("report", str(path), "in a folder that exists", "make the folder first")


def write_page(page: Page, path: Path) -> None:
    """Write a page, whole or not at all.

    Parameters
    ----------
    page : Page
        What it says.
    path : Path
        Where to; what is there is replaced.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    write_file(path, render(page).encode("utf-8"))


def render(page: Page) -> str:
    """Put a page together."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    folder = PackageLoader("aimd_des.report")
    environment = Environment(
        loader=folder, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    style, glue = (folder.get_source(environment, name)[0] for name in ("page.css", "page.js"))
    script = bundled(glue)
    return environment.get_template("page.html").render(
        page=page,
        version=__version__,
        style=style,
        script=script,
        hash=_hash(script),
    )


def _hash(script: str) -> str:
    """Name a script in the way in which a content security policy does."""
    return f"'sha256-{base64.b64encode(sha256(script.encode('utf-8')).digest()).decode('ascii')}'"
