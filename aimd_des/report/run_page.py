"""The page of a run, made from its folder."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from aimd_des.report.headline import Settling, headline
from aimd_des.report.html_page import Chart, Choice, Page, PageTable, Slider
from aimd_des.report.verdicts import run_verdicts
from aimd_des.results.measures import MEASURES, measure_words
from aimd_des.scenario.run_folder import StoredRun
from aimd_des.utils.formatting import short

_FRAMES = ("demand", "signals", "allocations")
_SETTLING_ROWS = 1_000
# What an earlier version did not write.
_OLD = "the folder has no {}.parquet; run the scenario again to see this"


def report_run(run: StoredRun) -> Page:
    """Make the page of a run.

    Parameters
    ----------
    run : StoredRun
        The folder that ``aimd-des run`` wrote, as `aimd_des.scenario.run_folder.load_run` reads it.

    Returns
    -------
    Page
        To be written by `write_page`.

    Raises
    ------
    InputError
        If a file is missing or damaged.
    """
    demand, signals, allocations = (run.frame(name) for name in _FRAMES)
    names = list(run.measures)
    notes: list[str] = []
    charts: list[Chart] = []
    controls: list[Slider | Choice] = []
    moved: dict[str, float] = {}
    if not run.has("capacity"):
        notes.append(f"Total demand over time: {_OLD.format('capacity')}.")
    elif len(demand) > len(names):
        charts, controls, moved = _over_time(run, demand, signals, names)
    else:
        notes.append("Total demand over time: the scenario records it at the end only (recording.demand).")
    charts += _convergence(run, names, notes)
    charts += _shares(run, allocations, names, notes)
    settling = Settling(moved, _band(run))
    found = headline(run, settling)
    return Page(
        kind="Run",
        title=str(run.scenario.get("title") or "") or f"Run in {run.folder.name}",
        headline=found.sentence,
        more=found.more,
        facts=_facts(run, len(allocations["agent"].unique()), names),
        verdicts=run_verdicts(run, found, settling),
        controls=controls,
        charts=charts,
        hint="The stretch of time that demand and signals are shown for.",
        notes=notes,
        tables=[_measures(run)],
        provenance=_provenance(run),
        source=run.source(),
    )


def _over_time(
    run: StoredRun, demand: pd.DataFrame, signals: pd.DataFrame, names: list[str]
) -> tuple[list[Chart], list[Slider | Choice], dict[str, float]]:
    """Show totals over time, and measure how far averages have moved since half time."""
    from aimd_des.report import run_charts, settling_charts

    until = float(run.scenario["until"])
    shown = run_charts.over_capacity(demand, run.frame("capacity"))
    charts = run_charts.demand_charts(shown, signals, names, until)
    settling = run_charts.few(shown, len(names), _SETTLING_ROWS, log=True)
    charts.append(settling_charts.use_chart(settling, names))
    controls = run_charts.window_controls(until, run_charts.window_part(shown, signals, names, until))
    return charts, controls, {} if run.scenario.get("interventions") else _moved(shown, until)


def _moved(demand: pd.DataFrame, until: float) -> dict[str, float]:
    """Measure how far the sums of the averages have gone since half time, over the capacity."""
    half, end = (
        rows.groupby("resource", sort=False)["average"].last()
        for rows in (demand[demand["time"] <= 0.5 * until], demand)
    )
    return {str(name): abs(float(moved)) for name, moved in (end - half).items()}


def _band(run: StoredRun) -> dict[str, tuple[float, float]]:
    """Read in which band theory expects the misallocations at the end."""
    if not run.has("convergence"):
        return {}
    last = run.frame("convergence").groupby("resource", observed=True).last()
    found = last[["low", "high"]].dropna()
    return {str(row[0]): (float(row[1]), float(row[2])) for row in found.itertuples(name=None)}


def _convergence(run: StoredRun, names: list[str], notes: list[str]) -> list[Chart]:
    """Show how fast the misallocation falls, and say what theory expects of it."""
    from aimd_des.report.settling_charts import convergence_chart, cost_chart, error_chart

    if not run.has("convergence"):
        notes.append(f"Misallocation over time: {_OLD.format('convergence')}.")
        return []
    if run.unpredicted:
        notes.append(f"What theory expects of the misallocation: {run.unpredicted}.")
    frame = run.frame("convergence")
    if len(frame) > len(names):
        charts = [convergence_chart(frame, names, run.accuracy)]
        # Earlier versions wrote the misallocation alone.
        if {"relative_error", "cost_ratio"} <= set(frame.columns):
            charts += [error_chart(frame, names), cost_chart(frame)]
        return charts
    notes.append("Misallocation over time: the scenario records it at the end only (recording.allocations).")
    return []


def _shares(run: StoredRun, allocations: pd.DataFrame, names: list[str], notes: list[str]) -> list[Chart]:
    """Compare averages with the optimum in force at the end, of the agents that are here then."""
    from aimd_des.report.run_charts import share_chart

    what = "Averages against the optimum"
    if not run.has("optimum"):
        notes.append(f"{what}: {_OLD.format('optimum')}.")
        return []
    best = run.frame("optimum")
    if best.empty:
        notes.append(f"{what}: no agent is here at the end.")
        return []
    last = allocations[allocations["time"] == allocations["time"].max()]
    both = best.merge(last, on=["agent", "resource"], how="left")
    agents = both["agent"].astype(str).tolist()[: len(both) // len(names)]

    def table(column: str) -> Any:
        return both[column].to_numpy().reshape(len(names), -1).T

    known = "allocation_of_used" in both and both["allocation_of_used"].notna().all()
    of_used = table("allocation_of_used") if known else None
    return [share_chart(table("average"), table("allocation"), of_used, agents, names)]


# Tables of a scenario that say how agents average and answer.
_OF_AGENTS = ("averaging", "response", "compensation")


def _facts(run: StoredRun, agents: int, names: list[str]) -> list[tuple[str, str]]:
    said = run.scenario
    unit, channel = said.get("control_unit", {}), said.get("channel", {})
    facts = [
        ("Model", str(said.get("model") or "written out in the scenario")),
        ("Agents", f"{agents:,}"),
        ("Resources", ", ".join(names)),
        ("Dynamics", str(said.get("dynamics", ""))),
        ("Time", short(said["until"])),
        ("Seed", str(said.get("seed", ""))),
        ("Control unit", _spoken(unit)),
        ("Channel", _spoken(channel)),
        *(
            (key.capitalize(), _spoken(said.get(key, {})))
            for key in ("averaging", "response", "compensation")
        ),
        ("Interventions", str(len(said["interventions"])) if said.get("interventions") else ""),
    ]
    return [(name, value) for name, value in facts if value]


def _spoken(table: Any) -> str:
    """Write a table of the scenario in one line."""
    if not isinstance(table, Mapping):
        return short(table)
    return ", ".join(f"{key.replace('_', ' ')} {_spoken(value)}" for key, value in table.items())


def _measures(run: StoredRun) -> PageTable:
    names = list(run.measures)
    rows = []
    for name in next(iter(run.measures.values()), {}):
        measure = MEASURES.get(name)
        unit, meaning = (measure.unit, measure.meaning) if measure else ("", "")
        values = (short(run.measures[of][name]) for of in names)
        words = measure_words(name)
        label = words if words == name.replace("_", " ") else f"{words} ({name})"
        rows.append([label, *values, unit, meaning])
    title = "All measures of each resource"
    return PageTable(title, ["measure", *names, "unit", "meaning"], rows, words=True)


def _provenance(run: StoredRun) -> list[tuple[str, str]]:
    return [
        ("Seed", str(run.scenario.get("seed", ""))),
        ("Digest", run.digest),
        *((name, version) for name, version in run.versions.items()),
    ]
