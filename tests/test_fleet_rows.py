"""Broadcasts that are rows: the same bits as with every copy in a heap, and heaps where rows cannot serve."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    averaging,
    compensation,
    latency,
    responses,
)
from aimd_des.channel import Broadcast, Copies
from aimd_des.dynamics.responses import OWN_COLUMNS
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.fleet import compiled_agents
from aimd_des.fleet.broadcast_rows import BroadcastRows
from aimd_des.fleet.compiled_agents import CompiledAgents
from aimd_des.interventions.prices import set_costs
from aimd_des.utils.validation import FloatArray
from models import smart_cameras
from tests.conftest import TERMS, problems, quietly, random_problem
from tests.support.configurations import (
    Configuration,
    assert_same,
    both,
    channels,
    configurations,
    networks,
    one_kind,
)
from tests.test_fleet import own_costs, own_problem

#: What a run with rows is made of; any response, control unit, loss, latency, order of links,
#: intervention, recording.
ROWED = configurations(
    problem=problems(("polynomial", "polynomial", *TERMS)),
    dynamics=("continuous",),
    averaging=lambda problem, dynamics, until: st.none(),
    compensation=lambda problem, dynamics, until: st.none(),
    channel=lambda problem, dynamics, until: one_kind(
        channels(problem.n_agents).map(lambda channel: replace(channel, duplication=0.0)),
        channels(problem.n_agents, latency=st.builds(latency.Exponential, st.floats(0.1, 4.0))),
        networks(problem.n_agents),
    ),
)


@contextmanager
def without_rows() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_agents, "serves", lambda system: False)
        yield


@pytest.mark.parametrize("unit", [Crossing(hold_off=0.3), Sampled(0.7)])
@pytest.mark.parametrize("n", [256, 700])
def test_totals_that_wait_are_those_of_heaps(n: int, unit: Any) -> None:
    # Several pieces of agents, several broadcasts of which copies are left, and up to ten looks and more of
    # observers between two of the control unit.
    def run() -> Result:
        return Simulation(
            smart_cameras(seed=0, n_cameras=n),
            dynamics="continuous",
            control_unit=unit,
            channel=BroadcastChannel(latency=latency.Exponential(1.0), loss=0.1),
            agents=Fleet,
            seed=3,
            recording=Recording(demand=0.05),
        ).run(40.0)

    rows = run()
    with without_rows():
        heaps = run()
    assert len(rows.signals) > 20
    assert_same(rows, heaps)


@settings(max_examples=30)
@given(ROWED)
def test_rows_and_heaps_do_the_same(configuration: Configuration) -> None:
    processes, rows = configuration.both()
    with without_rows():
        heaps = configuration.run(agents=Fleet)
    assert_same(processes, rows)
    assert_same(heaps, rows)


@settings(max_examples=30)
@given(
    ROWED.map(lambda one: replace(one, until=9.5)),
    st.builds(random_problem, st.integers(0, 999), st.integers(250, 600), st.just(2)),
)
def test_rows_of_several_pieces(configuration: Configuration, problem: Any) -> None:
    channel = BroadcastChannel(
        latency.Exponential(0.5 + configuration.seed % 3), 0.1, fifo=bool(configuration.seed % 2)
    )
    parts = {name: configuration.parts[name] for name in ("control_unit", "recording")}
    system = Configuration(
        problem, configuration.seed, 9.5, {"dynamics": "continuous", "channel": channel, **parts}
    )
    rows = system.run(agents=Fleet)
    with without_rows():
        assert_same(system.run(agents=Fleet), rows)


def rows_of(problem: Any, until: float, **parts: Any) -> tuple[list[BroadcastRows], Result]:
    """The rows of a fleet, as a process finds them ten times during a run."""
    found: list[BroadcastRows] = []

    def look(system: System) -> ProcessGenerator:
        for q in range(1, 11):
            yield system.env.at(until * q / 11.0, EventKind.INTERVENE)
            fleet = system.collective
            assert isinstance(fleet, CompiledAgents)
            found.append(fleet.agents.rows._replace(serving=fleet.agents.rows.serving.copy()))

    usual = {"dynamics": "continuous", "control_unit": Crossing(1.0), "seed": 1, "agents": Fleet}
    parts["processes"] = [look, *parts.get("processes", ())]
    return found, quietly(Simulation(problem, **{**usual, **parts}).run, until)


LATE = BroadcastChannel(latency.Exponential(0.5), 0.1)


@numba.njit
def asked(average: float, demand: float, age: float, memory: FloatArray) -> float:
    """Count the times it is asked; fail where a copy does not arrive, or comes later than it is asked."""
    memory[0] += 1.0
    memory[1] = max(memory[1], age)
    return 0.3 if math.isfinite(average + demand + age) else math.nan


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"control_unit": Sampled()},
        {"channel": BroadcastChannel(latency.Exponential(0.5), 0.1, fifo=True)},
        {"recording": Recording(events=True)},
        {"response": responses.EventNormalised()},
        {"response": responses.Derandomised()},
        {"response": responses.Derandomised("events", full=True)},
        {"response": responses.CustomResponse(asked, memory=2)},
        {"response": responses.CustomResponse(asked, "full", memory=2)},
    ],
    ids=["crossing", "sampled", "fifo", "log", "event_normalised", "fractional", "full", "own", "own_full"],
)
def test_all_rules_are_answered_in_rows(parts: dict[str, Any]) -> None:
    found, result = rows_of(smart_cameras(seed=0), 60.0, **{"channel": LATE, **parts})
    assert result.account.responses.sum() > 100
    assert all(rows.enabled for rows in found)
    # At first nothing is sent: demand grows to the capacities.
    assert all(rows.serving.all() for rows in found[-3:])


@pytest.mark.parametrize(
    "parts",
    [
        {"dynamics": "discrete", "control_unit": Sampled(), "clocks": Clocks(phase="random")},
        {"averaging": averaging.Window(10.0)},
        {"averaging": averaging.Forgetting(10.0)},
        {"averaging": averaging.Polynomial(2.0)},
        {"compensation": compensation.KnownLoss(0.1)},
        {"channel": BroadcastChannel(latency.Exponential(0.5), 0.1, duplication=0.2)},
    ],
    ids=lambda parts: next(iter(parts)),
)
def test_own_clocks_other_averages_compensation_and_duplicates_are_answered_from_heaps(
    parts: dict[str, Any],
) -> None:
    found, result = rows_of(smart_cameras(seed=0), 20.0, **{"channel": LATE, **parts})
    assert result.account.responses.sum() > 10
    assert not any(rows.enabled or rows.serving.any() for rows in found)


@pytest.mark.parametrize("cut", ["drawn", "fractional", "full"])
def test_a_rule_of_ones_own_is_asked_once_for_each_copy_that_is_answered(cut: Any) -> None:
    """A rule may remember, so it is never asked of a copy before its time."""
    memory: list[FloatArray] = []

    def look(system: System) -> ProcessGenerator:
        yield system.env.at(60.0, EventKind.INTERVENE)
        assert system.collective is not None
        system.collective.settle()
        memory.append(system.state.memory.copy())

    own = responses.CustomResponse(asked, cut, memory=2)
    recording = Recording(events=True)
    parts = {"channel": LATE, "response": own, "processes": [look], "recording": recording}
    found, result = rows_of(smart_cameras(seed=0), 60.5, **parts)
    assert found[-1].serving.all()
    landed = result.events[result.events["kind"].isin(["respond", "hold"]) & (result.events["time"] < 60.0)]
    answers = landed.groupby(["resource", "agent"], observed=True).size()
    assert memory[0][:, :, OWN_COLUMNS].sum() == len(landed) > 1000
    assert memory[0][:, :, OWN_COLUMNS].max() == answers.max()
    assert memory[0][:, :, OWN_COLUMNS + 1].max() <= 60.0


@pytest.mark.parametrize(
    "problem",
    [random_problem(1, 5, 2, "coupled"), own_problem(own_costs(compiled=True, separable=True))],
    ids=["coupled", "called"],
)
def test_costs_without_rows_of_derivatives_are_answered_from_heaps(problem: Problem) -> None:
    found, result = rows_of(problem, 100.0, channel=LATE)
    assert result.account.responses.sum() > 10
    assert not any(rows.enabled or rows.serving.any() for rows in found)


def test_with_many_broadcasts_in_flight_copies_go_to_the_heap() -> None:
    far = BroadcastChannel(latency.Exponential(20.0), 0.1)
    found, rows = rows_of(smart_cameras(seed=0), 100.0, channel=far)
    assert all(row.enabled for row in found)
    assert not found[-1].serving.any()
    with without_rows():
        assert_same(rows_of(smart_cameras(seed=0), 100.0, channel=far)[1], rows)


def test_new_costs_without_a_table_end_rows() -> None:
    called = own_costs(compiled=True, separable=True)
    tabled = PolynomialCosts([2], (1.0 + np.arange(4.0))[:, None, None] * np.ones((4, 2, 1)))

    def reprice(system: System) -> ProcessGenerator:
        yield system.env.at(50.25, EventKind.INTERVENE)
        set_costs(system, called)

    problem = Problem(own_problem(called).resources, tabled)
    found, rows = rows_of(problem, 88.0, channel=LATE, processes=[reprice])
    assert found[4].serving.all()
    assert not found[-1].enabled
    assert not found[-1].serving.any()
    with without_rows():
        assert_same(rows_of(problem, 88.0, channel=LATE, processes=[reprice])[1], rows)


class Twice:
    """A user's channel: of every other broadcast only second copies arrive, of the others both."""

    def open(self, n_agents: int, keys: Any) -> "Twice":
        self.n = n_agents
        return self

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        first = np.full(self.n, np.inf if broadcast.number % 2 else departure + 0.75)
        return Copies(first, departure + 0.25 + 0.25 * np.arange(self.n, dtype=np.float64))


def test_second_copies_are_no_rows() -> None:
    parts = {"dynamics": "continuous", "control_unit": Crossing(1.0), "seed": 3, "channel": Twice()}
    processes, fleet = both(random_problem(1, 6, 2), 30.0, **parts)
    assert fleet.account.duplicated.sum() > 10
    assert_same(processes, fleet)
