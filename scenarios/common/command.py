"""What the commands of the studies share: options, the folder that is written, and what is printed."""

import json
import platform
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from textwrap import dedent
from typing import Any

import click
import pandas as pd
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

import aimd_des
from aimd_des import InputError, checks
from aimd_des.scenario import Place, check_folder, new_folder

_DPI = 200


@dataclass(frozen=True, eq=False)
class Finding:
    """What a study found."""

    name: str  # of the scenario
    settings: dict[str, Any]  # seed and size, for the record
    table: pd.DataFrame  # all numbers, tidy
    shown: pd.DataFrame  # what is printed: text, one row a line
    findings: list[str]  # what the numbers say, in sentences
    # What draws each figure, by the name of its file.
    figures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    pages: dict[str, str] = field(default_factory=dict)  # texts to write beside, by the name of their file
    title: str = ""  # of what is printed; default: name and settings
    record: dict[str, Any] = field(default_factory=dict)  # what the provenance holds besides


def write(found: Finding, place: Place) -> None:
    """Write table, pages and provenance into a folder, as `check_folder` has found it, all or nothing.

    Figures come last, one by one, so that nothing that befalls them takes the numbers along.
    """
    provenance = {
        "scenario": found.name,
        **found.settings,
        **found.record,
        "findings": found.findings,
        "versions": {
            "aimd_des": aimd_des.__version__,
            "python": platform.python_version(),
            **{library: version(library) for library in ("numpy", "scipy", "numba", "simpy", "matplotlib")},
        },
    }
    record = json.dumps(provenance, indent=2, ensure_ascii=False) + "\n"
    with new_folder(place) as folder:
        for name, page in found.pages.items():
            (folder / name).write_text(page, encoding="utf-8")
        found.table.to_csv(folder / "table.csv", index=False)
        (folder / f"{found.name}.json").write_text(record, encoding="utf-8")
    for name, draw in found.figures.items():
        path = place.target / f"{name}.png"
        try:
            picture = BytesIO()
            draw().savefig(picture, dpi=_DPI)
            path.write_bytes(picture.getvalue())
        except Exception as failure:  # noqa: BLE001 - for any error, the numbers are what was asked for
            said = f"{place.folder / path.name}: is missing ({type(failure).__name__}: {failure})"
            warnings.warn(f"{said}; all numbers are written", RuntimeWarning, stacklevel=2)


def sentences(points: str) -> list[str]:
    """Take the points of a list, as Markdown has it, each in one line."""
    return [" ".join(point.split()) for point in dedent(points).strip().removeprefix("- ").split("\n- ")]


class _Refusal(click.ClickException):
    """A user's mistake: the sentence, and exit code 2."""

    exit_code = 2


def command(name: str, study: Callable[..., Finding], text: str | None) -> click.Command:
    """Make the command of a study, whose text begins with a line that says what it asks.

    A study is a function of `quick` (whether to run the small size), of `seed` (of the first replication)
    and of `runs`: a folder in which runs are kept and not run again; default: none.  What it finds is a
    function of the first two.
    """
    question = (text or "").partition("\n")[0]

    def call(quick: bool, seed: int, out: Path, overwrite: bool, runs: Path | None) -> None:
        console = Console(width=None if sys.stdout.isatty() else 118, highlight=False)
        try:
            seed = checks.integer("seed", seed, low=0)
            place = check_folder(out, overwrite=overwrite, mark=f"{name}.json")
            with console.status(question):
                found = study(quick, seed, runs)
            write(found, place)
        except InputError as refusal:
            raise _Refusal(str(refusal)) from None
        _show(found, console)
        console.print(f"Results in {out}")

    options = [
        click.Option(["--quick"], is_flag=True, help="A size that takes seconds, for a first look."),
        click.Option(["--seed"], type=int, default=0, show_default=True, help="Of the first replication."),
        click.Option(
            ["--out"],
            type=click.Path(path_type=Path),
            default=Path("results") / name,
            show_default=True,
            help="Folder for figure and table, new or empty.",
        ),
        click.Option(["--overwrite"], is_flag=True, help="Replace a folder that this scenario wrote."),
        click.Option(
            ["--runs"],
            type=click.Path(path_type=Path),
            help="Folder of the runs; what is missing there is run.  [default: runs are not kept]",
        ),
    ]
    settings = {"help_option_names": ["-h", "--help"]}
    return click.Command(name, callback=call, params=list(options), help=question, context_settings=settings)


def _show(found: Finding, console: Console) -> None:
    size = ", ".join(f"{key} {value}" for key, value in found.settings.items())
    shown = Table(title=found.title or f"{found.name}: {size}")
    for column in found.shown.columns:
        words = found.shown[column].str.contains("[a-z]{2}").any()
        shown.add_column(str(column), justify="left" if words else "right")
    for row in found.shown.itertuples(index=False):
        shown.add_row(*map(str, row))
    console.print(shown)
    for finding in found.findings:
        console.print(f"• {finding}")
