"""A scenario as a simulation, and its warm-up: the beginning, which measures leave out and runs can share."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.declared import Intervention
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.run_in_progress import Run, completed
from aimd_des.engine.simulation import Simulation
from aimd_des.engine.system import System
from aimd_des.fleet import Fleet
from aimd_des.problem.problem import Problem
from aimd_des.results.result import Result
from aimd_des.scenario.kind_tables import KindTable, one_of
from aimd_des.scenario.strict_table import Table
from aimd_des.scenario.tables import ChannelSettings
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

if TYPE_CHECKING:
    from aimd_des.scenario.scenario import Scenario

    ControlUnitTable = KindTable
    ResponseTable = KindTable
else:
    ControlUnitTable = one_of("control_unit")
    ResponseTable = one_of("response")

#: What may be other during a warm-up, and what stands for a part that a scenario does not name.
EXCHANGED: dict[str, dict[str, Any]] = {
    "control_unit": {"kind": "sampled"},
    "channel": {},
    "response": {"kind": "randomised"},
}


class WarmUpSettings(Table):
    """``[warm_up]``: the beginning of the run, which its measures leave out.

    Attributes
    ----------
    until : float
        When it ends: after 0, and before the end of the run.
    control_unit, channel, response : table, optional
        In force until then; default: those of the scenario.
    """

    until: float
    control_unit: ControlUnitTable | None = None
    channel: ChannelSettings | None = None
    response: ResponseTable | None = None

    def check(self, until: float) -> None:
        """Refuse one that does not end within the run.

        Parameters
        ----------
        until : float
            The end of the run.

        Raises
        ------
        InputError
            If it does not.
        """
        validation.number("warm_up.until", self.until, low=0.0, high=until, low_open=True, high_open=True)

    def given(self) -> dict[str, Any]:
        """Name the parts that are other until then.

        Returns
        -------
        dict
            Their tables.
        """
        return {name: table for name in EXCHANGED if (table := getattr(self, name)) is not None}


def begins_before(change: object, time: float) -> bool:
    """Tell whether an intervention acts before a time; one that does not say when it begins may do so."""
    return bool(getattr(change, "begins", 0.0) < time)


def before(scenario: "Scenario", interventions: Sequence[Intervention]) -> "Scenario":
    """Give the scenario that is run until the warm-up ends: equal ones can share it."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    tables = zip(scenario.interventions, interventions, strict=True)
    early = [table for table, change in tables if begins_before(change, scenario.warm_up.until)]
    alone = {"warm_up": WarmUpSettings(until=scenario.warm_up.until), "interventions": early}
    return scenario.model_copy(update={**scenario.warm_up.given(), **alone})


def simulation_of(
    scenario: "Scenario",
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


def warm_up_of(scenario: "Scenario", problem: Problem, interventions: Sequence[Intervention]) -> Simulation:
    """Make the simulation that is run until the warm-up ends."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    early = [change for change in interventions if begins_before(change, scenario.warm_up.until)]
    return simulation_of(before(scenario, interventions), problem, early)


def warmed(scenario: "Scenario", problem: Problem, interventions: Sequence[Intervention]) -> Run:
    """Run the warm-up alone; the measures begin at its end."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    run = warm_up_of(scenario, problem, interventions).start(scenario.until)
    run.advance(to=scenario.warm_up.until)
    run.begin_measures()
    return run


def gone_on(scenario: "Scenario", run: Run, interventions: Sequence[Intervention]) -> Run:
    """Begin what follows the warm-up, which goes on unaffected."""
    assert scenario.warm_up is not None  # noqa: S101 - asked for where there is one
    late = [change for change in interventions if not begins_before(change, scenario.warm_up.until)]
    parts: dict[str, Any] = {}
    for name in scenario.warm_up.given():
        table = getattr(scenario, name)
        parts[name] = (one_of(name).read(EXCHANGED[name]) if table is None else table).build()
    return run.fork(**parts, interventions=late)


def run_with_warm_up(
    scenario: "Scenario",
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
