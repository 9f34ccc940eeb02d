"""A fork ends as the run that it is taken of, to the last bit, and the run as if nothing was taken of it."""

from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    OverloadWarning,
    Problem,
    Recording,
    Sampled,
    Simulation,
    SimulationError,
    interventions,
    latency,
    loss,
    responses,
)
from aimd_des.engine.observers import observer_of
from aimd_des.lowlevel import EventKind, ProcessGenerator, Run, System, resume
from aimd_des.utils.spare_arrays import spare
from models import smart_cameras
from tests.conftest import quietly
from tests.support.configurations import Configuration, assert_same, configurations

NONE_OF_ONES_OWN = {"processes": lambda problem, dynamics, until: st.just([])}
FORKED = configurations(**NONE_OF_ONES_OWN)

#: How far to go, in units of the end, before the run is forked; and how many events more.
WHERE = st.tuples(st.sampled_from([0.0, 0.25, 0.5]) | st.floats(0.0, 1.0), st.sampled_from([0, 0, 1, 2, 7]))


def in_a_piece(configuration: Configuration, where: tuple[float, int]) -> Run:
    parts = {"seed": configuration.seed, **configuration.parts, "agents": Fleet}
    run: Run = Simulation(configuration.problem, **parts).start(configuration.until)
    share, events = where
    if share > 0.0:  # at 0, processes have still to begin
        quietly(run.advance, share * run.until)
    for _ in range(events):
        quietly(run.step)
    return run


@settings(max_examples=15)
@given(FORKED, WHERE, st.booleans(), st.floats(0.0, 1.0))
def test_a_fork_and_what_it_is_taken_of_end_as_the_run(
    configuration: Configuration, where: tuple[float, int], fork_first: bool, again: float
) -> None:
    whole = configuration.run(agents=Fleet)
    run = in_a_piece(configuration, where)
    fork = quietly(run.fork)
    assert fork.time == run.time
    assert fork.peek() == run.peek()
    # Another one, of the fork, further on.
    later = fork.fork()
    quietly(later.advance, fork.time + again * (fork.until - fork.time))
    last = later.fork()
    order = [fork, run, last, later] if fork_first else [run, later, fork, last]
    for one in order:
        assert_same(whole, quietly(one.result))


def simulation(agents: Any = Fleet, **parts: Any) -> Simulation:
    whole: dict[str, Any] = {
        "dynamics": "continuous",
        "control_unit": Crossing(1.0),
        "channel": BroadcastChannel(latency.Exponential(0.5), loss=0.1),
        "agents": agents,
        "seed": 1,
    }
    return Simulation(smart_cameras(0, 12), **{**whole, **parts})


def at(time: float, **parts: Any) -> Run:
    run = simulation(**parts).start(100.0)
    run.advance(time)
    return run


def test_other_draws_from_the_fork_on_and_the_same_before() -> None:
    run = at(50.0, recording=Recording(events=True, demand=1.0))
    forks = [run.fork(salt) for salt in (None, 0, 1, 0)]
    forks.append(forks[1].fork(0))  # other draws once more
    whole, zero, one, again, twice = (fork.result() for fork in forks)
    assert zero.digest == again.digest
    assert len({result.digest for result in (whole, zero, one, twice)}) == 4
    for result in (zero, one, twice):
        before = whole.events["time"] < 50.0
        assert before.any()
        for column in ("time", "kind", "resource", "agent", "number", "value"):
            ours, theirs = result.events[column][: before.sum()], whole.events[column][before]
            assert ours.astype(str).tolist() == theirs.astype(str).tolist(), column
        totals, wholes = result.observations.total_demand, whole.observations.total_demand
        assert np.array_equal(totals[:51], wholes[:51])
        assert not np.array_equal(totals[51:], wholes[51:])


def test_each_draw_of_a_salted_fork_is_at_an_address_of_its_own() -> None:
    """With loss alone and signals at once: who hears is drawn with the salt, who has heard was not."""
    keys = [at(10.0).fork(salt).system.keys for salt in (None, 3, 4)]
    for purpose in keys[0]:
        assert len({each[purpose] for each in keys}) == (1 if purpose.name == "CLOCK" else 3)


def test_what_is_never_written_to_is_shared_and_nothing_else() -> None:
    run = at(50.0, recording=Recording(demand=1.0))
    fork = run.fork()
    ours, theirs = (
        [
            observer_of(one.system).demand_times,
            observer_of(one.system).state()["totals"][0][0],
            one.system.link.table.loss.probability,
            one.system.link.table.latency.first,
            *one.system.parameters[:5],
            *one.system.state[:4],
            one.system.link.table.spare,
            one.system.transmitter.delivered,
        ]
        for one in (run, fork)
    )
    shared = [np.shares_memory(one, other) for one, other in zip(ours, theirs, strict=True)]
    assert shared == [True] * 4 + [False] * 11


def test_space_that_is_not_used_takes_small_pages() -> None:
    for shape in ((2, 3), (3, 200_001)):
        for dtype in (np.uint32, np.float64):
            space = spare(shape, dtype)
            assert (space.shape, space.dtype) == (shape, dtype)
            space[-1, 1:] = 7
            assert space[-1, 1:].sum() == 7 * (shape[1] - 1)
            # The type by which compiled code knows an array.
            assert numba.typeof(space) == numba.typeof(np.empty(shape, dtype))


def test_a_channel_that_loses_all_silences_the_fork_and_not_the_run() -> None:
    run = at(50.0, recording=Recording(demand=1.0))
    deaf = run.fork(channel=BroadcastChannel(loss=1.0))
    sent = run.totals()["signals"].sum()
    delivered = deaf.system.transmitter.delivered.sum()
    with pytest.warns(OverloadWarning):
        lost = deaf.result()
    assert lost.account.delivered.sum() == delivered
    assert lost.account.lost.sum() >= 12 * (len(lost.signals) - sent) > 0
    assert run.result().digest == simulation().run(100.0).digest


def test_control_unit_and_response_take_over_from_now_on() -> None:
    run = at(50.5)
    sampled = run.fork(control_unit=Sampled(2.0)).result()
    later = sampled.signals["time"][sampled.signals["time"] >= 50.5]
    assert len(later) > 0
    assert (later % 2.0 == 0.0).all()
    assert (sampled.signals["time"][sampled.signals["time"] < 50.5] % 2.0 != 0.0).any()
    back = run.fork(control_unit=Sampled(2.0)).fork(control_unit=Crossing(1.0)).result()
    assert (back.signals["time"][back.signals["time"] >= 50.5] % 2.0 != 0.0).any()
    whole = run.fork().result()
    quiet = run.fork(response=responses.Derandomised("events"))
    assert not quiet.system.state.memory.any()
    assert quiet.result().digest != whole.digest
    # The paper's rule again, which is another object: copies are in queues then, and answers are the same.
    assert run.fork(response=responses.Randomised()).result().digest == whole.digest


def test_an_intervention_of_a_fork_is_as_if_it_had_been_declared() -> None:
    step, ramp = (
        interventions.CapacityStep("disk", 60.0, 3.0),
        interventions.CapacityRamp("memory", 50.0, 70.0, 5.0),
    )
    for more in ([step], [ramp], [step, interventions.Absence("3", 50.0, 80.0), ramp]):
        whole = simulation(interventions=more, recording=Recording(events=True)).run(100.0)
        fork = at(50.0, recording=Recording(events=True)).fork(interventions=more)
        assert_same(whole, fork.result())
    late = at(65.0).fork(interventions=[interventions.CapacityStep("disk", 65.0, 3.0)])
    assert late.result().pieces["start"].unique().tolist() == [0.0, 65.0]


def test_what_would_act_before_the_fork_is_refused() -> None:
    run = at(50.0)
    for early in (interventions.CapacityStep("disk", 49.0, 3.0), interventions.Join("1", 60.0)):
        with pytest.raises(
            InputError, match=r"^interventions\[0\] = .*: must be one that acts at 50\.0 or later"
        ):
            run.fork(interventions=[early])
    with pytest.raises(InputError, match=r"^interventions\[0\] = .*before 100, the end of the run"):
        run.fork(interventions=[interventions.CapacityStep("disk", 100.0, 3.0)])
    with pytest.raises(InputError, match=r"^channel = 3: must be a channel"):
        run.fork(channel=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^salt = -1: must be"):
        run.fork(-1)


def phased(**parts: Any) -> Simulation:
    """Hold-offs and channels that change, with signals that leave late over links that keep the order."""
    bursts = loss.GilbertElliott(0.3, 4.0)
    changes = [
        interventions.ChangeHoldOff(20.0, 1.5),
        interventions.ChangeChannel(
            30.2, BroadcastChannel(latency.Uniform(0.2, 2.0), bursts, duplication=0.3, fifo=True)
        ),
        interventions.ChangeHoldOff(40.0, 0.2, 3.0),
        interventions.ChangeChannel(60.1, BroadcastChannel(latency.Exponential(0.5), fifo=True)),
    ]
    unit = Crossing(0.5, sensing_delay=1.5)
    whole = {"control_unit": unit, "interventions": changes, "recording": Recording(events=True)}
    return simulation(**{**whole, **parts})


@pytest.mark.parametrize("again", ["fork", "resume"])
def test_hold_off_and_channel_in_force_go_on(again: str, tmp_path: Path) -> None:
    whole, run = phased().run(70.0), phased().start(70.0)
    if again == "fork":
        assert whole.digest == phased(agents=AgentProcess).run(70.0).digest
    for time in (25.0, 31.0, 60.5, 65.0):
        run.advance(time)
        if again == "fork":
            other = run.fork()
        else:
            run.save(tmp_path / "run")
            other = resume(tmp_path / "run", phased())
        assert_same(whole, other.result())
        assert whole.events.equals(other.result().events)
    assert_same(whole, run.result())


def test_a_channel_that_is_given_takes_the_place_of_the_one_in_force() -> None:
    """As an intervention at that time does: with signals that are still to leave over the one before."""
    first, second = BroadcastChannel(latency.Exponential(2.0), fifo=True), BroadcastChannel(0.1, fifo=True)
    unit = Crossing(0.5, sensing_delay=1.5)
    for time in (20.0, 41.0):
        parts: dict[str, Any] = {"control_unit": unit, "channel": first}
        whole = simulation(**parts, interventions=[interventions.ChangeChannel(time, second)]).run(100.0)
        assert whole.digest == at(time, **parts).fork(channel=second).result().digest
        back = [interventions.ChangeChannel(10.0, second), interventions.ChangeChannel(time, first)]
        changed = at(time, **parts, interventions=back[:1]).fork(channel=first)
        assert changed.result().digest == simulation(**parts, interventions=back).run(100.0).digest
    changed = at(20.0, **parts, interventions=[interventions.ChangeHoldOff(10.0, 2.0)])
    assert changed.fork(control_unit=unit).result().digest != changed.fork().result().digest


class OwnIntervention:
    def check(self, problem: Problem) -> None:
        pass

    def process(self, system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.INTERVENE)


class OwnUnit:
    def process(self, system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.SENSE)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"agents": AgentProcess}, r"^agents = 'AgentProcess': must be Fleet"),
        ({"special": {3: AgentProcess}}, r"^special = \[3\]: must be empty"),
        ({"processes": [OwnIntervention().process]}, r"^processes = .*: must be empty"),
        ({"interventions": [OwnIntervention()]}, r"^interventions\[0\] = .*: must be a list of changes"),
        ({"control_unit": OwnUnit()}, r"^control_unit = .*: must be a Crossing, or derived from SampledUnit"),
    ],
)
def test_what_is_no_data_is_refused_by_name(parts: dict[str, Any], said: str) -> None:
    run = at(5.0, **parts)
    with pytest.raises(InputError, match=f"{said}.*generators of Python"):
        run.fork()


def test_events_that_are_scheduled_from_outside_are_refused() -> None:
    run = at(5.0)
    run.system.env.at(7.0, EventKind.INTERVENE).callbacks.append(lambda _: None)
    with pytest.raises(InputError, match=r"^run = .*an event at 7\.0"):
        run.fork()


def test_a_run_that_is_over_or_goes_on_cannot_be_forked() -> None:
    run = at(5.0)
    with pytest.raises(
        SimulationError, match="the run is being advanced: a run that is forked must be stopped"
    ):
        run.advance(watch=lambda time, events: run.fork())
    run = at(5.0)
    run.result()
    with pytest.raises(SimulationError, match=r"^the run is over at time 100\.0"):
        run.fork()


class Remembering(interventions.Planned):
    """Of one's own: the capacity is halved, and put back to what it was."""

    def check(self, problem: Problem) -> None:
        pass

    def changes(self, system: System, memory: dict[str, Any]) -> Any:
        def halve() -> None:
            memory["was"] = float(system.parameters.capacity[1])
            interventions.set_capacity(system, 1, 0.5 * memory["was"])

        yield 20.0, halve
        yield 60.0, lambda: interventions.set_capacity(system, 1, memory["was"])


class EverySecond:
    """Of one's own: every second broadcast is lost; it says what it remembers."""

    def __init__(self, count: int = 0) -> None:
        self.count = count

    def start(self, n_agents: int) -> "EverySecond":
        return type(self)()

    def draw(self, draws: Any) -> Any:
        self.count += 1
        return np.full(draws.n_agents, self.count % 2 == 0)

    def state(self) -> dict[str, Any]:
        return {"count": self.count}

    def resume(self, state: dict[str, Any]) -> None:
        self.count = state["count"]


class Silent(EverySecond):
    """One that does not."""

    state = None  # type: ignore[assignment]


def test_parts_of_ones_own_say_what_they_remember() -> None:
    parts = {"interventions": [Remembering()], "channel": BroadcastChannel(loss=EverySecond())}
    whole, run = simulation(**parts).run(100.0), at(50.0, **parts)
    fork = run.fork()
    run.advance(55.0)
    assert_same(whole, fork.result())
    assert_same(whole, run.result())
    with pytest.raises(InputError, match=r"Silent.*must be one with methods state\(\) and resume\(state\)"):
        at(50.0, channel=BroadcastChannel(loss=Silent())).fork()
