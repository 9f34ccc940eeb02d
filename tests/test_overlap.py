"""Faults that overlap, faults and signals that leave later, and what a unit that takes over knows."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    latency,
)
from aimd_des.channel import Broadcast, Draws
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import Failover, Partition, UnusualActivity, reconnect, recover, weigh
from aimd_des.problem.costs import Costs, weighted_costs
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose
from tests.conftest import quadratic_problem, quietly, random_problem

EVENTS = Recording(demand="end", events=True)
BOTH = pytest.mark.parametrize("agents", [AgentProcess, Fleet])


def growing(n: int = 2, **changes: Any) -> Problem:
    """Agents that add 1 per unit of time, are above the capacity from then on, and hardly ever respond."""
    options = {"capacity": 1.0, "increase": 1.0, "normalization": 1e-9, **changes}
    return quadratic_problem([1.0 + i for i in range(n)], **options)


def run(problem: Problem, until: float, *interventions: Any, **parts: Any) -> Result:
    options: dict[str, Any] = {
        "dynamics": "continuous",
        "control_unit": Sampled(phase=1.0),
        "recording": EVENTS,
        "seed": 1,
        **parts,
    }
    return quietly(Simulation(problem, interventions=interventions, **options).run, until)


def told(result: Result, kind: str, agent: int | None = None) -> list[float]:
    events = result.events[result.events["kind"] == kind]
    if agent is not None:
        events = events[events["agent"] == str(agent)]
    return [float(time) for time in events["time"]]


# -- what begins twice ends twice ------------------------------------------------------------------------


@BOTH
def test_an_agent_hears_again_when_the_last_partition_is_over(agents: Any) -> None:
    result = run(growing(), 45.0, Partition(10.0, 20.0), Partition(20.0, 20.0, [0]), agents=agents)
    for agent, heals in ((0, 40), (1, 30)):
        assert told(result, "deliver", agent) == [*range(1, 10), *range(heals, 45)]
        assert told(result, "lost", agent) == [*range(10, heals)]
    assert [told(result, "cut"), told(result, "heal")] == [[10.0, 10.0], [30.0, 40.0]]


@BOTH
@pytest.mark.parametrize("second", [(6.0, 5.0), (5.0, 1.0), (4.5, 6.5), (7.75, 3.25)])
def test_the_last_of_overlapping_faults_lets_a_control_unit_take_over(
    second: tuple[float, float], agents: Any
) -> None:
    end = max(7.75, sum(second))
    faults = Failover(4.5, 3.25), Failover(*second)
    result = run(growing(), 13.0, *faults, agents=agents)
    assert result.signals["time"].tolist() == [*range(1, 5), *np.arange(np.ceil(end), 13.0)]
    assert [told(result, "fail")[0], told(result, "recover")[-1]] == [4.5, end]
    crossing = run(growing(), 13.0, *faults, agents=agents, control_unit=Crossing(1.0))
    assert next(time for time in crossing.signals["time"] if time >= 4.5) == end


@BOTH
def test_weights_of_activities_are_multiplied_and_come_back_exactly(agents: Any) -> None:
    """0.3 over [5, 20), 0.6 over [10, 15), 0.7 over [12, 25)."""
    problem, late = random_problem(4, 5, 2), UnusualActivity([0, "3"], 10.0, 15.0, 0.6)
    activities = [UnusualActivity(0, 5.0, 20.0, 0.3), late, UnusualActivity(0, 12.0, 25.0, 0.7)]
    result = run(problem, 30.0, *activities, agents=agents)

    def weighed(first: float, fourth: float = 1.0) -> Any:
        return coefficients(weighted_costs(problem.costs, [first, 1.0, 1.0, fourth, 1.0]))

    wanted = [0.3, 0.3 * 0.6, (0.3 * 0.6) * 0.7, 0.3 * 0.7, 0.7]
    found = [piece.costs for piece in result.history]
    assert [piece.start for piece in result.history] == [0.0, 5.0, 10.0, 12.0, 15.0, 20.0, 25.0]
    assert found[0] is found[-1] is problem.costs
    for costs, weight, fourth in zip(found[1:-1], wanted, [1.0, 0.6, 0.6, 1.0, 1.0], strict=True):
        assert np.array_equal(coefficients(costs), weighed(weight, fourth))
    assert ((0.3 * 0.6) * 0.7) / 0.6 != 0.3 * 0.7  # what dividing would have left


def coefficients(costs: Costs) -> Any:
    assert isinstance(costs, PolynomialCosts)
    return costs.coefficients


def test_two_activities_that_are_alike_are_two() -> None:
    twice = [UnusualActivity(0, 5.0, 10.0, 0.5)] * 2
    result = run(growing(), 15.0, *twice)
    assert coefficients(result.history[1].costs)[:, 0, 0].tolist() == [0.25, 2.0]
    assert result.history[2].costs is result.problem.costs


def test_of_one_who_weighs_the_latest_weight_counts() -> None:
    def own(system: System) -> ProcessGenerator:
        for time, weight in ((4.0, 0.5), (6.0, 0.25), (8.0, 1.0)):
            yield system.env.at(time, EventKind.INTERVENE)
            weigh(system, ["1"], weight)

    result = run(growing(), 12.0, UnusualActivity(1, 5.0, 10.0, 3.0), processes=[own])
    weights = [coefficients(piece.costs)[1, 0, 0] / 2.0 for piece in result.history]
    assert weights == [1.0, 0.5, 1.5, 0.75, 3.0, 1.0]


def test_what_has_not_begun_cannot_end() -> None:
    refusals = []

    def meddle(system: System) -> ProcessGenerator:
        yield system.env.at(1.0, EventKind.INTERVENE)
        wrongs: list[Callable[[], None]] = [lambda: reconnect(system, ["1"]), lambda: recover(system)]
        for wrong in wrongs:
            with pytest.raises(InputError) as caught:
                wrong()
            refusals.append(str(caught.value))

    run(growing(), 3.0, processes=[meddle])
    assert refusals == [
        "agent = '1': must be one that is cut off; it hears",
        "control unit = 'up': must be down before it recovers; let it fail first",
    ]


# -- what leaves while something is in the way -----------------------------------------------------------

# Looks at 1, 2, 3, ...; signals leave at 1.75, 2.75, 3.75, ...
FAULTS: list[tuple[Partition | Failover, list[int]]] = [
    (Partition(2.5, 1.0), [2]),
    (Partition(2.75, 1.0), [2]),  # what begins when it leaves comes first
    (Partition(2.0, 0.75), []),  # and so does what ends then
    (Partition(2.9, 0.5), []),
    (Partition(2.5, 2.5, ["0", "1"]), [2, 3, 4]),
    (Failover(2.5, 0.4), [2]),
    (Failover(2.1, 0.65), []),
]
CUT = [(Sampled(phase=1.0, sensing_delay=0.75), *fault) for fault in FAULTS] + [
    # One that takes over looks at once, and then at other times.
    (Crossing(1.0, sensing_delay=0.75), fault, cut)
    for fault, cut in FAULTS
    if isinstance(fault, Partition)
]


@BOTH
@pytest.mark.parametrize(("control_unit", "fault", "cut"), CUT, ids=str)
def test_a_signal_is_cut_when_it_leaves(control_unit: Any, fault: Any, cut: list[int], agents: Any) -> None:
    problem = growing(2, capacity=2.0)
    for until in (8.0, 2.7) if fault.at < 2.7 else (8.0,):
        result = run(problem, until, fault, control_unit=control_unit, agents=agents)
        looks = result.signals["time"].tolist()
        assert looks == [*range(2 if isinstance(control_unit, Sampled) else 1, int(until + 0.5))]
        late = [look + 0.75 for look in looks if look + 0.75 < until]
        lost = [time for time in late if time - 0.75 in cut]
        for agent in (0, 1):
            assert told(result, "lost", agent) == lost
            assert told(result, "deliver", agent) == [time for time in late if time not in lost]
        assert result.account.lost[0].tolist() == [len(lost)] * 2
        assert result.account.in_flight[0].tolist() == [len(looks) - len(late)] * 2
        # The same in compiled code, which is not used where a log is kept.
        unlogged = run(
            problem, until, fault, control_unit=control_unit, agents=agents, recording=Recording(demand="end")
        )
        for name in ("delivered", "lost", "in_flight"):
            one, other = (getattr(each.account, name) for each in (result, unlogged))
            assert np.array_equal(one, other), name


class Given:
    """Latencies by the number of the broadcast: a user's model."""

    def __init__(self, *latencies: float) -> None:
        self.latencies = latencies

    def check(self, n_agents: int) -> None:
        """Any number."""

    def draw(self, draws: Draws) -> Any:
        return np.full(draws.n_agents, self.latencies[min(draws.number, len(self.latencies) - 1)])


@BOTH
@pytest.mark.parametrize("delay", [0.0, 0.25])
def test_a_copy_that_is_cut_holds_nobody_back(delay: float, agents: Any) -> None:
    """The signal of 2 would take 30 and is destroyed; those of 3, 4, ... come in their time."""
    channel = BroadcastChannel(Given(0.125, 30.0, 0.125), fifo=True, duplication=0.5)
    control_unit = Sampled(phase=1.0, sensing_delay=delay)
    result = run(
        growing(capacity=0.5), 8.0, Partition(1.5, 1.0), channel=channel, control_unit=control_unit,
        agents=agents,
    )  # fmt: skip
    arrived = [look + delay + 0.125 for look in (1, 3, 4, 5, 6, 7)]
    for agent in (0, 1):
        assert sorted(set(told(result, "deliver", agent))) == arrived
    # Nothing is destroyed: everything waits for the second.
    whole = run(growing(capacity=0.5), 8.0, channel=channel, control_unit=control_unit, agents=agents)
    assert set(told(whole, "deliver")) == {1.0 + delay + 0.125}


@BOTH
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_links_keep_the_order_of_what_is_not_cut(delay: float, agents: Any) -> None:
    """Against the draws of the channel, put in order one by one; the fleet does it in compiled code."""
    problem, faults = random_problem(3, 4, 1), (Partition(15.0, 5.0, [0, 1]), Partition(18.0, 5.0, [1, 2]))
    parts: dict[str, Any] = {"latency": latency.Uniform(0.0, 20.0), "loss": 0.2}
    options = {
        "channel": BroadcastChannel(fifo=True, **parts),
        "control_unit": Sampled(sensing_delay=delay),
        "agents": agents,
    }
    result = run(problem, 60.0, *faults, **options)
    link = BroadcastChannel(**parts).open(4, {purpose: rng.key(1, purpose) for purpose in Purpose})
    sent = [
        (time + delay, link.transmit(Broadcast(0, number, time), time + delay).arrival.tolist())
        for number, time in enumerate(result.signals["time"].tolist())
    ]

    def cut(agent: int, leaves: float) -> bool:
        return (agent in (0, 1) and 15.0 <= leaves < 20.0) or (agent in (1, 2) and 18.0 <= leaves < 23.0)

    def in_order(agent: int, *, held_back: bool) -> list[float]:
        """When copies arrive; `held_back` by those that are cut, too."""
        latest, found = 0.0, []
        for leaves, arrival in sent:
            if arrival[agent] < np.inf and leaves < 60.0:
                before, latest = latest, max(latest, arrival[agent])
                if cut(agent, leaves):
                    latest = latest if held_back else before
                elif latest < 60.0:
                    found.append(latest)
        return found

    assert len(sent) > 20
    heard = [told(result, "deliver", agent) for agent in range(4)]
    assert heard == [in_order(agent, held_back=False) for agent in range(4)]
    assert heard != [in_order(agent, held_back=True) for agent in range(4)]
    plain = run(problem, 60.0, *faults, **options, recording=Recording(demand="end"))
    assert plain.signals.equals(result.signals)
    assert np.array_equal(plain.demand_at_end, result.demand_at_end)
    assert np.array_equal(plain.account.delivered, result.account.delivered)
    assert np.array_equal(plain.account.lost, result.account.lost)


# -- what the unit that takes over knows -----------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("fault", [Failover(11.0, 1.0), Failover(4.5, 7.5), Failover(9.5, 2.5)])
def test_a_hold_off_that_has_adapted_is_forgotten_by_the_unit_that_takes_over(
    fault: Failover, agents: Any
) -> None:
    """Nobody answers: hold-offs of 1, 2, 4 after 2, and from 12 on again; one of 8 would end at 17."""
    unit = Crossing(1.0, longest_hold_off=8.0)
    result = run(growing(1, capacity=2.0), 20.0, fault, control_unit=unit, agents=agents)
    before = [time for time in (2.0, 3.0, 5.0, 9.0) if time < fault.at]
    assert result.signals["time"].tolist() == [*before, 12.0, 13.0, 15.0, 19.0]
