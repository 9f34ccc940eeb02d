"""What happens at one instant, and in which order: one test for each rule of docs/model.md, read like a log.

One agent that adds 1 in every unit of time and gives back half at every signal, a capacity of 8: with that
every number below can be checked by eye.
"""

import math
from collections.abc import Sequence
from heapq import heappop, heappush
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Crossing,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    latency,
)
from aimd_des.channel import Broadcast, Copies
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import CapacityProfile, CapacityRamp, CapacityStep
from aimd_des.results.event_log import Entry, EventLog
from tests.conftest import problems, quadratic_problem, quietly, random_problem
from tests.support.scripts import Script, exactly, send_at, story

Log = list[Any]


def stage(n: int = 1, **changes: Any) -> Problem:
    return quadratic_problem([1.0] * n, **{"capacity": 8.0, "increase": 1.0, "normalization": 0.5, **changes})


def run(until: float, *processes: Any, problem: Problem | None = None, **parts: Any) -> Result:
    """Play on the stage; a control unit that never signals unless one is given."""
    recording = Recording(demand=parts.pop("demand", "end"), overshoot=False, events=True)
    parts = {"control_unit": Sampled(1.0, phase=1e6), "seed": 0, **parts}
    return Simulation(problem or stage(), processes=processes, recording=recording, **parts).run(until)


def set_at(time: float, demand: float, agent: int = 0, kind: EventKind = EventKind.INTERVENE) -> Any:
    def process(system: System) -> ProcessGenerator:
        yield system.env.at(time, kind)
        system.set_demand(agent, 0, demand)

    return process


def totals(result: Result) -> dict[float, float]:
    """The totals that were observed, by time."""
    frame = result.demand
    return dict(zip(frame["time"].tolist(), frame["total"].tolist(), strict=True))


# -- 1. INTERVENE < DELIVER < SENSE < OBSERVE < ACT ------------------------------------------------------


class Told(AgentProcess):
    """A camera that tells what it does."""

    def __init__(self, agent: int, system: System, log: Log) -> None:
        super().__init__(agent, system)
        self.log = log

    def receive(self, signal: Signal) -> None:
        self.log.append(f"{exactly(self.system.env.now)} agent {self.agent} hears")
        super().receive(signal)

    def answer(self, signals: list[Signal], moment: float) -> None:
        self.log.append(f"{exactly(self.system.env.now)} agent {self.agent} answers")
        super().answer(signals, moment)


def tell_at(log: Log, kind: EventKind, what: str) -> Any:
    def process(system: System) -> ProcessGenerator:
        for q in range(3):
            yield system.env.at(float(q), kind)
            log.append(f"{q} {what}")

    return process


class Always:
    """A control unit that looks at 0, 1, 2, ... and broadcasts each time."""

    def __init__(self, log: Log) -> None:
        self.log = log

    def process(self, system: System) -> ProcessGenerator:
        for q in range(3):
            yield system.env.at(float(q), EventKind.SENSE)
            self.log.append(f"{q} control unit looks")
            system.broadcast(0)


@pytest.mark.parametrize("delay", [1.0, 0.0])
@pytest.mark.parametrize("turns", list(permutations(range(3))))
def test_rule_1_at_one_instant_the_kind_decides(turns: tuple[int, ...], delay: float) -> None:
    log: Log = []
    three = [
        tell_at(log, EventKind.OBSERVE, "observer looks"),
        tell_at(log, EventKind.INTERVENE, "intervention"),
        tell_at(log, EventKind.ACT, "whoever acts without an index"),
    ]
    parts = {
        "agents": lambda i, system: Told(i, system, log),
        "control_unit": Always(log),
        "channel": BroadcastChannel(delay),
    }
    run(2.0, *[three[turn] for turn in turns], problem=stage(2), **parts)
    behind_a_latency = [
        "0 intervention",
        "0 control unit looks",
        "0 observer looks",
        "0 whoever acts without an index",
        "1 intervention",
        "1 agent 0 hears",
        "1 agent 1 hears",
        "1 control unit looks",
        "1 observer looks",
        "1 agent 0 answers",
        "1 agent 1 answers",
        "1 whoever acts without an index",
    ]
    # What arrives at once takes its place in the instant: after the look, before all that is left.
    at_once = [
        f"{q} {what}"
        for q in range(2)
        for what in (
            "intervention",
            "control unit looks",
            "agent 0 hears",
            "agent 1 hears",
            "observer looks",
            "agent 0 answers",
            "agent 1 answers",
            "whoever acts without an index",
        )
    ]
    assert log == (behind_a_latency if delay else at_once)


def test_rule_1_an_intervention_comes_before_a_signal_that_arrives() -> None:
    parts = {"dynamics": "continuous", "channel": BroadcastChannel(1.0)}
    result = run(5.0, send_at(3.0, 0), set_at(4.0, 10.0), **parts)
    assert story(result) == [
        "3 signal 0",
        "4 agent 0 change -1",
        "4 agent 0 deliver 0",
        "4 agent 0 respond 0",
    ]
    assert result.events["value"].tolist() == [3.0, 6.0, 0.0, 5.0]  # half of the 10


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_rule_1_an_intervention_comes_before_the_look(dynamics: str) -> None:
    parts = {"dynamics": dynamics, "control_unit": Sampled(4.0), "channel": BroadcastChannel(9.0)}
    assert story(run(5.0, set_at(4.0, 8.5), **parts)) == ["4 agent 0 change -1", "4 signal 0"]
    assert story(run(5.0, set_at(4.0, 8.0), **parts)) == ["4 agent 0 change -1"]


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_rule_1_an_intervention_comes_before_observers(dynamics: str) -> None:
    assert totals(run(5.0, set_at(4.0, 2.5), dynamics=dynamics, demand=[3.0, 4.0])) == {
        3.0: 3.0,
        4.0: 2.5,
        5.0: 3.5,
    }


def test_rule_1_an_intervention_comes_before_the_tick() -> None:
    result = run(5.0, send_at(3.0, 0), set_at(4.0, 10.0), channel=BroadcastChannel(0.5))
    assert story(result) == [
        "3 signal 0",
        "3.5 agent 0 deliver 0",
        "4 agent 0 change -1",
        "4 agent 0 respond 0",
    ]
    assert result.demand_at_end.tolist() == [[5.0]]


def test_rule_1_a_signal_that_arrives_comes_before_the_look() -> None:
    # At 9 the total is 9, or 4.5 for a control unit that looks after the response.
    parts = {"dynamics": "continuous", "control_unit": Sampled(9.0)}
    assert story(run(10.0, **parts))[0] == "9 signal 0"
    result = run(10.0, send_at(7.0, 0), channel=BroadcastChannel(2.0), **parts)
    assert story(result) == ["7 signal 0", "9 agent 0 deliver 0", "9 agent 0 respond 0"]


def test_rule_1_a_signal_that_arrives_comes_before_observers() -> None:
    parts = {"dynamics": "continuous", "channel": BroadcastChannel(1.0), "demand": [3.5, 4.0]}
    assert totals(run(5.0, send_at(3.0, 0), **parts)) == {3.5: 3.5, 4.0: 2.0, 5.0: 3.0}


def test_rule_1_a_signal_that_arrives_comes_before_the_tick() -> None:
    for arrival, answered in ((4.0, 4), (math.nextafter(4.0, 5.0), 5)):
        result = run(7.0, send_at(3.0, 0), channel=Script([arrival]))
        assert story(result)[1:] == [
            f"{exactly(arrival)} agent 0 deliver 0",
            f"{answered} agent 0 respond 0",
        ]


def test_rule_1_the_look_comes_before_observers() -> None:
    # Without latency the response belongs to the look: the observer sees 4.5.
    parts = {"dynamics": "continuous", "control_unit": Sampled(9.0), "demand": [8.75, 9.0]}
    assert totals(run(10.0, **parts)) == {8.75: 8.75, 9.0: 4.5, 10.0: 5.5}


def test_rule_1_the_look_comes_before_the_tick() -> None:
    # The look at k is at x(k) = k: 9 is the first above 8.  After the tick it would be seen at 8.
    assert story(run(10.0, control_unit=Sampled()))[0] == "9 signal 0"


def test_rule_1_observers_come_before_the_tick() -> None:
    assert totals(run(3.0, demand=1.0)) == {0.0: 0.0, 1.0: 1.0, 2.0: 2.0, 3.0: 3.0}


def send_after_the_tick(system: System) -> ProcessGenerator:
    yield system.env.at(4.0, EventKind.ACT)
    system.broadcast(0)


def test_rule_1_who_acts_after_the_agents_sees_what_they_did() -> None:
    seen: Log = []

    def after_the_tick(system: System) -> ProcessGenerator:
        yield system.env.at(4.0, EventKind.ACT)
        seen.append((system.total(0), system.average(0, 0)))

    result = run(5.0, send_at(4.0, 0), after_the_tick, demand=1.0)
    assert story(result)[-1] == "4 agent 0 respond 0"
    assert totals(result)[5.0] == 2.0
    assert seen == [(2.0, (0 + 1 + 2 + 3 + 4 + 2) / 6)]


def test_rule_1_a_signal_sent_after_the_tick_is_answered_at_the_next() -> None:
    result = run(7.0, send_at(4.0, 0), send_after_the_tick, demand=1.0)
    answers = [line for line in story(result) if "respond" in line]
    assert answers == ["4 agent 0 respond 0", "5 agent 0 respond 1"]
    assert totals(result) == {0.0: 0.0, 1.0: 1.0, 2.0: 2.0, 3.0: 3.0, 4.0: 4.0, 5.0: 2.0, 6.0: 1.0, 7.0: 2.0}


def test_rule_1_a_signal_sent_after_a_tick_of_plain_growth_is_answered_at_the_next() -> None:
    result = run(7.0, send_after_the_tick, demand=1.0)
    assert story(result)[-1] == "5 agent 0 respond 0"
    assert totals(result) == {0.0: 0.0, 1.0: 1.0, 2.0: 2.0, 3.0: 3.0, 4.0: 4.0, 5.0: 5.0, 6.0: 2.5, 7.0: 3.5}


def test_rule_1_who_has_ticked_does_not_tick_again_for_a_signal_sent_by_the_next_to_tick() -> None:
    class Caller(AgentProcess):
        """An agent that at its tick at 4 calls all others to order."""

        def process(self) -> ProcessGenerator:
            yield self.system.env.at(4.0, EventKind.ACT, self.agent)
            self.system.broadcast(0)

        def receive(self, signal: Signal) -> None: ...

    result = run(
        7.0,
        send_at(4.0, 0),
        problem=stage(3),
        agents=lambda i, system: Caller(i, system) if i == 1 else AgentProcess(i, system),
    )
    assert [line for line in story(result) if "respond" in line] == [
        "4 agent 0 respond 0",
        "4 agent 2 respond 0",  # its latch is set already
        "5 agent 0 respond 1",
    ]


# -- 2. Agents by index, copies by broadcast and index, all else in turn ---------------------------------


@given(st.permutations([4.125, 4.25, 4.5, 4.75, 5.0]))
def test_rule_2_agents_tick_by_index_whenever_they_heard(arrivals: list[float]) -> None:
    result = run(6.0, send_at(4.0, 0), problem=stage(5), channel=Script(arrivals))
    assert story(result)[-5:] == [f"5 agent {i} respond 0" for i in range(5)]


def test_rule_2_agents_with_different_clocks_tick_by_index_where_their_ticks_coincide() -> None:
    clocks = Clocks(period=[1.0, 0.5, 2.0, 0.1], phase=[0.0, 0.5, 1.0, 0.0])
    result = run(6.0, send_at(4.9, 0), problem=stage(4), clocks=clocks)
    assert story(result)[-4:] == [
        *["4.9 agent 3 respond 0", "5 agent 0 respond 0", "5 agent 1 respond 0", "5 agent 2 respond 0"]
    ]


@given(st.permutations([0, 1, 2]), st.data())
def test_rule_2_copies_land_by_broadcast_and_then_by_index(by_time: list[int], data: st.DataObject) -> None:
    # Copies sent at 1, 2 and 3, some of which land before; those that land at 5 do so in this order.
    earlier = data.draw(st.sets(st.tuples(st.integers(0, 2), st.integers(0, 2))))
    arrivals = [[4.0 + 0.25 * by_time[i] if (b, i) in earlier else 5.0 for i in range(3)] for b in range(3)]
    sends = [send_at(time, 0) for time in (1.0, 2.0, 3.0)]
    parts = {"dynamics": "continuous", "problem": stage(3), "channel": Script(*arrivals)}
    landed = [line for line in story(run(6.0, *sends, **parts)) if "deliver" in line]
    late = [f"5 agent {i} deliver {b}" for b in range(3) for i in range(3) if (b, i) not in earlier]
    assert landed[9 - len(late) :] == late
    soon = sorted((arrivals[b][i], b, i) for b, i in earlier)
    assert landed[: 9 - len(late)] == [f"{exactly(time)} agent {i} deliver {b}" for time, b, i in soon]


def test_rule_2_a_duplicate_lands_after_the_copies_of_its_broadcast_and_before_the_next() -> None:
    parts = {"dynamics": "continuous", "channel": BroadcastChannel(duplication=1.0), "problem": stage(2)}
    events = run(6.0, send_at(5.0, 0, 0), **parts).events
    landed = events[events["kind"] == "deliver"]
    order = list(zip(landed["number"], landed["value"], landed["agent"], strict=True))
    # Without latency all of it is one instant: broadcast, whether it is the duplicate, agent.
    assert order == [(b, copy, agent) for b in (0, 1) for copy in (0.0, 1.0) for agent in ("0", "1")]


def test_rule_2_a_copy_that_a_link_holds_back_lands_just_after_the_one_before_it() -> None:
    class Shorter:
        """The first broadcast takes 4, the second 1: on a FIFO link it must wait."""

        def check(self, n_agents: int) -> None: ...

        def draw(self, draws: Any) -> Any:
            return np.full(draws.n_agents, 4.0 - 3.0 * draws.number)

    sends = [send_at(1.0, 0), send_at(2.0, 0)]
    for fifo, times in ((True, [5.0, 5.0]), (False, [5.0, 3.0])):
        parts = {"dynamics": "continuous", "channel": BroadcastChannel(Shorter(), fifo=fifo)}
        landed = [line for line in story(run(6.0, *sends, **parts)) if "deliver" in line]
        order = sorted(range(2), key=lambda b: times[b])
        assert landed == [f"{exactly(times[b])} agent 0 deliver {b}" for b in order]


@pytest.mark.parametrize("listed", list(permutations(["ramp", "step", "profile"])))
def test_rule_2_interventions_take_place_in_the_order_of_the_list(listed: tuple[str, ...]) -> None:
    """Each has scheduled what it does at 5 at another time: 0, 4 and 3."""
    changes: dict[str, Any] = {
        "step": CapacityStep(0, 5.0, 11.0),
        "ramp": CapacityRamp(0, 3.0, 5.0, 12.0, steps=2),
        "profile": CapacityProfile(0, [3.0, 5.0], [9.0, 13.0]),
    }

    def own(system: System) -> ProcessGenerator:
        yield system.env.at(5.0, EventKind.INTERVENE)
        assert system.log is not None
        system.log.add(5.0, Entry.CHANGE, 0, 0, -1, 0.0)

    last = {"step": 11.0, "ramp": 12.0, "profile": 13.0}
    events = run(6.0, own, interventions=[changes[name] for name in listed]).events
    events = events[events["time"] == 5.0]
    assert events["kind"].tolist() == ["capacity"] * 3 + ["change"]
    assert events["value"].tolist() == [*(last[name] for name in listed), 0.0]


@given(st.permutations([1.0, 2.0, 3.0, 4.0]))
def test_rule_2_all_else_keeps_the_order_in_which_it_was_scheduled(demands: list[float]) -> None:
    result = run(3.0, *[set_at(2.0, demand) for demand in demands])
    assert result.demand_at_end.tolist() == [[demands[-1] + 1.0]]
    changes = np.diff([2.0, *demands])  # each sees the one before it
    assert result.events["value"].tolist() == changes.tolist()


def test_rule_2_events_that_are_given_the_same_order_keep_their_turn() -> None:
    log: Log = []

    def ordered(what: str) -> Any:
        def process(system: System) -> ProcessGenerator:
            yield system.env.at(2.0, EventKind.SENSE, 7)
            log.append(what)

        return process

    run(3.0, ordered("first"), ordered("second"), ordered("third"))
    assert log == ["first", "second", "third"]


# -- 3. Ties that are exact on paper are exact -----------------------------------------------------------


@pytest.mark.parametrize(("period", "look"), [(0.1, 1e5), (0.3, 3e5), (1 / 3, 10**6 / 3), (0.7, 7e5)])
def test_rule_3_after_a_million_ticks_ties_are_exact(period: float, look: float) -> None:
    # One look, at the millionth tick.  Its signal arrives at once, and that very tick answers it: the demand
    # has grown by a million ticks and is halved.  Adding 0.1 a million times misses 100000 by 1e-6.
    result = run(
        look + 1.5 * period,
        problem=stage(capacity=1.0),
        clocks=Clocks(period),
        control_unit=Sampled(2 * look, look),
        demand=[math.nextafter(look, 0.0), look, math.nextafter(look, math.inf)],
    )
    assert result.events["kind"].tolist() == ["signal", "deliver", "respond"]
    assert result.events["time"].tolist() == [look] * 3
    # Before the tick, at it, just after it: observers at a tick see what was held since the tick before.
    assert list(totals(result).values()) == [1e6, 1e6, 5e5, 5e5 + 1]


@given(st.integers(1, 10**6), st.sampled_from([0.1, 0.7, 1 / 3]))
def test_rule_3_a_latency_that_ends_at_a_tick_is_answered_by_it(tick: int, period: float) -> None:
    # The latency is what is left to the tick: arrival and tick are equal, and DELIVER comes before ACT.
    due = tick * period
    sent_at = 0.5 * due
    wait = due - sent_at
    parts = {"clocks": Clocks(period), "channel": BroadcastChannel(wait)}
    result = run(due + period / 2, send_at(sent_at, 0), problem=stage(capacity=1e9), **parts)
    assert sent_at + wait == due
    assert result.events["time"].tolist() == [sent_at, due, due]
    assert result.demand_at_end.tolist() == [[tick / 2]]


# -- 4. A run covers [0, until) --------------------------------------------------------------------------


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_rule_4_what_is_due_at_the_end_does_not_happen(dynamics: str) -> None:
    sends = [send_at(5.0, 0), send_at(9.0, 0)]
    parts = {"dynamics": dynamics, "control_unit": Sampled(9.0), "channel": BroadcastChannel(4.0)}
    result = run(9.0, set_at(9.0, 100.0), *sends, **parts)
    # No intervention, no arrival, no look, no tick; but the last observation is made there.
    assert story(result) == ["5 signal 0"]
    assert totals(result) == {9.0: 9.0}
    assert result.account.in_flight.tolist() == [[1]]
    assert result.account.delivered.tolist() == [[0]]
    longer = run(math.nextafter(9.0, 10.0), set_at(9.0, 100.0), *sends, **parts)
    assert [line.split()[0] for line in story(longer)] == ["5"] + ["9"] * (len(story(longer)) - 1)
    assert {"change", "deliver", "signal", "respond"} == set(longer.events["kind"])


# -- 5. A total is summed in the order of the agents -----------------------------------------------------


@pytest.mark.parametrize("order", list(permutations([0.1, 0.2, 0.3])))
def test_rule_5_a_total_is_summed_by_index(order: tuple[float, ...]) -> None:
    # 0.1 + 0.2 + 0.3 is above 0.6 by one bit, 0.3 + 0.2 + 0.1 is not: whether the look at 1 signals depends
    # on the order, so the order is one that is promised.
    problem = stage(3, capacity=0.6, increase=list(order))
    result = run(1.5, problem=problem, control_unit=Sampled(), demand=[1.0], channel=BroadcastChannel(9.0))
    total = (order[0] + order[1]) + order[2]
    assert totals(result)[1.0] == total
    assert story(result) == (["1 signal 0"] if total > 0.6 else [])


def test_rule_5_the_orders_do_differ() -> None:
    assert {(a + b) + c for a, b, c in permutations([0.1, 0.2, 0.3])} == {0.6, 0.6000000000000001}


def test_rule_5_a_total_is_not_carried_along() -> None:
    # A thousand small changes, then the look: the sum of what is held, without the rounding of the way there.
    def wander(system: System) -> ProcessGenerator:
        for q in range(1000):
            yield system.env.at(0.001 * q, EventKind.INTERVENE)
            system.set_demand(q % 3, 0, 1.0 / (q + 3))

    result = run(1.0, wander, problem=stage(3), demand=[0.9995])
    held = [1.0 / (999 + 3), 1.0 / (997 + 3), 1.0 / (998 + 3)]  # of agents 0, 1 and 2
    assert totals(result)[0.9995] == (held[0] + held[1]) + held[2]


# -- 6. SimPy's own events come first --------------------------------------------------------------------


def test_rule_6_a_timeout_comes_before_all_kinds() -> None:
    log: Log = []

    def wait(system: System) -> ProcessGenerator:
        yield system.env.timeout(2.0)
        log.append("timeout")

    def pass_on(system: System) -> ProcessGenerator:
        yield system.env.at(2.0, EventKind.INTERVENE)
        log.append("intervention")
        done = system.env.event()
        done.callbacks.append(lambda event: log.append("succeed"))
        done.succeed()

    run(3.0, tell_at(log, EventKind.DELIVER, "arrival"), pass_on, wait)
    assert log[-4:] == ["timeout", "intervention", "succeed", "2 arrival"]


# -- not promised, and so without influence --------------------------------------------------------------


def wired(
    problem: Problem, seed: int, until: float, made: Sequence[int], started: Sequence[int], **parts: Any
) -> tuple[EventLog, System]:
    """Put a system together by hand: cameras made and processes started in any order."""
    log, n = EventLog(), problem.n_agents
    system = System(problem, parts["channel"], parts.get("clocks"), seed, until, log)
    cameras = {agent: AgentProcess(agent, system) for agent in made}
    system.agents.update(cameras)
    lives = [*(cameras[agent].process for agent in range(n)), lambda: parts["control_unit"].process(system)]
    for life in started:
        system.env.process(lives[life]())
    system.env.run_to(until)
    return log, system


RANDOM_CHANNEL = BroadcastChannel(latency.Exponential(0.8), loss=0.2, duplication=0.2)
SYSTEMS = {
    "in phase": {"channel": BroadcastChannel(), "clocks": Clocks(), "control_unit": Sampled()},
    "in phase, late": {"channel": BroadcastChannel(1.0), "clocks": Clocks(), "control_unit": Sampled(0.5)},
    "own clocks": {
        "channel": RANDOM_CHANNEL,
        "clocks": Clocks(0.9, "random", 0.01, 0.3),
        "control_unit": Sampled(0.5),
    },
    "sampled": {"channel": RANDOM_CHANNEL, "control_unit": Sampled(0.5, 0.25)},
    "crossing": {"channel": BroadcastChannel(), "control_unit": Crossing(0.0)},
    "crossing, late": {"channel": RANDOM_CHANNEL, "control_unit": Crossing(0.5)},
}


@pytest.mark.parametrize("name", SYSTEMS)
@settings(max_examples=12)
@given(problems(("polynomial", "coupled")), st.integers(0, 2**32), st.randoms(use_true_random=False))
def test_the_order_in_which_cameras_are_made_and_started_has_no_influence(
    name: str, problem: Problem, seed: int, shuffler: Any
) -> None:
    parts = SYSTEMS[name]
    n = problem.n_agents
    made, started = list(range(n)), list(range(n + 1))
    shuffler.shuffle(made)
    shuffler.shuffle(started)
    log, system = wired(problem, seed, 25.0, made, started, **parts)
    dynamics = "discrete" if "clocks" in parts else "continuous"
    simulation = Simulation(
        problem, dynamics=dynamics, seed=seed, recording=Recording(demand="end", events=True), **parts
    )
    result = quietly(simulation.run, 25.0)
    assert result.log is not None
    for one, other in zip(log.columns(), result.log.columns(), strict=True):
        assert np.array_equal(one, other)
    demand, average = system.allocations()
    assert np.array_equal(demand.T, result.demand_at_end)
    assert np.array_equal(average.T, result.average_at_end)
    for count in ("delivered", "lost", "in_flight", "duplicated"):
        assert np.array_equal(getattr(system.transmitter, count), getattr(result.account, count))


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_systems_above_do_respond(name: str) -> None:
    problem = random_problem(2, 5, 2)
    _, system = wired(problem, 0, 25.0, range(5), range(6), **SYSTEMS[name])
    assert (system.state.responses.sum(axis=1) > 3).all()


# -- any schedule ----------------------------------------------------------------------------------------


class Schedule:
    """What is planned, in quarters of a unit of time, and the log that the rules make of it."""

    def __init__(self, data: st.DataObject) -> None:
        quarters = st.integers(0, 20)
        turns = st.lists(
            st.tuples(quarters, st.sampled_from([EventKind.INTERVENE, EventKind.OBSERVE, EventKind.ACT]))
        )
        self.n = data.draw(st.integers(1, 4), "agents")
        each = {"min_size": self.n, "max_size": self.n}
        self.own = data.draw(turns, "own events")
        self.looks = sorted(data.draw(st.sets(quarters), "looks"))
        delays = st.lists(st.integers(0, 8), **each)
        self.delays = [data.draw(delays, "latencies") for _ in self.looks]
        self.periods = data.draw(st.lists(st.integers(1, 6), **each), "periods")
        self.phases = data.draw(st.lists(quarters, **each), "phases")

    def expected(self, until: int) -> Log:
        """Run a queue of (time, kind, order) by hand."""
        queue: list[tuple[int, int, tuple[int, ...]]] = []
        last = (1 << 60,)  # behind all agents
        for turn, (time, kind) in enumerate(self.own):
            heappush(queue, (time, kind, (*last, turn)))
        for look, time in enumerate(self.looks):
            heappush(queue, (time, EventKind.SENSE, (look,)))
        log: Log = []
        waiting: set[int] = set()
        while queue and queue[0][0] < until:
            time, kind, order = heappop(queue)
            log.append((time / 4, EventKind(kind), order[-1]))
            if kind == EventKind.SENSE:
                for agent, delay in enumerate(self.delays[order[0]]):
                    heappush(queue, (time + delay, EventKind.DELIVER, (order[0], agent)))
            elif kind == EventKind.DELIVER and order[1] not in waiting:
                agent = order[1]
                waiting.add(agent)
                since = max(time - self.phases[agent], 0)
                tick = self.phases[agent] + -(-since // self.periods[agent]) * self.periods[agent]
                heappush(queue, (tick, EventKind.ACT, (agent,)))
            elif kind == EventKind.ACT and order[0] < last[0]:
                waiting.discard(order[0])
        return log

    def played(self, until: int) -> Log:
        """The same, by the program."""
        log: Log = []

        class Listed(AgentProcess):
            def receive(self, signal: Signal) -> None:
                log.append((self.system.env.now, EventKind.DELIVER, self.agent))
                super().receive(signal)

            def answer(self, signals: list[Signal], moment: float) -> None:
                log.append((self.system.env.now, EventKind.ACT, self.agent))
                super().answer(signals, moment)

        def own(turn: int, time: int, kind: EventKind) -> Any:
            def process(system: System) -> ProcessGenerator:
                yield system.env.at(time / 4, kind)
                log.append((system.env.now, kind, turn))

            return process

        looks = self.looks

        class Planned:
            def process(self, system: System) -> ProcessGenerator:
                for look, time in enumerate(looks):
                    yield system.env.at(time / 4, EventKind.SENSE)
                    log.append((system.env.now, EventKind.SENSE, look))
                    system.broadcast(0)

        class Delays:
            def open(self, n_agents: int, keys: Any) -> "Delays":
                return self

            def transmit(self, sent: Broadcast, departure: float) -> Copies:
                return Copies(np.array([departure + delay / 4 for delay in delays[sent.number]]))

        delays = self.delays
        clocks = Clocks([period / 4 for period in self.periods], [phase / 4 for phase in self.phases])
        run(
            until / 4,
            *[own(turn, time, kind) for turn, (time, kind) in enumerate(self.own)],
            problem=stage(self.n, capacity=1000.0),
            agents=Listed,
            clocks=clocks,
            control_unit=Planned(),
            channel=Delays(),
        )
        return log


@given(st.data())
def test_any_schedule_is_played_in_the_order_of_the_rules(data: st.DataObject) -> None:
    schedule = Schedule(data)
    until = data.draw(st.integers(1, 40), "until")
    assert schedule.played(until) == schedule.expected(until)
