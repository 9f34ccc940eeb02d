"""Parameters of the rule that change while a run goes on: by functions, obeyed alike, and told of."""

from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    averaging,
    compensation,
    run_synchronous,
)
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import (
    Absence,
    CapacityStep,
    set_capacity,
    set_decrease,
    set_increase,
    set_normalization,
    set_threshold,
)
from tests.conftest import quadratic_problem, quietly, random_problem

BOTH = pytest.mark.parametrize("agents", [AgentProcess, Fleet])
EVENTS = Recording(demand="end", events=True)


def growing(n: int = 3, **changes: Any) -> Problem:
    """Agents that add 1 per unit of time and never reach the capacity, unless it is said."""
    return quadratic_problem([1.0 + i for i in range(n)], **{"capacity": 1e6, "increase": 1.0, **changes})


def at(time: float, *acts: Any) -> Any:
    """A process that does something at one time."""

    def process(system: System) -> ProcessGenerator:
        yield system.env.at(time, EventKind.INTERVENE)
        for act in acts:
            act(system)

    return process


def run(problem: Problem, until: float, *processes: Any, **parts: Any) -> Result:
    options: dict[str, Any] = {"dynamics": "continuous", "control_unit": Sampled(), "seed": 1, **parts}
    return quietly(Simulation(problem, processes=processes, **options).run, until)


def test_a_normalization_that_changes_is_obeyed_alike() -> None:
    """The issue's: 138 responses by agents that did not see the change, 231 by a fleet that did."""
    problem = quadratic_problem(
        [1.0, 2.0, 3.0, 1.5], capacity=2.0, increase=0.05, decrease=0.7, normalization=0.05
    )
    change = at(50.0, lambda system: set_normalization(system, "memory", 0.1))
    runs = [run(problem, 200.0, change, agents=agents, recording=EVENTS) for agents in (AgentProcess, Fleet)]
    assert runs[0].digest == runs[1].digest
    assert [int(each.account.responses.sum()) for each in runs] == [231, 231]
    assert int(run(problem, 200.0).account.responses.sum()) != 231


@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
@pytest.mark.parametrize(
    "way",
    [
        averaging.Cumulative(),
        averaging.Window(20.0, parts=4),
        averaging.Forgetting(9.0),
        averaging.Polynomial(1.5),
    ],
    ids=type,
)
def test_processes_and_a_fleet_obey_alike(way: Any, dynamics: str) -> None:
    problem = random_problem(7, 5, 2, "coupled", per_agent=True)
    name = problem.resource_names[1]

    def meddle(system: System) -> ProcessGenerator:
        """Change everything, at ticks and between them, of those who are here and of those who are away."""
        for turn in range(12):
            yield system.env.at(2.0 + 1.5 * turn, EventKind.INTERVENE)
            j, scale = turn % 2, 1.0 + 0.2 * (turn % 3)
            set_normalization(system, j, 0.8 * problem.normalization[j] * scale)
            set_increase(system, [turn % 5, (turn + 1) % 5], j, problem.increase[0, j] * scale)
            set_decrease(system, [0, "3"], name, 0.3 + 0.05 * turn)
            set_threshold(system, 0, 1.0 - 0.05 * (turn % 4))
            set_capacity(system, 1, problem.capacity[1] * scale)

    parts: dict[str, Any] = {
        "dynamics": dynamics,
        "averaging": way,
        "interventions": [Absence(1, 4.0, 9.0), CapacityStep(0, 11.0, float(problem.capacity[0]))],
        "channel": BroadcastChannel(latency=0.7, loss=0.1),
    }
    for unit in (Sampled(), Crossing(0.8)):
        if dynamics == "discrete" and isinstance(unit, Crossing):
            continue
        for recording in (EVENTS, Recording(demand=1.0)):
            one, other = (
                run(problem, 25.0, meddle, agents=agents, control_unit=unit, recording=recording, **parts)
                for agents in (AgentProcess, Fleet)
            )
            assert one.digest == other.digest
            assert len(one.signals) > 5
            for peak in ("peak", "time", "mean"):
                ours, theirs = (getattr(each.observations.overshoot, peak) for each in (one, other))
                assert np.array_equal(ours, theirs)


@BOTH
def test_who_grows_faster_does_so_from_then_on(agents: Any) -> None:
    """Agent 0 adds 1 up to 4 and 3 from there: 10 at 6, with the integral 8 + 2 * 7."""
    change = at(4.0, lambda system: set_increase(system, "0", 0, 3.0))
    result = run(growing(), 6.0, change, agents=agents)
    assert result.demand_at_end.ravel().tolist() == [10.0, 6.0, 6.0]
    assert result.average_at_end[0, 0] == pytest.approx(22.0 / 6.0, rel=1e-12)
    # On the clock, x(4) = 4 and the tick of 4 adds 3 already: x(5) = 7.
    result = run(growing(), 6.0, change, agents=agents, dynamics="discrete")
    assert result.demand_at_end.ravel().tolist() == [10.0, 6.0, 6.0]
    assert result.average_at_end[0, 0] == pytest.approx((1 + 2 + 3 + 4 + 7 + 10) / 7.0, rel=1e-12)


@BOTH
def test_the_total_crosses_as_soon_as_faster_growth_lets_it(agents: Any) -> None:
    """Total 3t up to 4, then 8 a unit of time: 20 is reached at 5 and not at 20/3; the peak is 20 there."""
    change = at(4.0, lambda system: set_increase(system, [0, 1], "memory", 3.5))
    problem = growing(capacity=20.0, normalization=1e-9)
    result = run(problem, 5.5, change, agents=agents, control_unit=Crossing(9.0))
    assert result.signals["time"].tolist() == [5.0]
    assert result.pieces["overshoot_peak"].tolist() == pytest.approx([0.6, 1.2], rel=1e-12)


@BOTH
def test_who_is_away_grows_faster_when_it_is_back(agents: Any) -> None:
    change = at(3.0, lambda system: set_increase(system, 0, 0, 5.0))
    absence = Absence(0, 2.0, 6.0)
    result = run(growing(), 8.0, change, agents=agents, interventions=[absence])
    assert result.demand_at_end.ravel().tolist() == [10.0, 8.0, 8.0]


@BOTH
def test_a_smaller_threshold_is_sensed_at_once_and_moves_with_the_capacity(agents: Any) -> None:
    problem = growing(capacity=100.0, normalization=1e-9)
    lower = at(10.0, lambda system: set_threshold(system, 0, 0.25))
    parts: dict[str, Any] = {"agents": agents, "control_unit": Crossing(50.0)}
    assert run(problem, 20.0, lower, **parts).signals["time"].tolist() == [10.0]
    changes = [lambda system: set_capacity(system, 0, 200.0), lambda system: set_threshold(system, 0, 0.25)]
    for order in (changes, changes[::-1]):
        result = run(problem, 20.0, at(5.0, *order), **parts)
        assert result.signals["time"].tolist() == pytest.approx([50.0 / 3])


@BOTH
def test_responses_after_a_change_have_the_new_factor(agents: Any) -> None:
    """Everybody responds for certain to the signal of 6: at 6 agent 1 keeps a tenth, the others a half."""
    change = at(5.0, lambda system: set_decrease(system, 1, 0, 0.1))
    problem = growing(capacity=17.5, decrease=0.5, normalization=1e3)
    assert run(problem, 6.5, change, agents=agents).demand_at_end.ravel() == pytest.approx([3.5, 1.1, 3.5])


def test_each_change_is_told_and_begins_a_piece() -> None:
    changes = [
        at(2.0, lambda system: set_normalization(system, 0, 0.5)),
        at(3.0, lambda system: set_threshold(system, 0, 0.75)),
        at(4.0, lambda system: set_increase(system, [1, 0], 0, 2.0)),
        at(5.0, lambda system: set_decrease(system, 1, 0, 0.25)),
    ]
    result = run(growing(2), 6.0, *changes, recording=EVENTS)
    events = result.events[["time", "kind", "agent", "value"]].astype({"agent": object}).fillna("all")
    assert events.to_numpy().tolist() == [
        [2.0, "normalization", "all", 0.5],
        [3.0, "threshold", "all", 0.75],
        [4.0, "increase", "1", 2.0],
        [4.0, "increase", "0", 2.0],
        [5.0, "decrease", "1", 0.25],
    ]
    assert result.pieces["start"].tolist() == [0.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda system: set_normalization(system, 0, 0.0), "normalization = 0.0"),
        (lambda system: set_normalization(system, "memroy", 0.1), "did you mean 'memory'?"),
        (lambda system: set_threshold(system, 0, 1.5), "threshold = 1.5"),
        (lambda system: set_increase(system, 0, 0, -1.0), "increase = -1.0"),
        (lambda system: set_increase(system, [], 0, 1.0), "one agent or several"),
        (lambda system: set_decrease(system, 0, 0, 1.0), "decrease = 1.0"),
        (lambda system: set_decrease(system, 3, 0, 0.5), "agent = 3"),
    ],
)
def test_changes_are_checked(act: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        run(growing(), 2.0, at(1.0, act))
    assert words in str(caught.value)


@BOTH
def test_what_is_handed_out_cannot_be_written(agents: Any) -> None:
    arrays: dict[str, Any] = {}

    def collect(system: System) -> None:
        for name in ("increase", "decrease", "normalization", "limit", "capacity"):
            arrays[f"parameters.{name}"] = getattr(system.parameters, name)
        arrays["parameters.compensation.loss"] = system.parameters.compensation.loss
        for name in ("away", "cut", "cuts", "failed", "growth", "threshold", "increase", "weights"):
            arrays[f"conditions.{name}"] = getattr(system.conditions, name)
        for name in ("capacity", "threshold", "normalization", "increase", "decrease"):
            arrays[f"problem.{name}"] = getattr(system.problem, name)

    steps = [CapacityStep(0, 2.0, 5.0)]
    known = compensation.KnownLoss(0.1)
    result = run(growing(), 4.0, at(3.0, collect), agents=agents, interventions=steps, compensation=known)
    for number, piece in enumerate(result.history):
        arrays[f"pieces[{number}].capacity"], arrays[f"pieces[{number}].present"] = piece[1:3]
    assert len(arrays) == 23
    for name, array in arrays.items():
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1
        assert array.flags.writeable is False, name


def test_an_agents_own_parameters_cannot_be_written() -> None:
    """They are read by agents of one's own; an assignment would be obeyed by nobody else."""

    class Meddling(AgentProcess):
        def __init__(self, agent: int, system: System) -> None:
            super().__init__(agent, system)
            self.normalization[0] *= 2.0  # type: ignore[index]

    with pytest.raises(TypeError, match="item assignment"):
        run(growing(), 2.0, agents=Meddling)


def test_the_synchronous_algorithm_is_as_it_was() -> None:
    problem = random_problem(3, 5, 2)
    parts: dict[str, Any] = {"dynamics": "discrete", "channel": BroadcastChannel(latency=0.5)}
    assert run(problem, 80.0, **parts).digest == quietly(run_synchronous, problem, steps=80, seed=1).digest
