"""What a folder holds as data or as a picture: `aimd-des show --csv`, `--json` and `--plot`."""

import json
from collections.abc import Sequence
from io import BytesIO
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from aimd_des.cli.errors import Refusal, writing
from aimd_des.cli.printing import say, write_out

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from aimd_des.scenario.run_folder import StoredRun
    from aimd_des.study import StudyResults

#: Formats of pictures: the two with vectors, and the one with dots.
FORMATS = ("pdf", "svg", "png")
_DPI = 160


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
    from aimd_des.cli.study_tables import whole_replications
    from aimd_des.study import summarise

    points = [*axes, "resource"]
    return summarise(whole_replications(results.runs, points, measures), points, measures)


def check_plot(path: Path) -> None:
    """Refuse a picture that cannot be written, before anything is read."""
    if path.suffix.removeprefix(".") not in FORMATS:
        raise Refusal(f"--plot = {str(path)!r}: must end in .{', .'.join(FORMATS)}")
    if path.exists():
        raise Refusal(f"--plot = {str(path)!r}: must be a new file; remove it, or choose another name")


def plot_study(table: "pd.DataFrame", axes: list[str], measure: str, path: Path) -> None:
    """Draw a measure along one axis with its intervals, or over two as a map, a panel for each resource."""
    from matplotlib.figure import Figure

    from aimd_des.study.seal import write_file

    varied = [name for name in axes if len(set(table[name])) > 1]
    if not 1 <= len(varied) <= 2:
        found = ", ".join(varied) or "none"
        raise Refusal(f"--plot: needs one or two axes with several values, not {found}; choose with --by")
    rows = table[table["measure"] == measure]
    names = list(dict.fromkeys(rows["resource"].astype(str)))
    maps = len(varied) == 2
    size = (4.6 * len(names) + 0.6, 3.8) if maps else (6.4, 4.0)
    figure = Figure(figsize=size, layout="constrained")
    if maps:
        for panel, name in zip(figure.subplots(1, len(names), squeeze=False).flat, names, strict=True):
            _map(panel, rows[rows["resource"] == name], varied, measure, name)
    else:
        _lines(figure.add_subplot(), rows, varied[0], measure, names)
    picture = BytesIO()
    figure.savefig(picture, format=path.suffix[1:], dpi=_DPI)
    with writing(path):
        write_file(path, picture.getvalue())
    say(f"Figure in {path}")


def _label(measure: str) -> tuple[str, str]:
    from aimd_des.results.measures import MEASURES

    return MEASURES[measure].title, MEASURES[measure].unit


def _map(panel: "Axes", rows: "pd.DataFrame", varied: list[str], measure: str, name: str) -> None:
    from aimd_des import plots
    from aimd_des.plots.style import plain

    title, unit = _label(measure)
    around = 1.0 if measure in ("utilisation", "overshoot_peak") else None
    frame = rows.rename(columns={"mean": title})
    plots.heat_map(panel, frame, varied[1], varied[0], title, units={title: unit}, middle=around)
    panel.set_title(plain(name), loc="left", fontsize="medium")


def _lines(panel: "Axes", rows: "pd.DataFrame", axis: str, measure: str, names: list[str]) -> None:
    from pandas.api.types import is_numeric_dtype

    from aimd_des import plots
    from aimd_des.plots.style import axis_label, mark, plain

    numbers = is_numeric_dtype(rows[axis]) and rows[axis].dtype != bool
    for j, name in enumerate(names):
        own = rows[rows["resource"] == name]
        at: Any = own[axis] if numbers else own[axis].astype(str).map(plain)
        reach = [own["mean"] - own["low"], own["high"] - own["mean"]]
        style = "-" if numbers else "none"
        look: dict[str, Any] = {"marker": mark(j), "linestyle": style, "capsize": 2.5, "markersize": 5.0}
        panel.errorbar(at, own["mean"], reach, color=plots.colour(j), label=plain(name), **look)
    if measure in ("utilisation", "overshoot_peak"):
        panel.axhline(1.0, color=plots.REFERENCE, linewidth=1.0, linestyle="--", label="capacity")
    panel.set_xlabel(plain(axis))
    panel.set_ylabel(axis_label(*_label(measure)))
    plots.frame(panel)
    panel.legend(frameon=False, fontsize="small")
