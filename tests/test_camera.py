"""One agent as one process: the rule, read literally, with clocks of their own and in continuous time."""

from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    CoupledCosts,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Simulation,
)
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from tests.conftest import (
    quadratic_problem,
    quietly,
    random_problem,
    resource,
)
from tests.support.scripts import Script, exactly, send_at, story


def simulate(problem: Problem, until: float, seed: int = 0, **parts: Any) -> Result:
    return quietly(Simulation(problem, seed=seed, **parts).run, until)


# -- one agent by hand -----------------------------------------------------------------------------------


def two_resources(**changes: Any) -> Problem:
    """One agent and costs with which it responds to every signal: 2 Gamma c = 1."""
    shared = {"capacity": 1000.0, "increase": 1.0, "normalization": 0.5, **changes}
    pair = [resource(name, **shared) for name in ("memory", "disk")]
    return Problem(pair, PolynomialCosts([2], [[[1.0], [1.0]]]))


def test_the_first_signal_that_sets_the_latch_is_the_one_that_is_answered() -> None:
    # Broadcast 1 overtakes broadcast 0; both arrive between the ticks at 4 and 5.
    problem = quadratic_problem([1.0], capacity=1000.0, normalization=0.5)
    parts = {"channel": Script([4.75], [4.5]), "processes": [send_at(1.0, 0), send_at(2.0, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    assert story(result) == [
        "1 signal 0",
        "2 signal 1",
        "4.5 agent 0 deliver 1",
        "4.75 agent 0 deliver 0",
        "5 agent 0 respond 1",
    ]


def test_there_is_a_latch_for_each_resource() -> None:
    parts = {"channel": Script([4.5]), "processes": [send_at(1.0, 1), send_at(2.0, 0)]}
    result = simulate(two_resources(), 6.0, recording=Recording(events=True), **parts)
    answers = result.events[result.events["kind"] == "respond"]
    assert answers["time"].tolist() == [5.0, 5.0]
    assert answers["resource"].tolist() == ["memory", "disk"]  # in their order, not that of the signals
    assert answers["value"].tolist() == [2.5, 2.5]


def test_the_latch_is_cleared_by_the_tick() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, normalization=0.5)
    parts = {"channel": Script([4.5], [5.0], [5.5]), "processes": [send_at(1.0, 0, 0, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    # The copy that arrives at 5 comes before the tick at 5 and finds the latch set.
    assert [line for line in story(result) if "respond" in line] == [
        "5 agent 0 respond 0",
        "6 agent 0 respond 2",
    ]


def test_a_continuous_agent_answers_each_copy_in_the_instant_in_which_it_arrives() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    channel = BroadcastChannel(latency=0.25, duplication=1.0)
    parts = {"dynamics": "continuous", "channel": channel, "processes": [send_at(3.75, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    assert story(result) == [
        "3.75 signal 0",
        "4 agent 0 deliver 0",
        "4 agent 0 respond 0",
        "4 agent 0 deliver 0",
        "4 agent 0 respond 0",
    ]
    assert result.events["value"].tolist() == [3.75, 0.0, 2.0, 1.0, 1.0]  # 4 to 2 to 1; a duplicate is a 1
    assert result.demand_at_end.tolist() == [[1.0 + 4.0]]
    assert result.average_at_end.tolist() == [[(4 * 4 / 2 + 4 * 1 + 4 * 4 / 2) / 8]]


def test_a_discrete_agent_answers_a_copy_and_its_duplicate_once() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    channel = BroadcastChannel(latency=0.25, duplication=1.0)
    parts = {"channel": channel, "processes": [send_at(3.5, 0)]}
    result = simulate(problem, 8.0, recording=Recording(demand=1.0, events=True), **parts)
    assert [line for line in story(result) if "respond" in line] == ["4 agent 0 respond 0"]
    assert result.observations.total_demand[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 2.0, 3.0, 4.0, 5.0]
    assert result.average_at_end.tolist() == [[(0 + 1 + 2 + 3 + 4 + 2 + 3 + 4 + 5) / 9]]


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_who_holds_nothing_has_nothing_to_give_back(dynamics: str) -> None:
    # At 0 the average is 0 and lambda is 0; a discrete agent that answers holds instead of adding.
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    parts = {"dynamics": dynamics, "processes": [send_at(0.0, 0)]}
    result = simulate(problem, 3.0, recording=Recording(events=True), **parts)
    assert story(result) == ["0 signal 0", "0 agent 0 deliver 0", "0 agent 0 hold 0"]
    assert result.demand_at_end.tolist() == [[2.0 if dynamics == "discrete" else 3.0]]


def test_averages_are_taken_before_any_answer() -> None:
    # f = (x + y)**2 / 2 reads both averages.  A tick at which both latches are set folds both demands in
    # before either is cut, so both probabilities are Gamma (x + y) / x = 2 Gamma.
    own = PolynomialCosts([2], [[[0.0], [0.0]]])
    costs = CoupledCosts(own, weights=[[1.0, 1.0]], sum_coefficients=[[0.5]])
    asked: list[tuple[list[float], int]] = []

    class Asked(AgentProcess):
        def __init__(self, agent: int, system: System) -> None:
            super().__init__(agent, system)
            derivative = self.marginal_cost

            def remember(averages: list[float], j: int) -> float:
                asked.append((list(averages), j))
                return float(derivative(averages, j))

            self.marginal_cost = remember

    pair = [resource(name, capacity=1000.0, increase=1.0, normalization=0.5) for name in ("memory", "disk")]
    simulate(Problem(pair, costs), 6.0, agents=Asked, processes=[send_at(4.0, 0, 1)])
    assert asked == [([2.0, 2.0], 0), ([2.0, 2.0], 1)]


def test_an_answer_of_ones_own_is_asked_for_in_continuous_time() -> None:
    """A signal that is answered when it arrives goes to the method of the derived class, too."""
    answered: list[tuple[list[int], float]] = []

    class Noting(AgentProcess):
        def answer(self, signals: Any, moment: float) -> None:
            answered.append(([signal.resource for signal in signals], moment))
            super().answer(signals, moment)

    parts: dict[str, Any] = {"dynamics": "continuous", "processes": [send_at(3.0, 0), send_at(4.5, 1)]}
    own = simulate(two_resources(), 6.0, agents=Noting, **parts)
    assert answered == [([0], 3.0), ([1], 4.5)]
    assert own.digest == simulate(two_resources(), 6.0, **parts).digest


@pytest.mark.parametrize(
    ("options", "times"),
    [
        ({"period": 1.0}, [4.0, 4.0, 4.0]),
        ({"period": 1.0, "phase": [0.0, 0.25, 0.5]}, [4.0, 3.25, 3.5]),
        ({"period": [1.0, 0.75, 3.0]}, [4.0, 3.75, 6.0]),
        ({"period": 1.0, "drift": [0.0, 0.25, -0.5]}, [4.0, 3.75, 3.5]),
    ],
)
def test_each_agent_answers_at_the_next_tick_of_its_own_clock(
    options: dict[str, Any], times: list[float]
) -> None:
    problem = quadratic_problem([1.0] * 3, capacity=1000.0, normalization=0.5)
    parts = {"clocks": Clocks(**options), "processes": [send_at(3.125, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    answers = result.events[result.events["kind"] == "respond"].sort_values("agent")
    assert answers["time"].tolist() == times


# -- the state of one agent, read and set ----------------------------------------------------------------


@pytest.mark.parametrize(
    "parts", [{"dynamics": "continuous"}, {}, {"clocks": Clocks(0.7, "random", 0.01, 0.2)}]
)
def test_one_agent_is_read_as_all_are(parts: dict[str, Any]) -> None:
    problem, seen = random_problem(4, 5, 2, "coupled"), []

    def read(system: System) -> ProcessGenerator:
        for q in range(60):
            yield system.env.at(0.37 * q, EventKind.OBSERVE)
            demand, average = system.allocations()
            agents = range(5)
            each = [
                [[read_one(i, j) for i in agents] for j in range(2)]
                for read_one in (system.demand, system.average)
            ]
            seen.append((demand.tolist(), average.tolist()) == tuple(each))
            seen.append(system.totals().tolist() == [sum(row) for row in demand.tolist()])
            seen.append(system.totals().tolist() == [system.total(j) for j in range(2)])

    result = simulate(problem, 25.0, channel=BroadcastChannel(0.3, 0.2), processes=[read], **parts)
    assert result.account.responses.sum() > 10
    assert seen == [True] * 180


@pytest.mark.parametrize("time", [3.5, 4.0])
def test_a_discrete_demand_that_is_set_grows_on_from_the_next_tick(time: float) -> None:
    # At 4 as between 3 and 4, what is set is the demand that the tick at 4 finds.
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)

    def intervene(system: System) -> ProcessGenerator:
        yield system.env.at(time, EventKind.INTERVENE)
        system.set_demand(0, 0, 10.0)

    result = simulate(problem, 7.0, processes=[intervene], recording=Recording(demand=1.0, events=True))
    held = [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0]
    assert result.observations.total_demand[:, 0].tolist() == held
    averages = [sum(held[: k + 1]) / (k + 1) for k in range(8)]
    np.testing.assert_allclose(result.observations.total_average[:, 0], averages, rtol=1e-15)
    assert result.events["value"].tolist() == [6.0]
    assert story(result) == [f"{exactly(time)} agent 0 change -1"]


def test_a_continuous_demand_that_is_set_grows_on_at_once() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)

    def intervene(system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.INTERVENE)
        system.set_demand(0, 0, 0.0)
        yield system.env.at(4.0, EventKind.INTERVENE)
        system.set_demand(0, 0, 8.0)

    result = simulate(
        problem, 8.0, dynamics="continuous", processes=[intervene], recording=Recording(events=True)
    )
    assert result.events["value"].tolist() == [-3.0, 7.0]
    assert result.demand_at_end.tolist() == [[12.0]]
    assert result.average_at_end.tolist() == [[(3 * 3 / 2 + 1 / 2 + 8 * 4 + 4 * 4 / 2) / 8]]
