"""What the commands of the studies share: options, the folder that is written, and what is printed."""

import json
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import pandas as pd
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

import aimd_des
from aimd_des import checks
from aimd_des.errors import InputError
from aimd_des.output import Place, check_folder, new_folder

__all__ = ["Study", "command", "write"]

_DPI = 200


@dataclass(frozen=True, eq=False)
class Study:
    """What a study found.

    Attributes
    ----------
    name : str
        Of the scenario.
    settings : dict
        Seed and size, for the record.
    table : DataFrame
        All numbers, tidy.
    shown : DataFrame
        What is printed: text, one row a line.
    findings : list of str
        What the numbers say, in sentences.
    figures : dict of str to Figure
        By the name of their file.
    pages : dict of str to str
        Texts to write beside, by the name of their file.
    """

    name: str
    settings: dict[str, Any]
    table: pd.DataFrame
    shown: pd.DataFrame
    findings: list[str]
    figures: dict[str, Figure] = field(default_factory=dict)
    pages: dict[str, str] = field(default_factory=dict)


def write(study: Study, place: Place) -> None:
    """Write figures, table and provenance, all or nothing.

    Parameters
    ----------
    study : Study
        What was found.
    place : Place
        Where to, as `check_folder` has found it.

    Raises
    ------
    InputError
        If something has come to that place meanwhile; it says where the results are.
    """
    provenance = {
        "scenario": study.name,
        **study.settings,
        "findings": study.findings,
        "versions": {
            "aimd_des": aimd_des.__version__,
            "python": platform.python_version(),
            **{library: version(library) for library in ("numpy", "scipy", "numba", "simpy", "matplotlib")},
        },
    }
    with new_folder(place) as folder:
        for name, figure in study.figures.items():
            figure.savefig(folder / f"{name}.png", dpi=_DPI)
        for name, page in study.pages.items():
            (folder / name).write_text(page, encoding="utf-8")
        study.table.to_csv(folder / "table.csv", index=False)
        record = json.dumps(provenance, indent=2, ensure_ascii=False)
        (folder / f"{study.name}.json").write_text(record + "\n", encoding="utf-8")


class _Refusal(click.ClickException):
    """A user's mistake: the sentence, and exit code 2."""

    exit_code = 2


def command(
    name: str, run: Callable[..., Study], question: str, more: Sequence[click.Option] = ()
) -> click.Command:
    """Make the command of a study.

    Parameters
    ----------
    name : str
        Of the scenario.
    run : callable
        Takes whether to be quick, the seed, and what further options give.
    question : str
        For the help.
    more : sequence of click.Option
        Options that only this study has.

    Returns
    -------
    click.Command
        With the options that all studies have.
    """

    def call(quick: bool, seed: int, out: Path, overwrite: bool, **given: Any) -> None:
        console = Console(width=None if sys.stdout.isatty() else 118, highlight=False)
        try:
            seed = checks.integer("seed", seed, low=0)
            place = check_folder(out, overwrite=overwrite, mark=f"{name}.json")
            with console.status(question):
                study = run(quick, seed, **given)
            write(study, place)
        except InputError as refusal:
            raise _Refusal(str(refusal)) from None
        _show(study, console)
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
        *more,
    ]
    settings = {"help_option_names": ["-h", "--help"]}
    return click.Command(name, callback=call, params=list(options), help=question, context_settings=settings)


def _show(study: Study, console: Console) -> None:
    size = ", ".join(f"{key} {value}" for key, value in study.settings.items())
    shown = Table(title=f"{study.name}: {size}")
    for column in study.shown.columns:
        words = study.shown[column].str.contains("[a-z]{2}").any()
        shown.add_column(str(column), justify="left" if words else "right")
    for row in study.shown.itertuples(index=False):
        shown.add_row(*map(str, row))
    console.print(shown)
    for finding in study.findings:
        console.print(f"• {finding}")
