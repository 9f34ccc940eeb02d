"""A scenario as a simulation, and its warm-up: the beginning, which measures leave out and runs can share."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.declared import Intervention
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.run_in_progress import Run, completed
from aimd_des.engine.simulation import Simulation
from aimd_des.engine.system import System
from aimd_des.fleet import Fleet
from aimd_des.problem.problem import Problem
from aimd_des.results.result import Result
from aimd_des.scenario.keys import ScenarioKeys
from aimd_des.scenario.kind_tables import one_of
from aimd_des.scenario.warm_up import EXCHANGED, WarmUpSettings
from aimd_des.utils.errors import InputError

_Scenario = TypeVar("_Scenario", bound=ScenarioKeys)


def begins_before(change: object, time: float) -> bool:
    """Tell whether an intervention acts before a time; one that does not say when it begins may do so."""
    return bool(getattr(change, "begins", 0.0) < time)


def before(scenario: _Scenario, interventions: Sequence[Intervention]) -> _Scenario:
    """Give the scenario that is run until the warm-up ends: equal ones can share it."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    tables = zip(scenario.interventions, interventions, strict=True)
    early = [table for table, change in tables if begins_before(change, scenario.warm_up.until)]
    alone = {"warm_up": WarmUpSettings(until=scenario.warm_up.until), "interventions": early}
    return scenario.model_copy(update={**scenario.warm_up.given(), **alone})


def simulation_of(
    scenario: ScenarioKeys,
    problem: Problem,
    interventions: Sequence[Intervention],
    processes: Sequence[Callable[[System], ProcessGenerator]] = (),
) -> Simulation:
    """Put the parts of a scenario together."""
    dynamics = scenario.dynamics
    assert dynamics != "synchronous"  # noqa: S101 - which is no simulation
    return Simulation(
        problem,
        dynamics=dynamics,
        control_unit=scenario.control_unit.build(),
        channel=scenario.channel.build(),
        agents=Fleet if scenario.agents == "fleet" else AgentProcess,
        clocks=scenario.clocks.build() if dynamics == "discrete" else None,
        averaging=scenario.averaging.build(),
        response=scenario.rule(),
        compensation=None if scenario.compensation is None else scenario.compensation.build(),
        interventions=interventions,
        seed=scenario.seed,
        recording=scenario.recording.build(),
        processes=processes,
    )


def warm_up_of(scenario: ScenarioKeys, problem: Problem, interventions: Sequence[Intervention]) -> Simulation:
    """Make the simulation that is run until the warm-up ends."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    early = [change for change in interventions if begins_before(change, scenario.warm_up.until)]
    return simulation_of(before(scenario, interventions), problem, early)


def warmed(scenario: ScenarioKeys, problem: Problem, interventions: Sequence[Intervention]) -> Run:
    """Run the warm-up alone; the measures begin at its end."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    run = warm_up_of(scenario, problem, interventions).start(scenario.until)
    run.advance(to=scenario.warm_up.until)
    run.begin_measures()
    return run


def gone_on(scenario: ScenarioKeys, run: Run, interventions: Sequence[Intervention]) -> Run:
    """Begin what follows the warm-up, which goes on unaffected."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    late = [change for change in interventions if not begins_before(change, scenario.warm_up.until)]
    parts: dict[str, Any] = {}
    for name in scenario.warm_up.given():
        table = getattr(scenario, name)
        parts[name] = (one_of(name).read(EXCHANGED[name]) if table is None else table).build()
    return run.fork(**parts, interventions=late)


def run_with_warm_up(
    scenario: ScenarioKeys,
    problem: Problem,
    interventions: Sequence[Intervention],
    processes: Sequence[Callable[[System], ProcessGenerator]],
    watch: Callable[[float, int], None] | None,
    progress: bool,
) -> Result:
    """Run a scenario that has one."""
    if processes:
        allowed = "empty where there is a warm-up: what follows it is a fork, which no process can join"
        raise InputError.of("processes", processes, allowed)
    rest = gone_on(scenario, warmed(scenario, problem, interventions), interventions)
    return completed(rest, watch, progress)
