"""The page of a study, made from its folder."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from aimd_des.report.html_page import Chart, Choice, Page, PageTable, Slider, Verdict
from aimd_des.report.verdicts import JUDGED, verdict
from aimd_des.results.measures import FIRST, measure_words
from aimd_des.study import StudyResults, summarise
from aimd_des.study.results import run_away_words
from aimd_des.study.statistics.summary import means_by_point
from aimd_des.utils.formatting import interval, short

_MOST_FAILURES = 20
_MOST_MEASURES = 8


def report_study(results: StudyResults) -> Page:
    """Make the page of a study.

    Parameters
    ----------
    results : StudyResults
        Its folder, opened; runs may be missing.

    Returns
    -------
    Page
        To be written by `write_page`.
    """
    study, runs = results.study, results.runs
    kept = study.columns()
    main = [name for name in JUDGED if name in kept]
    measures = [name for name in dict.fromkeys((*main, *FIRST, *kept)) if name in kept][:_MOST_MEASURES]
    names = [axis.name for axis in study.axes]
    table = summarise(runs, [*names, "resource"], measures) if len(runs) else None
    charts: list[Chart] = []
    controls: list[Slider | Choice] = []
    if table is not None:
        charts, controls = _charts(results, table, main or measures[:1], measures)
    return Page(
        kind="Study",
        title=study.title or f"Study in {results.folder.name}",
        facts=_facts(results),
        verdicts=[] if table is None else _verdicts(table, names, main),
        controls=controls,
        charts=charts,
        hint="Charts run along the axis that is chosen first; sliders say where the other axes stand.",
        notes=[f"Means of runs that have run away say how long they lasted: {run_away_words(results)}."]
        if len(results.run_away)
        else [],
        tables=[
            *([] if table is None else [_points(table, names, main or measures[:1])]),
            *_failures(results),
        ],
        provenance=_provenance(results),
        source=tomli_w.dumps(study.spoken()),
    )


def _axes(results: StudyResults) -> "list[tuple[str, list[str], list[tuple[Any, ...]]]]":
    """List the axes that can be moved along: name, columns and positions; axes that are zipped are one."""
    groups: dict[str, list[Any]] = {}
    for number, axis in enumerate(results.study.axes):
        groups.setdefault(axis.zip or f"\0{number}", []).append(axis)
    found = []
    for group in groups.values():
        columns = [axis.name for axis in group]
        positions = list(zip(*([value for value, _ in axis.settings()] for axis in group), strict=True))
        if len(positions) > 1:
            found.append((", ".join(columns), columns, positions))
    # The longest first: it is what charts run along.
    return sorted(found, key=lambda one: -len(one[2]))


def _charts(
    results: StudyResults, table: pd.DataFrame, main: Sequence[str], measures: Sequence[str]
) -> tuple[list[Chart], list[Slider | Choice]]:
    """Make the charts and their controls."""
    from aimd_des.report.study_charts import Along, line_chart, map_chart, study_controls

    axes = _axes(results)
    if not axes:
        return [], []
    resources = list(dict.fromkeys(table["resource"].astype(str)))
    placed = pd.DataFrame(index=table.index)
    for number, (_, columns, positions) in enumerate(axes):
        place = {position: k for k, position in enumerate(positions)}
        placed[f"i{number}"] = [place[row] for row in table[columns].itertuples(index=False, name=None)]
    placed["resource"] = table["resource"].astype(str)
    along = [Along(name, tuple(", ".join(map(short, one)) for one in values)) for name, _, values in axes]
    start = [int(placed[f"i{number}"].iloc[0]) for number in range(len(axes))]
    charts = []
    for name in main:
        rows = table["measure"] == name
        ends = table.loc[rows, ["mean", "low", "high"]].replace([np.inf, -np.inf], np.nan)
        charts.append(line_chart(pd.concat([placed[rows], ends], axis=1), name, along, resources, start))
    if len(axes) > 1:
        charts.append(map_chart(_wide(table, placed, measures, resources), measures, along, start))
    return charts, study_controls(along, resources, measures, start)


def _wide(
    table: pd.DataFrame, placed: pd.DataFrame, measures: Sequence[str], resources: Sequence[str]
) -> pd.DataFrame:
    """Put the measures side by side, a row for each point and resource."""
    keys = [name for name in placed.columns if name != "resource"]
    long = placed.assign(
        r=placed["resource"].map({name: k for k, name in enumerate(resources)}),
        measure=table["measure"],
        m=table["mean"],
        h=(table["high"] - table["low"]) / 2.0,
    )
    wide = long.pivot(index=[*keys, "r"], columns="measure", values=["m", "h"])  # noqa: PD010 - no aggregation
    wide = wide.replace([np.inf, -np.inf], np.nan)
    wide.columns = pd.Index([f"{column[0]}{measures.index(column[1])}" for column in wide.columns])
    return wide.reset_index()


def _verdicts(table: pd.DataFrame, names: Sequence[str], main: Sequence[str]) -> list[Verdict]:
    """Say the worst point for each of the measures that matter most, and the span of the others."""
    found = []
    for measure in main:
        rows = table[table["measure"] == measure]
        values = {
            _where(dict(zip([*names, "resource"], labels, strict=True))): float(mean)
            for *labels, mean in rows[[*names, "resource", "mean"]].itertuples(index=False, name=None)
        }
        found.append(verdict(measure, values, f"{len(values):,} means"))
    return [one for one in found if one is not None]


def _where(labels: dict[str, Any]) -> str:
    """Name a point and a resource."""
    resource = labels.pop("resource")
    return ", ".join([*(f"{name} {short(value)}" for name, value in labels.items()), str(resource)])


def _points(table: pd.DataFrame, names: Sequence[str], main: Sequence[str]) -> PageTable:
    """List the means of the main measures at every point."""
    rows = [
        [*map(short, labels), f"{count:,}", *(_interval(*means[name]) for name in main)]
        for labels, count, means in means_by_point(table, [*names, "resource"])
    ]
    heads = [*names, "resource", "replications", *map(measure_words, main)]
    title = "Means at every point, with the half-widths of their 95 % confidence intervals"
    return PageTable(title, heads, rows, labels=len(names) + 1)


def _interval(mean: float, half: float) -> str:
    return interval(mean, half) if np.isfinite(half) else short(mean)


def _failures(results: StudyResults) -> list[PageTable]:
    failed = results.failed
    if not len(failed):
        return []
    heads = [*(axis.name for axis in results.study.axes), "replication", "message"]
    rows = [[short(cell) for cell in row] for row in failed[heads].itertuples(index=False, name=None)]
    title = f"Runs that failed: {len(failed):,}"
    if len(rows) > _MOST_FAILURES:
        title += f", of which the first {_MOST_FAILURES} are listed"
    return [PageTable(title, heads, rows[:_MOST_FAILURES], labels=len(heads))]


def _facts(results: StudyResults) -> list[tuple[str, str]]:
    study = results.study
    failed, missing = len(results.failed), len(results.missing)
    runs = f"{len(results.plan) - failed - missing:,} of {len(results.plan):,}"
    runs += "".join(
        f", {count:,} {word}" for count, word in ((failed, "failed"), (missing, "missing")) if count
    )
    axes = [
        (f"Axis {axis.name}", ", ".join(short(value) for value, _ in axis.settings())) for axis in study.axes
    ]
    base = [
        (key.capitalize(), short(study.scenario[key]))
        for key in ("model", "dynamics", "until")
        if key in study.scenario
    ]
    seeds = "the same seeds at all points" if study.paired else "different seeds at all points"
    return [*base, *axes, ("Replications", f"{study.replications:,}, {seeds}"), ("Runs", runs)]


def _provenance(results: StudyResults) -> list[tuple[str, str]]:
    return [("Seed", str(results.study.seed)), *results.versions.items()]
