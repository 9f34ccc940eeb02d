"""The page of a run, made from its folder."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from aimd_des.report.html_page import Chart, Choice, Page, PageTable, Slider
from aimd_des.report.verdicts import JUDGED, verdict
from aimd_des.results.measures import measure_words
from aimd_des.scenario.run_folder import StoredRun
from aimd_des.utils.formatting import short

_FRAMES = ("demand", "signals", "allocations")
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
    from aimd_des.report.run_charts import demand_charts, over_capacity, settling_chart, window_controls

    demand, signals, allocations = (run.frame(name) for name in _FRAMES)
    until, names = float(run.scenario["until"]), list(run.measures)
    notes: list[str] = []
    charts: list[Chart] = []
    controls: list[Slider | Choice] = []
    if not run.has("capacity"):
        notes.append(f"Total demand over time: {_OLD.format('capacity')}.")
    elif len(demand) > len(names):
        shown_demand = over_capacity(demand, run.frame("capacity"))
        charts += demand_charts(shown_demand, signals, names, until)
        charts.append(settling_chart(shown_demand, names, until))
        controls = window_controls(until)
    else:
        notes.append("Total demand over time: the scenario records it at the end only (recording.demand).")
    charts += _convergence(run, names, notes)
    charts += _shares(run, allocations, names, notes)
    verdicts = [
        verdict(
            name,
            {of: float(row[name]) for of, row in run.measures.items()},
            "resources",
            run.run_away if name == "utilisation" else (),
        )
        for name in JUDGED
    ]
    return Page(
        kind="Run",
        title=str(run.scenario.get("title") or "") or f"Run in {run.folder.name}",
        facts=_facts(run, len(allocations["agent"].unique()), names),
        verdicts=[found for found in verdicts if found is not None],
        controls=controls,
        charts=charts,
        hint="The stretch of time that demand and signals are shown for.",
        notes=notes,
        tables=[_measures(run)],
        provenance=_provenance(run),
        source=run.source(),
    )


def _convergence(run: StoredRun, names: list[str], notes: list[str]) -> list[Chart]:
    """Show how fast the misallocation falls, and say what theory expects of it."""
    from aimd_des.report.run_charts import convergence_chart

    if not run.has("convergence"):
        notes.append(f"Misallocation over time: {_OLD.format('convergence')}.")
        return []
    if run.unpredicted:
        notes.append(f"What theory expects of the misallocation: {run.unpredicted}.")
    frame = run.frame("convergence")
    if len(frame) > len(names):
        return [convergence_chart(frame, names, run.accuracy)]
    notes.append("Misallocation over time: the scenario records it at the end only (recording.allocations).")
    return []


def _shares(run: StoredRun, allocations: pd.DataFrame, names: list[str], notes: list[str]) -> list[Chart]:
    """Hold averages against the optimum in force at the end, of those who are here then."""
    from aimd_des.report.run_charts import share_chart

    what = "Averages against the optimum"
    if not run.has("optimum"):
        notes.append(f"{what}: {_OLD.format('optimum')}.")
        return []
    best = run.frame("optimum")
    if best.empty:
        notes.append(f"{what}: nobody is here at the end.")
        return []
    last = allocations[allocations["time"] == allocations["time"].max()]
    both = best.merge(last, on=["agent", "resource"], how="left")
    held, should = (both[of].to_numpy().reshape(len(names), -1).T for of in ("average", "allocation"))
    return [share_chart(held, should, names)]


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
    rows = [
        [measure_words(measure), *(short(run.measures[name][measure]) for name in names)]
        for measure in next(iter(run.measures.values()), {})
    ]
    return PageTable("All measures of each resource", ["measure", *names], rows)


def _provenance(run: StoredRun) -> list[tuple[str, str]]:
    return [
        ("Seed", str(run.scenario.get("seed", ""))),
        ("Digest", run.digest),
        *((name, version) for name, version in run.versions.items()),
    ]
