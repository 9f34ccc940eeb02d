"""The page of a study, made from its folder."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from aimd_des.report.boundaries import boundary_words, critical_losses, critical_words
from aimd_des.report.html_page import Chart, Choice, Page, PageTable, Slider, Verdict
from aimd_des.report.study_axes import Along, axes_of, placed
from aimd_des.report.verdicts import JUDGED, card
from aimd_des.results.measures import EXPECTED, FIRST
from aimd_des.results.shown_measures import LIMITS, shown_measure
from aimd_des.study import StudyResults, summarise
from aimd_des.study.results import run_away_words
from aimd_des.study.statistics.summary import means_by_point
from aimd_des.utils.formatting import interval, percent, short

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
    counts = {"failed": len(results.failed), "missing": len(results.missing)}
    charts: list[Chart] = []
    controls: list[Slider | Choice] = []
    verdicts: list[Verdict] = []
    if table is not None:
        charts, controls, verdicts = _shown(results, table, main, measures)
    return Page(
        kind="Study",
        title=study.title or f"Study in {results.folder.name}",
        headline=_headline(results, names, main),
        more=_unfinished(results, counts),
        facts=_facts(results, counts),
        verdicts=verdicts,
        controls=controls,
        charts=charts,
        hint="Charts run along the axis that is chosen first; sliders say where the other axes stand.",
        notes=[f"Means of runs that have run away say how long they lasted: {run_away_words(results)}."]
        if len(results.run_away)
        else [],
        tables=[
            *([] if table is None else [_points(results, table, names, main or measures[:1])]),
            *_failures(results),
        ],
        provenance=_provenance(results),
        source=tomli_w.dumps(study.spoken()),
    )


def _headline(results: StudyResults, names: Sequence[str], main: Sequence[str]) -> str:
    """Say of how many runs demand has run away, and what is so of the others."""
    runs, away = results.runs, results.run_away
    if not len(runs):
        return "No run is there yet."
    held, count = runs[~runs["key"].isin(away["key"])], runs["key"].nunique()
    lost = runs["key"].nunique() - held["key"].nunique()
    if lost:
        begun = f"Demand has run away from a capacity in {lost:,} of {count:,} runs"
        if not len(held):
            return f"{begun}."
        begun += "; in the others"
    else:
        begun = f"Demand has run away in none of the {count:,} runs:"
    means = held.groupby([*names, "resource"], observed=True)[list(main)].mean()
    words = {
        "utilisation": "mean demand is {} of the capacity",
        "misallocation": "what is used is shared with an error of {}",
        "overshoot_peak": "peak demand is {} of the capacity",
    }
    said = [words[name].format(_span(means[name])) for name in main if means[name].notna().any()]
    if not said:
        return f"{begun.rstrip(':')}." if not lost else f"{begun.removesuffix('; in the others')}."
    return f"{begun} {said[0] if len(said) == 1 else ', '.join(said[:-1]) + ', and ' + said[-1]}."


def _span(values: "pd.Series[float]") -> str:
    low, high = percent(float(values.min())), percent(float(values.max()))
    return low if low == high else f"{low} to {high}"


def _unfinished(results: StudyResults, counts: Mapping[str, int]) -> str:
    said = ", ".join(f"{word} {count:,}" for word, count in counts.items() if count)
    return f"Of {len(results.plan):,} runs: {said}. What is said here is of the others." if said else ""


def _anchors(table: pd.DataFrame, names: Sequence[str]) -> dict[tuple[Any, ...], str]:
    """Name each point, for charts that lead to it."""
    return {point: f"point{k}" for k, point in enumerate(dict.fromkeys(_settings(table, names)))}


def _settings(table: pd.DataFrame, names: Sequence[str]) -> list[tuple[Any, ...]]:
    """Read where on the axes each row is."""
    # Rows without a column are no rows to pandas 2.2.
    return list(table[list(names)].itertuples(index=False, name=None)) if names else [()] * len(table)


def _shown(
    results: StudyResults, table: pd.DataFrame, main: Sequence[str], measures: Sequence[str]
) -> tuple[list[Chart], list[Slider | Choice], list[Verdict]]:
    """Make charts, their controls, and the cards."""
    from aimd_des.report.study_charts import line_chart, map_chart, study_controls

    axes = axes_of(results)
    resources = list(dict.fromkeys(table["resource"].astype(str)))
    names = [axis.name for axis in results.study.axes]
    anchors = _anchors(table, names)
    links = [f"#{anchors[point]}" for point in _settings(table, names)]
    where = placed(table, axes).assign(link=links)
    critical = critical_losses(results, axes)
    verdicts = [
        _verdict(name, table, where, axes, critical_words(critical) if name == "utilisation" else "")
        for name in main
    ]
    if not axes:
        return [], [], verdicts
    start = [int(where[f"i{number}"].iloc[0]) for number in range(len(axes))]
    charts = []
    for name in main or measures[:1]:
        rows = table["measure"] == name
        ends = table.loc[rows, ["mean", "low", "high"]].replace([np.inf, -np.inf], np.nan)
        frame = pd.concat([where[rows], ends], axis=1)
        if name == "misallocation" and EXPECTED in results.study.columns():
            frame = frame.assign(expected=_expected(results, names, table[rows]))
        charts.append(line_chart(frame, name, axes, resources, start, critical))
    if len(axes) > 1:
        wide = _wide(table, where, measures, resources)
        charts.append(map_chart(wide, measures, axes, resources, start, critical))
    return charts, study_controls(axes, resources, measures, start), verdicts


def _expected(results: StudyResults, names: Sequence[str], rows: pd.DataFrame) -> list[float]:
    """Take what theory expects at each point, in the mean over draws."""
    keys = [*names, "resource"]
    found = results.runs.groupby(keys, observed=True)[EXPECTED].mean()
    wanted = rows[keys].itertuples(index=False, name=None)
    return [float(found.get(row if len(keys) > 1 else row[0], np.nan)) for row in wanted]


def _verdict(
    name: str, table: pd.DataFrame, where: pd.DataFrame, axes: Sequence[Along], theory: str
) -> Verdict:
    """Say from where to where the means of a measure go, and where they pass what is good."""
    rows = where.assign(mean=table["mean"])[table["measure"] == name].dropna(subset="mean")
    numbers = [(_span(rows["mean"]), f"over {len(rows):,} means")]
    words = []
    if len(rows) > 1:
        low, high = (rows.iloc[int(at)] for at in (rows["mean"].argmin(), rows["mean"].argmax()))
        words = [f"Lowest at {_where(low, axes)}; highest at {_where(high, axes)}."]
    if name in LIMITS and len(rows):
        words.append(boundary_words(rows, axes, LIMITS[name]))
    return card(name, numbers, " ".join([*words, theory]).strip())


def _where(row: "pd.Series[Any]", axes: Sequence[Along]) -> str:
    """Name a point and a resource."""
    at = [f"{axis.name} {axis.labels[int(row[f'i{k}'])]}" for k, axis in enumerate(axes)]
    return ", ".join([*at, str(row["resource"])])


def _wide(
    table: pd.DataFrame, where: pd.DataFrame, measures: Sequence[str], resources: Sequence[str]
) -> pd.DataFrame:
    """Put the measures side by side, a row for each point and resource."""
    keys = [name for name in where.columns if name != "resource"]
    long = where.assign(
        r=where["resource"].map({name: k for k, name in enumerate(resources)}),
        measure=table["measure"],
        m=table["mean"],
        h=(table["high"] - table["low"]) / 2.0,
    )
    wide = long.pivot(index=[*keys, "r"], columns="measure", values=["m", "h"])  # noqa: PD010 - no aggregation
    wide = wide.replace([np.inf, -np.inf], np.nan)
    wide.columns = pd.Index([f"{column[0]}{measures.index(column[1])}" for column in wide.columns])
    return wide.reset_index()


def _points(
    results: StudyResults, table: pd.DataFrame, names: Sequence[str], main: Sequence[str]
) -> PageTable:
    """List the means of the main measures at every point, each point with its runs."""
    shown = {name: shown_measure(name) for name in main}
    runs, anchors = _runs(results, names), _anchors(table, names)
    rows: list[list[str]] = []
    first: dict[tuple[Any, ...], int] = {}
    for labels, count, means in means_by_point(table, [*names, "resource"]):
        first.setdefault(tuple(labels[:-1]), len(rows))
        cells = (_interval(*(shown[name].factor * part for part in means[name])) for name in main)
        rows.append([*map(short, labels), f"{count:,}", *cells])
    heads = [*names, "resource", "replications", *(one.label for one in shown.values())]
    return PageTable(
        "Means at every point, with the half-widths of their 95 % confidence intervals",
        heads,
        rows,
        labels=len(names) + 1,
        anchors={place: anchors[point] for point, place in first.items()},
        details={place: runs[point] for point, place in first.items() if point in runs},
        hint="The runs of a point are listed with the keys by which load_study(folder).scenario(key) gives"
        " their scenarios, to be run alone.",
    )


def _runs(results: StudyResults, names: Sequence[str]) -> Mapping[tuple[Any, ...], list[str]]:
    """List the runs of each point."""
    found: dict[tuple[Any, ...], list[str]] = {}
    runs = results.runs.drop_duplicates("key")
    away = set(results.run_away["key"])
    columns = runs[[*names, "replication", "key"]].itertuples(index=False, name=None)
    for *point, replication, key in columns:
        note = ", has run away" if key in away else ""
        found.setdefault(tuple(point), []).append(f"replication {replication}: {key}{note}")
    return found


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


def _facts(results: StudyResults, counts: Mapping[str, int]) -> list[tuple[str, str]]:
    study = results.study
    runs = f"{len(results.plan) - sum(counts.values()):,} of {len(results.plan):,}"
    runs += "".join(f", {count:,} {word}" for word, count in counts.items() if count)
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
