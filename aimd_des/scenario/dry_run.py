"""What a run would refuse, found out without running."""

from aimd_des.interventions import check_end
from aimd_des.problem.problem import Problem
from aimd_des.scenario.scenario import Scenario
from aimd_des.synchronous.synchronous import check_steps
from aimd_des.utils import rng
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Purpose


def check_to_run(scenario: Scenario) -> Problem:
    """Hold a scenario's parts against the number of agents and the end of the run."""
    (problem, interventions), recording = scenario.built(), scenario.recording.build()
    synchronous = scenario.dynamics == "synchronous"
    if synchronous:
        check_steps("until", int(scenario.until), problem)
    if synchronous and recording.events:
        raise InputError.of("recording.events", True, "false: the synchronous algorithm has no events")
    for look in ("demand", "allocations"):
        recording.times(look, scenario.until, whole=synchronous)
    if not synchronous:
        check_end(interventions, scenario.until)
        keys = {purpose: rng.key(scenario.seed, purpose) for purpose in Purpose}
        scenario.channel.build().open(problem.n_agents, keys)
        if scenario.dynamics == "discrete":
            scenario.clocks.build().start(problem.n_agents, keys[Purpose.CLOCK])
    return problem
