"""Results can be sent to other processes, and copied."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    Recording,
    Result,
    Simulation,
    latency,
)
from tests.conftest import quadratic_problem


@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda result: pickle.loads(pickle.dumps(result))])
def test_a_result_with_its_event_log_is_copied_whole(agents: Any, copied: Callable[[Result], Result]) -> None:
    """Only the log of a fleet is led by it, and the fleet holds a run that cannot be sent."""
    problem = quadratic_problem([1.0, 2.0, 3.0], capacity=1.0, increase=0.05, normalization=0.1)
    simulation = Simulation(
        problem,
        dynamics="continuous",
        control_unit=Crossing(1.0),
        agents=agents,
        recording=Recording(events=True),
        seed=1,
    )
    result = simulation.run(60.0)
    other = copied(result)
    assert len(result.events) > 50
    assert other.events.equals(result.events)
    assert other.digest == result.digest
    assert other.summary().equals(result.summary())


def test_few_agents_have_many_copies_in_flight() -> None:
    """Far more than a broadcast has copies: processes put each in its place, a fleet has its own way."""
    simulation = Simulation(
        quadratic_problem([1.0, 1.0], capacity=1.0, increase=0.5, normalization=0.002),
        dynamics="continuous",
        control_unit=Crossing(0.01),
        channel=BroadcastChannel(latency.Uniform(0.0, 8.0), 0.1, duplication=0.2),
        recording=Recording(events=True),
        seed=2,
    )
    run = simulation.start(12.0)
    run.advance(to=11.0)
    assert len(run.system.transmitter.carrier._due) > 64 * 2
    result = run.result()
    simulation.agents = Fleet
    assert simulation.run(12.0).digest == result.digest
