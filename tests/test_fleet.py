"""A fleet is held against agent processes: the same events, to the last bit, in any combination."""

from dataclasses import replace
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Crossing,
    CustomCosts,
    Fleet,
    InputError,
    Problem,
    Recording,
    Resource,
    Sampled,
    Simulation,
    SimulationError,
    averaging,
    latency,
    loss,
    responses,
    run_synchronous,
)
from aimd_des.channel import Broadcast, Copies, Draws
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.fleet import control_process
from aimd_des.fleet.compiled_agents import CompiledAgents
from aimd_des.interventions import Absence
from models import smart_cameras
from tests.conftest import quadratic_problem, quietly, random_problem
from tests.support.configurations import Configuration, assert_same, both, configurations

# -- any configuration -----------------------------------------------------------------------------------


@settings(max_examples=30)
@given(configurations())
def test_a_fleet_does_what_processes_do(configuration: Configuration) -> None:
    assert_same(*configuration.both())


@settings(max_examples=12)
@given(
    configurations(
        problem=st.builds(random_problem, st.integers(0, 999), st.integers(70, 200), st.just(2)),
        until=st.just(9.5),
    )
)
def test_copies_of_more_agents_than_a_block_holds(configuration: Configuration) -> None:
    assert_same(*configuration.both())


def test_there_is_something_to_compare() -> None:
    """Problems of this kind respond, hold and saturate, or the tests above would show nothing."""
    channel = BroadcastChannel(latency.Exponential(0.5), loss=0.2)
    _, fleet = both(random_problem(2, 5, 2), 20.0, channel=channel, seed=1, recording=Recording(events=True))
    kinds = fleet.events["kind"].value_counts()
    assert (kinds[["signal", "lost", "deliver", "respond", "hold"]] > 5).all()


# -- the paper's system ----------------------------------------------------------------------------------

# With clocks in phase both are held against the synchronous algorithm: see test_simulation.
PAPER: dict[str, dict[str, Any]] = {
    "own clocks": {
        "channel": BroadcastChannel(latency.Exponential(0.5), loss=0.1),
        "clocks": Clocks(1.0, "random", drift=1e-4),
        "recording": Recording(overshoot=False),
    },
    "crossing": {
        "dynamics": "continuous",
        "control_unit": Crossing(1.0),
        "channel": BroadcastChannel(latency.Exponential(0.5), loss=0.1),
    },
    "sampled": {
        "dynamics": "continuous",
        "control_unit": Sampled(),
        "channel": BroadcastChannel(latency.LogNormal(0.5, 1.0), loss=loss.GilbertElliott(0.2, 5.0)),
    },
}


@pytest.mark.slow
@pytest.mark.parametrize(("way", "until"), [("own clocks", 2e3), ("crossing", 4e3), ("sampled", 2e3)])
def test_the_papers_system_over_thousands_of_signals(way: str, until: float) -> None:
    assert_same(*both(smart_cameras(seed=0), until, seed=1, **PAPER[way]))


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"response": responses.EventNormalised()},
        {"response": responses.Derandomised("events"), "averaging": averaging.Polynomial(3.0)},
        {"response": responses.Derandomised("events", full=True), "averaging": averaging.Window(40.0)},
    ],
)
def test_in_phase_a_fleet_is_the_synchronous_algorithm(parts: dict[str, Any]) -> None:
    problem = smart_cameras(seed=3)
    late = Simulation(problem, agents=Fleet, channel=BroadcastChannel(latency=0.5), seed=4, **parts)
    assert late.run(2000.0).digest == run_synchronous(problem, steps=2000, seed=4, **parts).digest
    at_once = Simulation(problem, agents=Fleet, seed=4, **parts)
    assert at_once.run(2000.0).digest == run_synchronous(problem, steps=2000, seed=4, lag=0, **parts).digest


@pytest.mark.parametrize("way", PAPER)
def test_the_length_of_stretches_changes_nothing(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code stops after some looks, so that Ctrl-C does not wait long, and goes on where it stood."""
    simulation = Simulation(smart_cameras(seed=0), agents=Fleet, seed=1, **PAPER[way])
    whole = simulation.run(60.0)
    assert len(whole.signals_sent.time) > 20
    monkeypatch.setattr(control_process, "LOOKED_AT", 1)
    for steps in (1, 5):
        monkeypatch.setattr(control_process, "LEAST_STEPS", steps)
        result = simulation.run(60.0)
        assert result.digest == whole.digest
        assert (result.observations.total_average == whole.observations.total_average).all()


@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
def test_an_agent_that_leaves_at_once_has_an_average(agents: Any) -> None:
    """At the least of ages the weights of what is forgotten sum up to 0."""
    simulation = Simulation(
        random_problem(0, 4, 2),
        dynamics="continuous",
        control_unit=Crossing(0.5),
        averaging=averaging.Forgetting(4.5),
        interventions=[Absence(1, at=5e-324)],
        agents=agents,
        seed=1,
        recording=Recording(demand=2.5),
    )
    result = quietly(simulation.run, 10.0)
    assert np.isfinite(result.observations.total_average).all()
    assert (result.average_at_end[1] == 0.0).all()


# -- company ---------------------------------------------------------------------------------------------


class Deaf:
    """Hears nothing."""

    def __init__(self, agent: int, system: System) -> None:
        pass

    def receive(self, signal: Signal) -> None:
        pass

    def process(self) -> ProcessGenerator:
        yield from ()


@settings(max_examples=15)
@given(configurations(until=st.just(12.0)), st.data())
def test_processes_and_a_fleet_in_one_simulation(configuration: Configuration, data: st.DataObject) -> None:
    agents = st.integers(0, configuration.problem.n_agents - 1)
    special = data.draw(st.dictionaries(agents, st.sampled_from([Deaf, AgentProcess]), min_size=1))
    assert_same(*configuration.both(special=special))


def meddle(system: System) -> ProcessGenerator:
    """Set demands, send signals and look, between other events and at their instants."""
    for q in range(1, 16):
        yield system.env.at(0.75 * q, (EventKind.INTERVENE, EventKind.OBSERVE, EventKind.SENSE)[q % 3])
        if not system.conditions.away[q % system.problem.n_agents]:
            system.set_demand(q % system.problem.n_agents, 0, (q % 4) * system.total(0) / 4.0)
        if q % 5 == 0:
            system.broadcast(0)
        yield system.env.timeout(0.0)
        assert system.average(0, 0) >= 0.0


@settings(max_examples=15)
@given(configurations(until=st.just(12.0)))
def test_processes_that_meddle(configuration: Configuration) -> None:
    # Bursts of loss take broadcasts in the order of time only, and these are sent without delay.
    control_unit = replace(configuration.parts["control_unit"], sensing_delay=0.0)
    assert_same(*configuration.both(control_unit=control_unit, processes=[meddle]))


class Own:
    """A user's control unit: signals for everything in every unit of time."""

    def process(self, system: System) -> ProcessGenerator:
        for q in range(1, 1000):
            yield system.env.at(float(q), EventKind.SENSE)
            for j in range(system.problem.n_resources):
                system.broadcast(j)


class Late:
    """A user's latency."""

    def check(self, n_agents: int) -> None:
        pass

    def draw(self, draws: Draws) -> Any:
        return np.linspace(0.0, 2.0, draws.n_agents)


class Line:
    """A user's channel: agent i is i units of time away."""

    def open(self, n_agents: int, keys: Any) -> "Line":
        self.n = n_agents
        return self

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        return Copies(departure + np.arange(self.n, dtype=float))


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
@pytest.mark.parametrize(
    "parts",
    [{"control_unit": Own()}, {"channel": BroadcastChannel(Late(), 0.1)}, {"channel": Line()}],
    ids=["control unit", "latency", "channel"],
)
def test_the_users_own_parts(dynamics: str, parts: dict[str, Any]) -> None:
    assert_same(*both(random_problem(1, 6, 2), 30.0, dynamics=dynamics, seed=2, **parts))


def test_listeners_are_told_of_responses_in_the_order_of_time() -> None:
    heard: dict[bool, list[tuple[float, int, float]]] = {True: [], False: []}

    def listen(system: System) -> ProcessGenerator:
        own = heard[system.collective is not None]
        system.on_response.append(lambda *response: own.append(response))
        yield from ()

    parts = {"dynamics": "continuous", "control_unit": Crossing(0.5), "seed": 5}
    channel = BroadcastChannel(latency.Exponential(1.0), loss=0.1)
    assert_same(*both(random_problem(1, 6, 2), 30.0, channel=channel, processes=[listen], **parts))
    assert len(heard[True]) > 20
    assert heard[True] == heard[False]


# -- costs -----------------------------------------------------------------------------------------------


def own_costs(compiled: bool, separable: bool) -> CustomCosts:
    """Four agents and two resources: (i + 1) (x0**2 + x1**2 + x0 x1), or without the product."""
    mix = 0.0 if separable else 1.0

    def value(i: int, x: Any) -> Any:
        return (i + 1) * (x[0] * x[0] + x[1] * x[1] + mix * x[0] * x[1])

    def gradient(i: int, x: Any) -> Any:
        return np.array([(i + 1) * (2 * x[0] + mix * x[1]), (i + 1) * (2 * x[1] + mix * x[0])])

    return CustomCosts(4, 2, value, numba.njit(gradient) if compiled else gradient, separable=separable)


def own_problem(costs: CustomCosts) -> Problem:
    names = ("memory", "disk")
    return Problem(
        [Resource(name, capacity=3.0, increase=0.05, decrease=0.6, normalization=0.03) for name in names],
        costs,
    )


@pytest.mark.parametrize("separable", [True, False])
@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_compiled_gradients_of_the_user(dynamics: str, separable: bool) -> None:
    problem = own_problem(own_costs(compiled=True, separable=separable))
    channel = BroadcastChannel(latency.Exponential(0.7), loss=0.1)
    processes, fleet = both(problem, 100.0, dynamics=dynamics, channel=channel, seed=3)
    assert_same(processes, fleet)
    assert fleet.account.responses.sum() > 50


@pytest.mark.parametrize("raising", [True, False])
def test_a_gradient_that_fails_in_the_run_is_named(raising: bool) -> None:
    # At levels of which no sample is taken when the problem is made.
    def gradient(i: int, x: Any) -> Any:
        if 0.38 < x[1] < 0.44:
            if raising:
                raise ValueError("unknown here")
            return np.array([2 * x[0], np.nan])
        return 2 * (i + 1) * x

    def value(i: int, x: Any) -> Any:
        return (i + 1) * (x[0] ** 2 + x[1] ** 2)

    told = r"^CustomCosts\.gradient\(\) = nan: must be a finite number$"
    for agents, own in ((Fleet, numba.njit(gradient)), (AgentProcess, gradient)):
        problem = own_problem(CustomCosts(4, 2, value, own, separable=True))
        plain = raising and agents is AgentProcess
        said = r"^unknown here\nraised in CustomCosts\.gradient\(\)$" if plain else told
        with pytest.raises(ValueError, match=said):
            Simulation(problem, agents=agents, seed=0, dynamics="continuous").run(100.0)


def test_gradients_in_plain_python_are_refused_with_the_remedy() -> None:
    problem = own_problem(own_costs(compiled=False, separable=True))
    with pytest.raises(
        InputError, match=r"decorate the gradient with numba\.njit, or choose agents=AgentProcess"
    ):
        Simulation(problem, agents=Fleet, seed=0).run(10.0)


# -- errors ----------------------------------------------------------------------------------------------


def message(agents: Any, problem: Problem, **parts: Any) -> str:
    with pytest.raises(SimulationError) as caught:
        Simulation(problem, agents=agents, seed=0, **parts).run(1000.0)
    return str(caught.value)


def test_time_that_stands_still_is_an_error() -> None:
    parts: dict[str, Any] = {
        "dynamics": "continuous",
        "control_unit": Crossing(0.0),
        "channel": BroadcastChannel(loss=1.0),
    }
    found = {message(agents, quadratic_problem([1.0, 2.0]), **parts) for agents in (AgentProcess, Fleet)}
    assert len(found) == 1
    assert "set hold_off greater than 0" in found.pop()


def test_a_trace_that_ends_is_the_same_error() -> None:
    parts: dict[str, Any] = {"channel": BroadcastChannel(loss=loss.Trace([0, 1], repeat=False))}
    problem = smart_cameras(seed=0)
    found = {message(agents, problem, **parts) for agents in (AgentProcess, Fleet)}
    assert len(found) == 1
    assert "no row in a trace of 2" in found.pop()


@pytest.mark.parametrize(
    ("special", "words"), [({7: AgentProcess}, "index in special = 7"), ({0: Fleet}, "special[0]")]
)
def test_special_agents_are_checked(special: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        Simulation(quadratic_problem([1.0, 2.0]), agents=Fleet, special=special, seed=0)
    assert words in str(caught.value)


# -- memory ----------------------------------------------------------------------------------------------


def test_memory_is_bounded_by_what_is_in_flight() -> None:
    rooms: dict[float, int] = {}

    def watch(until: float) -> Any:
        def look(system: System) -> ProcessGenerator:
            yield system.env.at(until - 0.5, EventKind.OBSERVE)
            assert isinstance(system.collective, CompiledAgents)
            rooms[until] = system.collective.agents.room

        return look

    for until in (500.0, 5000.0):
        Simulation(
            smart_cameras(seed=0),
            dynamics="continuous",
            control_unit=Crossing(1.0),
            channel=BroadcastChannel(latency.Exponential(10.0), loss=0.1),
            agents=Fleet,
            processes=[watch(until)],
            seed=1,
        ).run(until)
    # There is space for what was in flight at most, and for twice as much where it ran out.  The maximum
    # scatters a little more in a run of ten times the length.
    assert rooms[5000.0] <= 2.0 * 1.5 * rooms[500.0]


def test_a_fleet_makes_no_views_for_processes() -> None:
    run = Simulation(smart_cameras(seed=0), agents=Fleet, seed=1).start(20.0)
    run.result()
    assert not {"rows", "_lines"} & vars(run.system).keys()
