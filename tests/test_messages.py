"""Nothing but the bit travels: every message of whole runs is inspected, and an agent alone does the same.

What an agent receives is a `Signal`: which of the m one-bit signals is set, and the address of its draw.  The
address is the program's, not the agent's: where draws do not depend on it, nothing does.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    CoupledCosts,
    Crossing,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Result,
    Sampled,
    Simulation,
    latency,
)
from aimd_des.channel import Broadcast, Copies, Link
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from tests.conftest import quadratic_problem, quietly, random_problem, signals_of

BUSY = {"latency": latency.Exponential(0.8), "loss": 0.2, "duplication": 0.3}
PHASES, DRIFTS = np.array([0.0, 0.3, 0.9, 0.5, 0.1]), np.array([0.01, 0.0, -0.02, 0.03, -0.01])
WAYS: dict[str, dict[str, Any]] = {
    "continuous, crossing": {"dynamics": "continuous", "control_unit": Crossing(0.5)},
    "continuous, sampled": {"dynamics": "continuous", "control_unit": Sampled(0.7)},
    "discrete": {"control_unit": Sampled()},
    "own clocks": {"control_unit": Sampled(0.6), "clocks": Clocks(1.1, PHASES, DRIFTS)},
}


class Tapped:
    """A channel that keeps what it is given, and what it says."""

    def __init__(self, **options: Any) -> None:
        self.channel = BroadcastChannel(**options)
        self.sent: list[tuple[Broadcast, float]] = []
        self.copies: list[Copies] = []
        self.link: Link | None = None

    def open(self, n_agents: int, keys: Any) -> "Tapped":
        self.link = self.channel.open(n_agents, keys)
        return self

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        assert self.link is not None
        copies = self.link.transmit(broadcast, departure)
        self.sent.append((broadcast, departure))
        self.copies.append(copies)
        return copies


def run(problem: Problem, until: float = 60.0, **parts: Any) -> Result:
    parts = {"seed": 3, "recording": Recording(events=True), **parts}
    return quietly(Simulation(problem, **parts).run, until)


# -- what is sent, and what arrives ----------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
def test_a_message_is_a_bit_and_the_address_of_a_draw(way: str) -> None:
    problem, tapped = random_problem(2, 5, 2), Tapped(**BUSY)
    received: list[tuple[float, int, Any]] = []

    class Listening(AgentProcess):
        def receive(self, *message: Any) -> None:
            assert len(message) == 1
            received.append((self.system.env.now, self.agent, message[0]))
            super().receive(*message)

    result = run(problem, agents=Listening, channel=tapped, **WAYS[way])
    assert len(received) == (result.account.delivered + result.account.duplicated).sum() > 100
    # To the channel goes which bit is set; beside it, for the program's own books, number and time.
    for (broadcast, departure), (time, j, number) in zip(tapped.sent, signals_of(result), strict=True):
        assert type(broadcast) is Broadcast
        assert tuple(broadcast) == (j, number, time)
        assert departure == time
    # To an agent goes the same without the time: which bit, how many before it, and whether it is a copy.
    sent = {(broadcast.resource, broadcast.number) for broadcast, _ in tapped.sent}
    for _, _, signal in received:
        assert type(signal) is Signal
        assert [type(part) for part in signal] == [int, int, int]
        assert (signal.resource, signal.number) in sent
        assert signal.resource in range(2)
        assert signal.copy in (0, 1)
    # It arrives when the channel said, and nothing arrives beside.
    said = sorted(
        (float(time), agent, Signal(broadcast.resource, broadcast.number, copy))
        for (broadcast, _), copies in zip(tapped.sent, tapped.copies, strict=True)
        for copy, times in enumerate((copies.arrival, copies.second))
        if times is not None
        for agent, time in enumerate(times)
        if time < 60.0
    )
    assert sorted(received) == said


@pytest.mark.parametrize("way", WAYS)
def test_where_draws_are_constant_numbers_mean_nothing(way: str) -> None:
    """Signals are renumbered, and duplicates taken for first copies, on their way to the agents."""
    problem = random_problem(2, 5, 2)

    def agents(renumber: Callable[[Signal], Signal]) -> Callable[[int, System], AgentProcess]:
        class Renumbered(AgentProcess):
            def __init__(self, agent: int, system: System) -> None:
                super().__init__(agent, system)
                system.response_draws = lambda signal: [0.02, 0.1, 0.08, 0.05, 0.04]  # type: ignore[assignment]

            def receive(self, signal: Signal) -> None:
                super().receive(renumber(signal))

        return Renumbered

    parts = {"channel": BroadcastChannel(**BUSY), **WAYS[way]}
    as_sent = run(problem, agents=agents(lambda signal: signal), **parts)
    muddled = run(
        problem,
        agents=agents(lambda signal: Signal(signal.resource, 999_983 - 7 * signal.number, 0)),
        **parts,
    )
    assert (as_sent.account.responses.sum(axis=1) >= 8).all()
    assert as_sent.demand.equals(muddled.demand)
    assert as_sent.allocations.equals(muddled.allocations)
    assert as_sent.signals.equals(muddled.signals)
    assert np.array_equal(as_sent.account.responses, muddled.account.responses)
    kept = ["time", "kind", "resource", "agent", "value"]
    assert as_sent.events[kept].equals(muddled.events[kept])
    # The bit itself does mean something.
    crossed = run(
        problem, agents=agents(lambda signal: signal._replace(resource=1 - signal.resource)), **parts
    )
    assert not as_sent.demand.equals(crossed.demand)


# -- an agent alone --------------------------------------------------------------------------------------


def alone(problem: Problem, i: int) -> Problem:
    """The part of a problem that agent i knows: its cost, its alpha and beta, and Gamma."""
    costs = problem.costs
    if isinstance(costs, CoupledCosts):
        own = PolynomialCosts(costs.separable_part.exponents, costs.separable_part.coefficients[i : i + 1])
        mine: Any = CoupledCosts(
            own,
            costs.quadratic[i : i + 1],
            costs.weights[i : i + 1],
            costs.sum_exponents,
            costs.sum_coefficients[i : i + 1],
        )
    else:
        assert isinstance(costs, PolynomialCosts)
        mine = PolynomialCosts(costs.exponents, costs.coefficients[i : i + 1])
    resources = [
        Resource(
            each.name,
            capacity=1e9,  # unknown to it
            increase=float(problem.increase[i, j]),
            decrease=float(problem.decrease[i, j]),
            normalization=each.normalization,
        )
        for j, each in enumerate(problem.resources)
    ]
    return Problem(resources, mine)


@pytest.mark.parametrize("family", ["polynomial", "coupled"])
@pytest.mark.parametrize("way", WAYS)
def test_an_agent_that_hears_the_same_bits_does_the_same_alone(way: str, family: str) -> None:
    """No total, no capacity, no other agent: with its draws and its clock, the bits are all it needs."""
    problem, heard = random_problem(2, 5, 2, family, per_agent=True), []

    class Listening(AgentProcess):
        def receive(self, signal: Signal) -> None:
            heard.append(
                (self.agent, self.system.env.now, signal, self.system.response_draws(signal)[self.agent])
            )
            super().receive(signal)

    parts = {key: part for key, part in WAYS[way].items() if key != "control_unit"}
    company = run(problem, agents=Listening, channel=BroadcastChannel(**BUSY), **WAYS[way])
    assert company.account.responses.sum() > 30
    for i in range(5):
        mine = [(time, signal, draw) for agent, time, signal, draw in heard if agent == i]
        draws = {signal: [draw] for _, signal, draw in mine}

        def repeat(system: System, bits: Any = mine, known: Any = draws) -> ProcessGenerator:
            system.response_draws = known.__getitem__
            for time, signal, _ in bits:
                yield system.env.at(time, EventKind.DELIVER)
                system.agents[0].receive(signal)

        if "clocks" in parts:
            parts["clocks"] = Clocks(1.1, PHASES[i], DRIFTS[i])
        single = run(alone(problem, i), processes=[repeat], control_unit=Sampled(1.0, 1e6), **parts)
        assert single.demand_at_end.tolist() == company.demand_at_end[[i]].tolist()
        assert single.average_at_end.tolist() == company.average_at_end[[i]].tolist()
        assert single.account.responses[:, 0].tolist() == company.account.responses[:, i].tolist()
        assert min(single.account.responses[:, 0]) > 0


# -- the account -----------------------------------------------------------------------------------------


def bits_per_event(n: int) -> tuple[float, int]:
    """Messages that leave the control unit in a run, over its capacity events; and the latter."""
    tapped = Tapped(latency=0.3)
    problem = quadratic_problem(
        np.linspace(1.0, 3.0, n).tolist(), capacity=0.05 * n, increase=0.01, normalization=0.05
    )
    result = run(problem, 30.0, channel=tapped, dynamics="continuous", control_unit=Crossing(1.0))
    events = int((result.events["kind"] == "signal").sum())
    assert events == len(result.signals) == result.summary()["signals"].sum()
    # Each is for all to hear: one broadcast, and a copy of it at every agent.
    delivered = result.account.delivered + result.account.in_flight
    assert (delivered == events).all()
    return len(tapped.sent) / events, events


def test_the_bits_of_a_capacity_event_do_not_depend_on_the_number_of_agents() -> None:
    few, many = bits_per_event(60), bits_per_event(6000)
    assert few[0] == many[0] == 1.0
    # And there are not more events: the same resource for each, the same rhythm.
    assert min(few[1], many[1]) > 5
    assert abs(few[1] - many[1]) <= 3


def test_a_look_that_finds_nothing_sends_nothing() -> None:
    tapped = Tapped()
    result = run(random_problem(2, 5, 3), channel=tapped, control_unit=Sampled(0.5))
    looks = 120 * 3
    assert 30 < len(tapped.sent) == len(result.signals) < looks
