"""Broadcasts whose copies all land at one instant wait behind the row: the same bits as by processes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    Problem,
    Recording,
    Sampled,
    Simulation,
    responses,
)
from aimd_des.channel import Broadcast, Copies
from aimd_des.interventions import Absence, ChangeChannel, Crash, Intervention
from aimd_des.lowlevel import resume
from models import smart_cameras
from tests.conftest import TERMS, problems, quietly, random_problem
from tests.support.configurations import (
    Configuration,
    assert_same,
    both,
    clocks,
    configurations,
    interventions,
    losses,
    one_kind,
)
from tests.test_fleet_rows import rows_of, without_rows

#: One latency for all: within a period, on ticks and looks, and longer than many of them.
LATENCIES = st.sampled_from([0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 7.0, 10.0])


def constant(n: int) -> Any:
    """A channel all of whose copies of a broadcast land at one instant, or get lost."""
    lost = one_kind(st.sampled_from([0.0, 0.1, 0.5, 0.8]), losses(n))
    return st.builds(BroadcastChannel, LATENCIES, lost, fifo=st.booleans())


def units(dynamics: str) -> Any:
    delays = st.sampled_from([0.0, 0.0, 0.0, 0.5])
    looks = st.builds(
        Sampled, st.sampled_from([0.5, 1.0, 2.0]), st.sampled_from([0.0, 0.25, 0.5]), sensing_delay=delays
    )
    crossings = st.builds(Crossing, st.sampled_from([0.1, 1.0]), sensing_delay=delays)
    return looks if dynamics == "discrete" else one_kind(looks, crossings)


@st.composite
def changes(draw: st.DrawFn, problem: Problem, until: float) -> list[Intervention]:
    """Changes of the latency, among others."""
    times = st.sampled_from([2.0, 3.5, 5.0, 8.25, 12.0])
    others = st.builds(ChangeChannel, times, constant(problem.n_agents))
    return draw(interventions(problem, until)) + draw(st.lists(others, max_size=3))


TOGETHER = configurations(
    problem=problems(("polynomial", "polynomial", *TERMS)),
    channel=lambda problem, dynamics, until: constant(problem.n_agents),
    control_unit=lambda problem, dynamics, until: units(dynamics),
    averaging=lambda problem, dynamics, until: st.none(),
    compensation=lambda problem, dynamics, until: st.none(),
    clocks=lambda problem, dynamics, until: (
        st.none()
        if dynamics == "continuous"
        else one_kind(
            st.none(),
            st.builds(Clocks, st.sampled_from([0.5, 1.0, 1.5]), st.sampled_from([0.0, 0.25, 0.5])),
            clocks(problem.n_agents),
        )
    ),
    interventions=lambda problem, dynamics, until: one_kind(st.just([]), changes(problem, until)),
)


@settings(max_examples=60)
@given(TOGETHER)
def test_what_waits_behind_the_row_is_answered_as_by_processes(configuration: Configuration) -> None:
    processes, rows = configuration.both()
    assert_same(processes, rows)
    with without_rows():
        assert_same(configuration.run(agents=Fleet), rows)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(TOGETHER, st.floats(0.0, 1.0), st.integers(0, 3))
def test_what_waits_behind_the_row_is_in_forks_and_files(
    tmp_path: Path, configuration: Configuration, share: float, events: int
) -> None:
    parts = {"seed": configuration.seed, **configuration.parts, "agents": Fleet, "processes": []}
    simulation = Simulation(configuration.problem, **parts)
    run = simulation.start(configuration.until)
    quietly(run.advance, share * run.until)
    for _ in range(events):
        quietly(run.step)
    fork = run.fork()
    fork.save(tmp_path / "run")
    resumed = resume(tmp_path / "run", simulation)
    result = quietly(run.result)
    assert_same(result, quietly(fork.result))
    assert_same(result, quietly(resumed.result))


LATE = BroadcastChannel(10.0, 0.3)
CLOCK: dict[str, Any] = {"dynamics": "discrete", "control_unit": Sampled()}


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"control_unit": Sampled(0.5)},
        {"recording": Recording(demand=0.3)},
        {"recording": Recording(events=True)},
        {"interventions": [Absence(3, 25.0, 33.5), Absence(4, 27.0), ChangeChannel(40.0, LATE)]},
    ],
    ids=["crossing", "sampled", "totals", "log", "absences"],
)
@pytest.mark.parametrize("clock", [{}, CLOCK], ids=["continuous", "discrete"])
def test_many_broadcasts_wait_behind_the_row(clock: dict[str, Any], parts: dict[str, Any]) -> None:
    parts = {"channel": LATE, **clock, **parts}
    found, rows = rows_of(smart_cameras(seed=0), 60.0, **parts)
    assert found[-1].serving.all()
    assert found[-1].rank_behind.shape[1] >= 8
    with without_rows():
        assert_same(rows_of(smart_cameras(seed=0), 60.0, **parts)[1], rows)


@pytest.mark.parametrize("sooner", [0.0, 0.75, 9.5])
@pytest.mark.parametrize("way", [{"control_unit": Sampled(0.5)}, {"control_unit": Crossing(0.1)}, CLOCK])
def test_what_overtakes_what_waits_behind_the_row_is_answered_first(
    sooner: float, way: dict[str, Any]
) -> None:
    """A shorter latency lets later broadcasts land before those that wait: the order of answers matters."""
    parts = {
        "dynamics": "continuous",
        "channel": LATE,
        **way,
        "interventions": [ChangeChannel(30.3, BroadcastChannel(sooner, 0.3))],
        "seed": 4,
    }
    processes, fleet = both(smart_cameras(seed=1, n_cameras=12), 50.0, **parts)
    assert_same(processes, fleet)


class Uneven:
    """A user's channel: every third broadcast is for nobody, and of every fifth some copies are late."""

    def open(self, n_agents: int, keys: Any) -> "Uneven":
        self.n = n_agents
        return self

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        arrival = np.full(self.n, departure + 3.0)
        if broadcast.number % 3 == 2:
            arrival[:] = np.inf
        elif broadcast.number % 5 == 3:
            arrival[::2] += 0.5
        return Copies(arrival)


@pytest.mark.parametrize("way", [{"dynamics": "continuous", "control_unit": Crossing(0.5)}, CLOCK])
def test_broadcasts_that_land_at_several_times_send_the_others_to_the_heap(way: dict[str, Any]) -> None:
    parts = {**way, "channel": Uneven(), "seed": 3}
    processes, fleet = both(random_problem(1, 6, 2), 60.0, **parts)
    assert fleet.account.responses.sum() > 10
    assert_same(processes, fleet)


@pytest.mark.parametrize("latency", [0.0, 0.5, 1.0, 3.25])
@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("response", [None, responses.Derandomised("events", full=True)])
def test_of_copies_for_one_tick_the_first_is_answered(latency: float, log: bool, response: Any) -> None:
    """Four looks for a tick: an agent answers the first copy that it gets, with the draw of that."""
    parts = {
        "dynamics": "discrete",
        "control_unit": Sampled(0.25),
        "channel": BroadcastChannel(latency, 0.5),
        "recording": Recording(events=log),
        "response": response,
        "seed": 5,
    }
    processes, fleet = both(smart_cameras(seed=1, n_cameras=12), 80.0, **parts)
    assert_same(processes, fleet)
    if log:
        kinds = fleet.events["kind"].value_counts()
        assert kinds["deliver"] > 1.5 * (kinds["respond"] + kinds["hold"])


@pytest.mark.parametrize("at", [20.0, 20.4, 21.0])
def test_copies_that_wait_for_a_tick_are_lost_with_the_agent(at: float) -> None:
    """A crash between landing and tick loses what has landed; behind the row others are on their way."""
    parts = {
        "dynamics": "discrete",
        "control_unit": Sampled(0.5),
        "channel": BroadcastChannel(2.25, 0.2),
        "interventions": [Crash(2, at, at + 0.5), Absence(3, at, at + 1.5), Crash(4, at, at + 6.0)],
        "seed": 2,
    }
    processes, fleet = both(smart_cameras(seed=1, n_cameras=12), 60.0, **parts)
    assert fleet.account.lost[:, 4].sum() > 0
    assert_same(processes, fleet)


def test_agents_that_tick_between_others_answer_as_processes() -> None:
    """An agent of one's own acts in the middle of a tick, where only those before it have had their turn."""
    parts = {**CLOCK, "channel": BroadcastChannel(1.5, 0.2), "seed": 2, "special": {5: AgentProcess}}
    processes, fleet = both(smart_cameras(seed=1, n_cameras=12), 60.0, **parts)
    assert_same(processes, fleet)
