"""The page itself: its parts, and how they become one HTML file with everything in it."""

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from aimd_des._version import __version__
from aimd_des.study.seal import write_file
from aimd_des.utils.errors import InputError

_LIBRARIES = ("altair", "jinja2", "vl_convert")


@dataclass(frozen=True)
class Verdict:
    """One of the numbers that say how it went.

    Attributes
    ----------
    name : str
        What is measured.
    number : str
        With its unit.
    words : str
        What the number says, of what.
    meaning : str
        What the measure means.
    """

    name: str
    number: str
    words: str
    meaning: str


@dataclass(frozen=True)
class Slider:
    """A control that moves along values.

    Attributes
    ----------
    id : str
        By which charts are bound to it.
    label : str
        What it changes.
    values : sequence of str
        What is shown at each position.
    start : int
        The position at first.
    axis : str, optional
        The axis of a study that it moves along, as the control `along` calls it: it rests while charts run
        along that axis.
    """

    id: str
    label: str
    values: Sequence[str]
    start: int = 0
    axis: str | None = None
    kind: ClassVar[str] = "slider"


@dataclass(frozen=True)
class Choice:
    """A control that chooses one of several.

    Attributes
    ----------
    id : str
        By which charts are bound to it.
    label : str
        What it changes.
    options : sequence of (str, str)
        What charts get, and what is shown.
    start : str
        What is chosen at first.
    """

    id: str
    label: str
    options: Sequence[tuple[str, str]]
    start: str
    kind: ClassVar[str] = "choice"


@dataclass(frozen=True)
class Chart:
    """A chart.

    Attributes
    ----------
    id : str
        Of the element.
    title : str
        Above it.
    text : str
        What is to be seen: below it, and for those who do not see it.
    spec : dict
        Vega-Lite, with its data.
    wide : bool
        Whether it takes the whole width, where there is room for several side by side.
    """

    id: str
    title: str
    text: str
    spec: dict[str, Any]
    wide: bool = True

    def json(self) -> str:
        """Write the specification so that nothing in it can end a script."""
        described = {**self.spec, "description": f"{self.title}. {self.text}"}
        text = json.dumps(described, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


@dataclass(frozen=True)
class PageTable:
    """A table.

    Attributes
    ----------
    title : str
        Its caption.
    heads : sequence of str
        Of the columns.
    rows : sequence of sequence of str
        The cells.
    labels : int
        How many cells of a row, from the left, say what it is.
    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    labels: int = 1


@dataclass(frozen=True)
class Page:
    """What a page says.

    Attributes
    ----------
    kind : str
        "Run" or "Study".
    title : str
        The heading.
    facts : sequence of (str, str)
        What was run.
    verdicts : sequence of Verdict
        How it went.
    controls : sequence of Slider or Choice
        Of the charts.
    charts : sequence of Chart
        In the order in which they are shown.
    hint : str
        How the controls are used.
    notes : sequence of str
        What is not shown, and why.
    tables : sequence of Table
        In the order in which they are shown.
    provenance : sequence of (str, str)
        Seed, digest, versions.
    source : str
        The scenario or the study, as TOML.
    """

    kind: str
    title: str
    facts: Sequence[tuple[str, str]]
    verdicts: Sequence[Verdict]
    controls: Sequence[Slider | Choice]
    charts: Sequence[Chart]
    hint: str
    tables: Sequence[PageTable]
    provenance: Sequence[tuple[str, str]]
    source: str
    notes: Sequence[str] = field(default_factory=list)


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
    script = _bundle(glue)
    return environment.get_template("page.html").render(
        page=page,
        version=__version__,
        style=style,
        script=script,
        hash=_hash(script),
    )


@lru_cache
def _bundle(glue: str) -> str:
    """Put Vega and what joins it to the page into one script: seconds, for whoever makes several pages."""
    import vl_convert

    return str(vl_convert.javascript_bundle(glue))


def _hash(script: str) -> str:
    """Name a script in the way in which a content security policy does."""
    return f"'sha256-{base64.b64encode(sha256(script.encode('utf-8')).digest()).decode('ascii')}'"
