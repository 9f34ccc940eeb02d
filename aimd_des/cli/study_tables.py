"""Studies as tables: means with what they are known to, what failed, and what is missing."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aimd_des.cli.printing import say
from aimd_des.cli.terminal_tables import plus_minus, plus_or_minus, print_pairs, print_table
from aimd_des.utils.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from aimd_des.study import Study, StudyResults

# How many of the measures are shown unless they are chosen.
_MOST_MEASURES = 4
_MOST_FAILURES = 10
# From so many rows on, a shorter table is pointed to.
_MANY_ROWS = 30


def chosen_measures(kept: Sequence[str], measures: Sequence[str]) -> list[str]:
    """Take the measures that are asked for, or those that matter most."""
    from aimd_des.results.measures import FIRST
    from aimd_des.study.columns import known_measure

    for name in measures:
        known_measure("measure", name)
        if name not in kept:
            raise InputError.of("measure", name, f"one that the study keeps: {', '.join(kept)}")
    return list(measures) or [name for name in FIRST[:_MOST_MEASURES] if name in kept] or list(kept)


def show_study(folder: Path, measures: Sequence[str], by: Sequence[str]) -> None:
    """Print what a study is, the means at each point, and what failed or is missing."""
    from aimd_des.study import load_study

    results = load_study(folder)
    names = chosen_measures(results.study.columns(), measures)
    axes = chosen_axes(results.study, by)
    runs = results.runs
    print_pairs(f"Study in {folder}", _about(results))
    say()
    if runs.empty:
        say("No run is there yet.")
    else:
        columns, rows = _means(runs, axes, names)
        title = f"Means {plus_minus()} half-widths of their 95 % confidence intervals"
        print_table(title, columns, rows, labels=len(axes) + 1)
        if len(rows) > _MANY_ROWS and len(axes) > 1:
            say(f"{len(rows):,} rows: --by {axes[0]} takes means over the other axes")
    _print_failures(results)


def chosen_axes(study: "Study", by: Sequence[str]) -> list[str]:
    """Take the axes that are asked for, or all."""
    known = [axis.name for axis in study.axes]
    for name in by:
        if name not in (*known, "resource"):
            raise InputError.of("by", name, f"one of {', '.join([*known, 'resource'])}")
    return [name for name in known if name in by or not by]


def _about(results: "StudyResults") -> list[tuple[str, Any]]:
    study = results.study
    axes = {axis.name: [value for value, _ in axis.settings()] for axis in study.axes}
    failed, missing = len(results.failed), len(results.missing)
    counts = [f"{len(results.plan) - failed - missing:,} of {len(results.plan):,} are there"]
    counts += [f"{count:,} {word}" for count, word in ((failed, "failed"), (missing, "missing")) if count]
    seeds = "the same at all points" if study.paired else "different at all points"
    return [
        *([("title", study.title)] if study.title else []),
        *((f"axis {name}", values) for name, values in axes.items()),
        ("runs", ", ".join(counts)),
        ("seed", f"{study.seed}; seeds are {seeds}"),
        ("versions", results.versions),
    ]


def _means(runs: "pd.DataFrame", axes: list[str], names: list[str]) -> tuple[list[str], list[list[Any]]]:
    """Make a row for each point and resource."""
    from aimd_des.results.measures import measure_words
    from aimd_des.study import summarise
    from aimd_des.study.statistics.summary import means_by_point, whole_replications

    points = [*axes, "resource"]
    whole = whole_replications(runs, points, names)
    rows = [
        [*labels, count, *(plus_or_minus(*means[name]) for name in names)]
        for labels, count, means in means_by_point(summarise(whole, points, names), points)
    ]
    return [*points, "replications", *map(measure_words, names)], rows


def _print_failures(results: "StudyResults") -> None:
    failed = results.failed
    if failed.empty:
        return
    axes = [axis.name for axis in results.study.axes]
    columns = [*axes, "replication", "message"]
    rows = [list(row) for row in failed[columns].head(_MOST_FAILURES).itertuples(index=False)]
    say()
    title = f"Runs that failed: {len(failed):,}"
    if len(failed) > _MOST_FAILURES:
        title += f", the first {_MOST_FAILURES}; all are described in {results.folder / 'failed'}"
    print_table(title, columns, rows, labels=len(axes) + 1)
