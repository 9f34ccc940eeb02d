"""A run in progress: advanced in pieces, stepped and looked at, it ends as one without a pause."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Recording,
    Sampled,
    Simulation,
    SimulationError,
    interventions,
    latency,
)
from aimd_des.lowlevel import EventKind, ProcessGenerator, Run, System
from models import smart_cameras
from tests.conftest import quietly
from tests.support.configurations import Configuration, assert_same, configurations

BOTH = pytest.mark.parametrize("agents", [AgentProcess, Fleet])

#: How far to go in units of the end, how many events, or how many signals.
PIECES = st.lists(
    st.one_of(st.floats(0.0, 1.0), st.sampled_from(["event", "signal"]), st.integers(2, 30)), max_size=6
)


def go(run: Run, piece: float | str | int) -> None:
    if isinstance(piece, str):
        run.step("signal" if piece == "signal" else "event")
    elif isinstance(piece, int):
        for _ in range(piece):
            run.step()
    else:
        run.advance(to=max(run.time, piece * run.until))


@settings(max_examples=20)
@given(configurations(), PIECES, st.sampled_from([AgentProcess, Fleet]))
def test_pieces_make_the_same_run(
    configuration: Configuration, pieces: list[float | str | int], agents: Any
) -> None:
    whole = configuration.run(agents=agents)
    parts = {"seed": configuration.seed, **configuration.parts, "agents": agents}
    run = Simulation(configuration.problem, **parts).start(configuration.until)
    for piece in pieces:
        quietly(go, run, piece)
        run.totals()
    assert_same(whole, quietly(run.result))


def simulation(agents: Any, **parts: Any) -> Simulation:
    usual = {"control_unit": Crossing(1.0), "channel": BroadcastChannel(latency.Exponential(0.5), loss=0.1)}
    return Simulation(
        smart_cameras(0, 12), dynamics="continuous", agents=agents, seed=1, **{**usual, **parts}
    )


@BOTH
def test_a_signal_is_a_step_and_time_and_totals_are_those_of_it(agents: Any) -> None:
    whole = simulation(agents).run(100.0)
    run = simulation(agents).start(100.0)
    times, counts = [], []
    while run.step("signal"):
        times.append(run.time)
        totals = run.totals()
        counts.append(int(totals["signals"].sum()))
        # It was sent because the threshold was reached, and nobody has answered yet.
        assert (totals["demand"] >= totals["capacity"] * (1.0 - 1e-12)).any()
    assert times == np.unique(whole.signals["time"]).tolist()
    assert counts[-1] == len(whole.signals)
    assert run.time == 100.0
    assert run.peek() == math.inf
    assert run.result().digest == whole.digest
    assert run.result() is run.result()


@BOTH
def test_between_two_steps_nothing_is_due(agents: Any) -> None:
    run = Simulation(smart_cameras(0, 5), control_unit=Sampled(2.0), agents=agents, seed=0).start(9.0)
    seen = []
    while (due := run.peek()) < math.inf:
        assert run.step()
        assert run.time == due
        seen.append(due)
    assert seen == sorted(seen)
    assert {0.0, 2.0, 4.0, 6.0, 8.0} <= set(seen)
    assert not run.step()
    assert run.time == 9.0


def test_a_run_that_stands_still_shows_nothing_of_what_is_to_come() -> None:
    """Copies land within one event where nothing else is due, but not those that are later than the pause."""
    runs = [simulation(agents).start(100.0) for agents in (AgentProcess, Fleet)]
    for pause in np.arange(0.13, 100.0, 0.29).tolist():
        looks = []
        for run in runs:
            run.advance(pause)
            assert run.system.state.anchor.max() < run.time == pause
            looks.append(run.totals())
        pd.testing.assert_frame_equal(*looks, check_exact=True)


def test_what_is_due_at_the_time_itself_has_not_happened() -> None:
    happened = []

    def process(system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.INTERVENE)
        happened.append(system.env.now)

    run = simulation(Fleet, processes=[process]).start(10.0)
    run.advance(to=3.0)
    assert (run.time, run.peek(), happened) == (3.0, 3.0, [])
    run.advance(to=math.nextafter(3.0, 4.0))
    assert happened == [3.0]


def test_what_is_changed_between_two_pieces_holds_from_then_on() -> None:
    """As an intervention at that time does, for both kinds of agents and for a fork."""
    digests = []
    for agents in (AgentProcess, Fleet):
        parts: dict[str, Any] = {"dynamics": "continuous", "control_unit": Crossing(1.0), "agents": agents}
        simulation = Simulation(smart_cameras(seed=0), seed=1, recording=Recording(events=True), **parts)
        run = simulation.start(until=60.0)
        run.advance(to=40.0)
        assert str(run) == "Run at 40 of 60; 60 agents share memory, disk, bandwidth"
        interventions.set_capacity(run.system, "memory", 28.0)
        interventions.weigh(run.system, ["1", "2"], 0.5)
        others = [run.fork()] if agents is Fleet else []
        results = [quietly(one.result) for one in (run, *others)]
        assert [result.pieces["start"].unique().tolist() for result in results] == [[0.0, 40.0]] * len(
            results
        )
        digests += [result.digest for result in results]
    assert len(set(digests)) == 1
    assert digests[0] != quietly(simulation.run, 60.0).digest


def test_times_outside_of_the_run_are_refused() -> None:
    run = simulation(AgentProcess).start(10.0)
    run.advance(to=4.0)
    for wrong in (3.0, 10.5, math.nan):
        with pytest.raises(InputError, match=r"^to = .*: must be a finite number at least 4 and at most 10$"):
            run.advance(to=wrong)
    with pytest.raises(InputError, match=r"^watch = 3: must be a function of simulated time and number of"):
        run.advance(watch=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^kind = 'look': must be"):
        run.step("look")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^until = 0\.0: must be"):
        simulation(Fleet).start(0.0)


@pytest.mark.parametrize("unit", [Sampled(1.0), Crossing(1.0)])
@pytest.mark.parametrize("events", [False, True])
def test_totals_between_two_steps_are_those_of_that_time(unit: Any, events: bool) -> None:
    # With a log, signals are sent outside of compiled code, and the looks go on from there.
    recording = Recording("end", events=events)
    whole = simulation(Fleet, control_unit=unit, recording=recording).run(50.0)
    run, processes = (
        simulation(agents, control_unit=unit, recording=recording).start(50.0)
        for agents in (Fleet, AgentProcess)
    )
    steps = 0
    while run.step():
        steps += 1
        processes.advance(run.time)
        for ours, theirs in zip(run.system.allocations(), processes.system.allocations(), strict=True):
            assert np.array_equal(ours, theirs)
        assert run.totals()["demand"].tolist() == processes.totals()["demand"].tolist()
    assert steps >= 50
    assert len(whole.signals) > 50
    assert_same(whole, run.result())


@pytest.mark.parametrize("ask", [Run.advance, Run.step, Run.result])
def test_a_run_is_not_advanced_from_within(ask: Callable[[Run], object]) -> None:
    run = simulation(Fleet).start(10.0)

    def watch(time: float, events: int) -> None:
        ask(run)

    with pytest.raises(SimulationError, match=r"^the run is being advanced: a run that goes on must be stop"):
        run.advance(watch=watch)


def test_a_run_that_has_failed_does_not_go_on() -> None:
    def process(system: System) -> ProcessGenerator:
        yield system.env.timeout(2.0)
        raise RuntimeError("by its user")

    run = simulation(Fleet, processes=[process]).start(10.0)
    with pytest.raises(RuntimeError, match="by its user"):
        run.advance()
    with pytest.raises(SimulationError, match=r"^the run has failed at time 2\.0: start another one$"):
        run.result()
