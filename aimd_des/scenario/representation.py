"""What a scenario shows of itself: read off its data, with no model built."""

from aimd_des.scenario.keys import ScenarioKeys
from aimd_des.utils.formatting import given
from aimd_des.utils.shown import Shown


def shown_scenario(scenario: ScenarioKeys) -> Shown:
    """Show problem, control unit, channel and the number of interventions."""
    spoken = scenario.spoken()
    problem = scenario.model or f"written out, {len(scenario.resources or ()):,} resources"
    rows = [["problem", f"{problem} {given(scenario.parameters)}".rstrip()]]
    parts = [key for key in ("control_unit", "channel") if key in spoken]
    rows += [[key.replace("_", " "), given(spoken[key])] for key in parts]
    if scenario.interventions:
        rows.append(["interventions", f"{len(scenario.interventions):,}"])
    title = f"Scenario: {scenario.title}; " if scenario.title else "Scenario: "
    return Shown(f"{title}{scenario.dynamics}, seed {scenario.seed}, until {scenario.until:,g}", rows=rows)
