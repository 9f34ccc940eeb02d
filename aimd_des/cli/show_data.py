"""What a folder holds as data or as a picture: `aimd-des show --csv`, `--json` and `--plot`."""

import json
from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from aimd_des.cli.errors import Refusal, writing
from aimd_des.cli.printing import say, write_out

if TYPE_CHECKING:
    import pandas as pd

    from aimd_des.scenario.run_folder import StoredRun
    from aimd_des.study import StudyResults

#: Formats of pictures: the two with vectors, and the one with dots.
FORMATS = ("pdf", "svg", "png")


def print_data(table: "pd.DataFrame", form: Literal["csv", "json"]) -> None:
    """Print a table whole, for other programs; what is not a number is empty, or null."""
    if form == "csv":
        write_out(table.to_csv(index=False))
        return
    rows = [
        {name: None if isinstance(value, float) and isnan(value) else value for name, value in row.items()}
        for row in table.to_dict("records")
    ]
    write_out(json.dumps(rows, indent=2, ensure_ascii=False, default=float) + "\n")


def run_table(run: "StoredRun", measures: Sequence[str]) -> "pd.DataFrame":
    """Make a row for each resource."""
    import pandas as pd

    from aimd_des.cli.run_tables import chosen_of_run

    names = chosen_of_run(run, measures)
    rows = [{"resource": of, **{name: row[name] for name in names}} for of, row in run.measures.items()]
    return pd.DataFrame(rows)


def study_table(results: "StudyResults", axes: list[str], measures: Sequence[str]) -> "pd.DataFrame":
    """Make a row for each point, resource and measure: mean, standard error, and 95 % interval."""
    from aimd_des.study import summarise
    from aimd_des.study.statistics.summary import whole_replications

    points = [*axes, "resource"]
    return summarise(whole_replications(results.runs, points, measures), points, measures)


def check_plot(path: Path) -> None:
    """Refuse a picture that cannot be written, before anything is read."""
    if path.suffix.removeprefix(".") not in FORMATS:
        raise Refusal(f"--plot = {str(path)!r}: must end in .{', .'.join(FORMATS)}")
    if path.exists():
        raise Refusal(f"--plot = {str(path)!r}: must be a new file; remove it, or choose another name")


def plot_study(results: "StudyResults", axes: list[str], measure: str, path: Path) -> None:
    """Write the figure of a measure."""
    from aimd_des.plots.style import picture_of
    from aimd_des.utils.whole_files import write_file

    picture = picture_of(results.plot(measure, axes), path.suffix[1:])
    with writing(path):
        write_file(path, picture)
    say(f"Figure in {path}")
