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
    Result,
    Sampled,
    Simulation,
    SimulationError,
    averaging,
    compensation,
    latency,
    loss,
    run_synchronous,
)
from aimd_des.channel import Broadcast, Copies, Draws
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.fleet.compiled_agents import CompiledAgents
from models import smart_cameras
from tests.conftest import problems, quadratic_problem, quietly, random_problem
from tests.disturbances import disturbances, networks

SHARED = ("polynomial", "coupled")


def both(problem: Problem, until: float, **parts: Any) -> tuple[Result, Result]:
    """Run with a process for each agent, and with a fleet."""
    for name, made in parts.items():
        if callable(made):  # what depends on the number of agents
            parts[name] = made(problem)
    processes = quietly(Simulation(problem, agents=AgentProcess, **parts).run, until)
    return processes, quietly(Simulation(problem, agents=Fleet, **parts).run, until)


def assert_same(processes: Result, fleet: Result) -> None:
    """All that a run keeps is the same, and not only what the digest covers."""
    assert processes.digest == fleet.digest
    for name in ("demand_times", "total_demand", "total_average", "demand", "average"):
        one, other = getattr(processes.observations, name), getattr(fleet.observations, name)
        assert np.array_equal(one, other), name
    for name in ("peak", "time", "mean"):
        one, other = (getattr(result.observations.overshoot, name) for result in (processes, fleet))
        assert np.array_equal(one, other, equal_nan=True), name
    for one, other in zip(processes.observations.stretches, fleet.observations.stretches, strict=True):
        for name in ("start", "end", "capacity", "peak", "above", "excess", "used"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for one, other in zip(processes.history, fleet.history, strict=True):
        assert one.start == other.start
        assert np.array_equal(one.capacity, other.capacity)
        assert np.array_equal(one.present, other.present)
    for name in ("delivered", "lost", "in_flight", "duplicated", "responses", "saturated"):
        assert np.array_equal(getattr(processes.account, name), getattr(fleet.account, name)), name


# -- any configuration -----------------------------------------------------------------------------------


times = st.sampled_from([0.0, 0.25, 0.5, 1.0, 1.5]) | st.floats(0.0, 3.0)
probabilities = st.sampled_from([0.0, 0.3]) | st.floats(0.0, 0.9)
positive = st.floats(0.05, 3.0)


def latencies() -> st.SearchStrategy[Any]:
    return st.one_of(
        times,
        st.builds(lambda low, more: latency.Uniform(low, low + more), times, times),
        st.builds(latency.Exponential, times),
        st.builds(latency.ShiftedGamma, positive, positive, times),
        st.builds(latency.LogNormal, positive, times),
        st.builds(latency.Pareto, st.floats(0.3, 4.0), positive),
        st.builds(latency.Empirical, st.lists(times, min_size=1, max_size=5)),
    )


def losses() -> st.SearchStrategy[Any]:
    single = st.one_of(
        probabilities,
        st.builds(loss.CommonMode, probabilities),
        st.builds(loss.GilbertElliott, probabilities, positive),
        st.builds(
            lambda rows: loss.Trace(rows, repeat=True), st.lists(st.booleans(), min_size=1, max_size=7)
        ),
    )
    return single | st.builds(loss.Combined, single, single)


def channels() -> st.SearchStrategy[BroadcastChannel]:
    return st.builds(
        BroadcastChannel,
        latency=latencies(),
        loss=losses(),
        duplication=st.sampled_from([0.0, 0.0, 0.4]),
        fifo=st.booleans(),
    )


recordings = st.builds(
    Recording,
    demand=st.sampled_from(["auto", "end", 0.5, [0.0, 2.5, 5.0]]),
    allocations=st.sampled_from(["end", 3.0]),
    tail=st.sampled_from([0, 3]),
    overshoot=st.booleans(),
    events=st.booleans(),
)
clocks = st.builds(
    Clocks,
    period=st.sampled_from([1.0, 0.5, 1.3]),
    phase=st.sampled_from([0.0, 0.25, "random"]),
    drift=st.sampled_from([0.0, 0.01]),
    jitter=st.sampled_from([0.0, 0.0, 0.3]),
)
samplers = st.builds(
    Sampled,
    period=st.sampled_from([1.0, 0.5, 0.7]),
    phase=st.sampled_from([0.0, 0.25]),
    sensing_delay=st.sampled_from([0.0, 0.0, 0.5]),
)
crossers = st.builds(
    Crossing,
    hold_off=st.sampled_from([1.0, 0.5]) | st.floats(0.1, 3.0),
    sensing_delay=st.sampled_from([0.0, 0.5]),
    longest_hold_off=st.sampled_from([None, None, 3.0, 8.0]),
)


averages = st.sampled_from(
    [None, None, averaging.Window(4.0, parts=4), averaging.Window(10.0, parts=2), averaging.Forgetting(5.0)]
)
compensations = st.sampled_from(
    [None, None, compensation.KnownLoss(0.3), compensation.EstimatedLoss(3), compensation.EstimatedLoss()]
)


@st.composite
def configurations(draw: st.DrawFn) -> dict[str, Any]:
    """A dynamics, a way of sensing, a channel, clocks, averages, interventions and what is recorded."""
    dynamics = draw(st.sampled_from(["discrete", "continuous"]))
    parts: dict[str, Any] = {
        "dynamics": dynamics,
        "channel": draw(channels() | networks()),
        "recording": draw(recordings),
        "averaging": draw(averages),
        "compensation": draw(compensations),
        "interventions": draw(st.just(()) | disturbances()),
    }
    if dynamics == "discrete":
        parts["control_unit"] = draw(samplers)
        parts["clocks"] = draw(st.none() | clocks)
    else:
        parts["control_unit"] = draw(samplers | crossers)
    return parts


@settings(max_examples=150)
@given(problems(SHARED), configurations(), st.integers(0, 2**32))
def test_a_fleet_does_what_processes_do(problem: Problem, parts: dict[str, Any], seed: int) -> None:
    assert_same(*both(problem, 20.0, seed=seed, **parts))


@settings(max_examples=40)
@given(st.integers(70, 200), configurations(), st.integers(0, 2**32))
def test_copies_of_more_agents_than_a_block_holds(n: int, parts: dict[str, Any], seed: int) -> None:
    # Long enough for all interventions to begin.
    assert_same(*both(random_problem(seed % 1000, n, 2), 9.5, seed=seed, **parts))


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
@pytest.mark.parametrize(("way", "until"), [("own clocks", 3e3), ("crossing", 1e4), ("sampled", 3e3)])
def test_the_papers_system_over_thousands_of_signals(way: str, until: float) -> None:
    assert_same(*both(smart_cameras(seed=0), until, seed=1, **PAPER[way]))


def test_in_phase_a_fleet_is_the_synchronous_algorithm() -> None:
    problem = smart_cameras(seed=3)
    simulation = Simulation(problem, agents=Fleet, channel=BroadcastChannel(latency=0.5), seed=4)
    assert simulation.run(2000.0).digest == run_synchronous(problem, steps=2000, seed=4).digest
    at_once = Simulation(problem, agents=Fleet, seed=4)
    assert at_once.run(2000.0).digest == run_synchronous(problem, steps=2000, seed=4, lag=0).digest


# -- company ---------------------------------------------------------------------------------------------


class Deaf:
    """Hears nothing."""

    def __init__(self, agent: int, system: System) -> None:
        pass

    def receive(self, signal: Signal) -> None:
        pass

    def process(self) -> ProcessGenerator:
        yield from ()


@settings(max_examples=60)
@given(problems(SHARED), configurations(), st.integers(0, 2**32), st.data())
def test_processes_and_a_fleet_in_one_simulation(
    problem: Problem, parts: dict[str, Any], seed: int, data: st.DataObject
) -> None:
    agents = st.integers(0, problem.n_agents - 1)
    special = data.draw(st.dictionaries(agents, st.sampled_from([Deaf, AgentProcess]), min_size=1))
    assert_same(*both(problem, 12.0, seed=seed, special=special, **parts))


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


@settings(max_examples=60)
@given(problems(SHARED), configurations(), st.integers(0, 2**32))
def test_processes_that_meddle(problem: Problem, parts: dict[str, Any], seed: int) -> None:
    # Bursts of loss take broadcasts in the order of time only, and these are sent without delay.
    parts["control_unit"] = replace(parts["control_unit"], sensing_delay=0.0)
    assert_same(*both(problem, 12.0, seed=seed, processes=[meddle], **parts))


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
    # What is in flight scatters a little more in a run of ten times the length.
    assert rooms[5000.0] <= 1.5 * rooms[500.0]
