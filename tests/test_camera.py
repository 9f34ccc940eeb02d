"""One agent as one process: the rule, read literally, with clocks of their own and in continuous time."""

import math
from collections.abc import Sequence
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    CoupledCosts,
    Crossing,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    latency,
    loss,
)
from aimd_des.channel import Broadcast, Copies
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.utils.rng import Purpose, key
from tests.conftest import (
    problems,
    quadratic_problem,
    quietly,
    random_problem,
    reference_derivative,
    reference_draws,
    resource,
    signals_of,
)


def simulate(problem: Problem, until: float, seed: int = 0, **parts: Any) -> Result:
    return quietly(Simulation(problem, seed=seed, **parts).run, until)


def exactly(time: float) -> str:
    """A time without zeros at its end, and with all digits that it has."""
    return repr(time).removesuffix(".0")


def story(result: Result) -> list[str]:
    """The log, one line for each entry: time, what happened, to whom, in which broadcast."""
    names = result.problem.agent_names
    return [
        f"{exactly(event.time)} {f'agent {event.agent} ' if event.agent in names else ''}"
        f"{event.kind} {event.number}"
        for event in result.events.itertuples()
    ]


class Intervention(NamedTuple):
    """A demand that is set from outside."""

    time: float
    agent: int
    resource: int
    demand: float


def set_demands(interventions: Sequence[Intervention]) -> Any:
    """A process that sets demands, in the order of time."""

    def process(system: System) -> ProcessGenerator:
        for time, agent, j, demand in interventions:
            yield system.env.at(time, EventKind.INTERVENE)
            system.set_demand(agent, j, demand)

    return process


@st.composite
def interventions_in(draw: st.DrawFn, problem: Problem) -> list[Intervention]:
    """Up to five, at quarters of a unit of time, up to twice the share of an agent."""
    size = draw(st.sampled_from([0, 0, 1, 3, 5]))
    times = sorted(0.25 * q for q in draw(st.lists(st.integers(0, 80), min_size=size, max_size=size)))
    agents, resources = st.integers(0, problem.n_agents - 1), st.integers(0, problem.n_resources - 1)
    planned = []
    for time in times:
        j = draw(resources)
        share = float(problem.capacity[j]) / problem.n_agents
        planned.append(Intervention(time, draw(agents), j, share * draw(st.floats(0.0, 2.0))))
    return planned


# -- the rule, event by event ----------------------------------------------------------------------------


class Literal:
    """The system in plain Python: every tick of every agent, every piece of every line, one by one.

    Uniform draws and the fate of copies are shared with the program, times of ticks are given; all else is
    written down once more.
    """

    def __init__(
        self,
        problem: Problem,
        channel: BroadcastChannel,
        control_unit: Sampled | Crossing,
        seed: int,
        ticks: list[list[float]] | None,
        interventions: Sequence[Intervention] = (),
    ) -> None:
        n, m = problem.n_agents, problem.n_resources
        self.problem, self.control_unit, self.seed = problem, control_unit, seed
        self.link = channel.open(n, {purpose: key(seed, purpose) for purpose in Purpose})
        self.continuous = ticks is None
        self.now = 0.0
        self.x = [[0.0] * m for _ in range(n)]
        self.accumulated = [[0.0] * m for _ in range(n)]  # over ticks, or over time
        self.ticked = [0] * n
        self.latch: list[list[tuple[int, int] | None]] = [[None] * m for _ in range(n)]
        self.signals: list[tuple[float, int, int]] = []
        self.responses = [[0] * m for _ in range(n)]
        self.margin = math.inf
        self.held_off = [0.0] * m
        self.heap: list[tuple[float, str, tuple[int, ...]]] = []
        self.interventions = interventions
        for turn, intervention in enumerate(interventions):
            self.push(intervention.time, " intervention", turn)
        if isinstance(control_unit, Sampled):
            self.push(control_unit.phase, "B look", 0)
        for i, times in enumerate(ticks or []):
            for time in times:
                self.push(time, "C tick", i)

    def push(self, time: float, kind: str, *what: int) -> None:
        # The first letters are in the order of the kinds: interventions, arrivals, looks, ticks.
        heappush(self.heap, (time, kind, what))

    def run(self, until: float) -> None:
        while True:
            crossing, j = self.next_crossing()
            due = self.heap[0] if self.heap else (math.inf, "", ())
            if min(crossing, due[0]) >= until:
                break
            self.margin = min(self.margin, abs(crossing - due[0]) if crossing != due[0] else math.inf)
            if (crossing, "B look") < due[:2]:
                self.pass_to(crossing)
                self.held_off[j] = crossing + self.control_unit.hold_off  # type: ignore[union-attr]
                self.broadcast(j)
            else:
                time, kind, what = heappop(self.heap)
                self.pass_to(time)
                handle = {" ": self.intervene, "A": self.arrive, "B": self.look, "C": self.tick}[kind[0]]
                handle(*what)
        self.pass_to(until)

    def pass_to(self, time: float) -> None:
        if self.continuous:
            span = time - self.now
            for i, row in enumerate(self.x):
                for j in range(len(row)):
                    grown = row[j] + self.problem.increase[i, j] * span
                    self.accumulated[i][j] += 0.5 * span * (row[j] + grown)
                    row[j] = grown
        self.now = time

    def next_crossing(self) -> tuple[float, int]:
        if not isinstance(self.control_unit, Crossing):
            return math.inf, 0
        instants = []
        for j, limit in enumerate(self.problem.limit.tolist()):
            below = max(limit - sum(row[j] for row in self.x), 0.0)
            reached = self.now + below / sum(self.problem.increase[:, j].tolist())
            instants.append((max(reached, self.held_off[j]), j))
        return min(instants)

    def intervene(self, turn: int) -> None:
        _, i, j, demand = self.interventions[turn]
        self.x[i][j] = demand

    def look(self, q: int) -> None:
        for j, limit in enumerate(self.problem.limit.tolist()):
            total = sum(row[j] for row in self.x)
            self.margin = min(self.margin, abs(total / limit - 1))
            if total > limit:
                self.broadcast(j)
        assert isinstance(self.control_unit, Sampled)
        self.push(self.control_unit.phase + (q + 1) * self.control_unit.period, "B look", q + 1)

    def broadcast(self, j: int) -> None:
        number = sum(signal[1] == j for signal in self.signals)
        copies = self.link.transmit(
            Broadcast(j, number, self.now), self.now + self.control_unit.sensing_delay
        )
        for copy, row in enumerate((copies.arrival, copies.second)):
            for i, arrival in enumerate([] if row is None else row.tolist()):
                if arrival < math.inf:
                    self.push(arrival, "A arrival", len(self.signals), copy, i, j, number)
        self.signals.append((self.now, j, number))

    def arrive(self, broadcast: int, copy: int, i: int, j: int, number: int) -> None:
        if self.continuous:
            self.answer(i, j, (number, copy), self.averages(i))
        elif self.latch[i][j] is None:
            self.latch[i][j] = (number, copy)

    def tick(self, i: int) -> None:
        for j, held in enumerate(self.x[i]):
            self.accumulated[i][j] += held
        self.ticked[i] += 1
        averages = self.averages(i)
        for j, latched in enumerate(self.latch[i]):
            if latched is None:
                self.x[i][j] += self.problem.increase[i, j]
            else:
                self.answer(i, j, latched, averages)
        self.latch[i] = [None] * len(self.latch[i])

    def averages(self, i: int) -> list[float]:
        passed = self.now if self.continuous else self.ticked[i]
        return [held / passed if passed else 0.0 for held in self.accumulated[i]]

    def answer(self, i: int, j: int, latched: tuple[int, int], averages: list[float]) -> None:
        if averages[j] == 0:
            return
        slope = reference_derivative(self.problem.costs, i, averages, j)
        probability = self.problem.normalization[j] * slope / averages[j]
        number, copy = latched
        draw = lane_draws(self.seed, j, number, len(self.x), copy)[i]
        self.margin = min(self.margin, abs(probability - draw))
        if draw < probability:
            self.x[i][j] *= self.problem.decrease[i, j]
            self.responses[i][j] += 1

    def at_the_end(self) -> tuple[Any, Any]:
        """Demands, and averages; a discrete one counts the present demand."""
        x, accumulated = np.array(self.x), np.array(self.accumulated)
        if self.continuous:
            return x, accumulated / self.now
        return x, (accumulated + x) / (np.array(self.ticked)[:, None] + 1)


def lane_draws(seed: int, j: int, number: int, n: int, copy: int) -> Any:
    """The draws for answers, by NumPy alone: a second copy has its own lane."""
    words = np.random.SeedSequence(seed, spawn_key=(Purpose.RESPONSE,)).generate_state(2, np.uint64)
    return np.random.Generator(np.random.Philox(key=words, counter=[0, copy, j, number])).random(n)


def tick_times(
    seed: int, until: float, n: int, period: Any, phase: Any, drift: Any, jitter: Any
) -> list[list[float]]:
    """All ticks of all agents before the end, by NumPy alone."""
    of_each = [np.broadcast_to(value, n).tolist() for value in (period, drift, jitter)]
    period, drift, jitter = of_each
    own = [p * (1 + d) for p, d in zip(period, drift, strict=True)]
    if isinstance(phase, str):
        starts = [p * u for p, u in zip(own, reference_draws(seed, Purpose.CLOCK, 1, 0, n), strict=True)]
    else:
        starts = np.broadcast_to(phase, n).tolist()
    rows = [reference_draws(seed, Purpose.CLOCK, 0, q, n) for q in range(math.ceil(until / min(own)) + 1)]
    return [
        [
            time
            for q, row in enumerate(rows)
            if (time := starts[i] + q * own[i] + (jitter[i] * row[i] if jitter[i] else 0.0)) < until
        ]
        for i in range(n)
    ]


CHANNELS = [
    {},
    {"latency": 0.7},
    {"latency": 2.0, "loss": 0.3},
    {"latency": latency.Exponential(1.3), "loss": 0.2, "duplication": 0.3},
    {"latency": latency.Exponential(1.3), "duplication": 0.5, "fifo": True},
    {"latency": latency.Uniform(0.0, 3.0), "loss": loss.GilbertElliott(0.3, 2.0)},
]
RHYTHMS = [
    {"period": 1.0, "phase": 0.0, "drift": 0.0, "jitter": 0.0},
    {"period": 1.0, "phase": "random", "drift": 0.0, "jitter": 0.0},
    {"period": 0.7, "phase": 0.25, "drift": 0.0, "jitter": 0.0},
    {"period": 1.0, "phase": "random", "drift": 0.03, "jitter": 0.0},
    {"period": 1.0, "phase": 0.5, "drift": -0.1, "jitter": 0.8},
    {"period": 1.3, "phase": "random", "drift": 0.01, "jitter": 0.4},
]
SAMPLED = [Sampled(), Sampled(0.5, 0.25), Sampled(2.3), Sampled(1.0, 0.5, sensing_delay=0.4)]
CROSSING = [Crossing(1.0), Crossing(0.3), Crossing(2.5, sensing_delay=0.4)]


def assert_same(literal: Literal, result: Result) -> None:
    assert [signal[1:] for signal in signals_of(result)] == [signal[1:] for signal in literal.signals]
    times = [signal[0] for signal in literal.signals]
    np.testing.assert_allclose(result.signals_sent.time, times, rtol=1e-9)
    assert result.account.responses.T.tolist() == literal.responses
    demand, average = literal.at_the_end()
    scale = 1e-9 * result.problem.capacity.min()
    np.testing.assert_allclose(result.demand_at_end, demand, rtol=1e-9, atol=scale)
    np.testing.assert_allclose(result.average_at_end, average, rtol=1e-9, atol=scale)


@given(
    problems(("polynomial", "coupled")),
    st.integers(0, 2**32),
    st.sampled_from(CHANNELS),
    st.sampled_from([*SAMPLED, *CROSSING]),
    st.sampled_from([0.5, 7.0, 30.0]),
    st.data(),
)
def test_continuous_agents_are_the_model_event_by_event(
    problem: Problem,
    seed: int,
    channel: dict[str, Any],
    control_unit: Sampled | Crossing,
    until: float,
    data: st.DataObject,
) -> None:
    sent_over = BroadcastChannel(**channel)
    planned = data.draw(interventions_in(problem), "interventions")
    literal = Literal(problem, sent_over, control_unit, seed, None, planned)
    literal.run(until)
    assume(literal.margin > 1e-9)  # no decision hangs on the last bits of a float
    parts = {"dynamics": "continuous", "control_unit": control_unit, "channel": sent_over}
    parts["processes"] = [set_demands(planned)]
    assert_same(literal, simulate(problem, until, seed, **parts))


@given(
    problems(("polynomial", "coupled")),
    st.integers(0, 2**32),
    st.sampled_from(CHANNELS),
    st.sampled_from(SAMPLED),
    st.sampled_from(RHYTHMS),
    st.sampled_from([0.5, 7.0, 30.0]),
    st.data(),
)
def test_discrete_agents_on_their_own_clocks_are_the_model_event_by_event(
    problem: Problem,
    seed: int,
    channel: dict[str, Any],
    control_unit: Sampled,
    rhythm: dict[str, Any],
    until: float,
    data: st.DataObject,
) -> None:
    sent_over = BroadcastChannel(**channel)
    planned = data.draw(interventions_in(problem), "interventions")
    ticks = tick_times(seed, until, problem.n_agents, **rhythm)
    literal = Literal(problem, sent_over, control_unit, seed, ticks, planned)
    literal.run(until)
    assume(literal.margin > 1e-9)
    parts = {"control_unit": control_unit, "channel": sent_over, "clocks": Clocks(**rhythm)}
    parts["processes"] = [set_demands(planned)]
    assert_same(literal, simulate(problem, until, seed, **parts))


@pytest.mark.parametrize("channel", CHANNELS, ids=str)
@pytest.mark.parametrize("control_unit", [SAMPLED[1], CROSSING[1]], ids=str)
def test_the_model_event_by_event_does_respond(
    channel: dict[str, Any], control_unit: Sampled | Crossing
) -> None:
    """Were there no signals and responses, the tests above would show little."""
    problem, sent_over = random_problem(2, 5, 2), BroadcastChannel(**channel)
    rhythms = [None] if isinstance(control_unit, Crossing) else [None, RHYTHMS[4]]
    for rhythm in rhythms:
        ticks = None if rhythm is None else tick_times(0, 30.0, 5, **rhythm)
        literal = Literal(problem, sent_over, control_unit, 0, ticks)
        literal.run(30.0)
        assert len(literal.signals) > 10
        assert min(sum(of_resource) for of_resource in zip(*literal.responses, strict=True)) > 3
        assert literal.margin > 1e-9


# -- one agent by hand -----------------------------------------------------------------------------------


class Script:
    """A channel that says when the copies of broadcast b of each resource arrive."""

    def __init__(self, *arrivals: list[float]) -> None:
        self.arrivals = arrivals

    def open(self, n_agents: int, keys: Any) -> "Script":
        return self

    def transmit(self, sent: Broadcast, departure: float) -> Copies:
        return Copies(np.array(self.arrivals[sent.number]))


def send_at(time: float, *resources: int) -> Any:
    """A process that has the control unit broadcast at an instant."""

    def process(system: System) -> ProcessGenerator:
        yield system.env.at(time, EventKind.SENSE)
        for j in resources:
            system.broadcast(j)

    return process


def two_resources(**changes: Any) -> Problem:
    """One agent and costs with which it responds to every signal: 2 Gamma c = 1."""
    shared = {"capacity": 1000.0, "increase": 1.0, "normalization": 0.5, **changes}
    pair = [resource(name, **shared) for name in ("memory", "disk")]
    return Problem(pair, PolynomialCosts([2], [[[1.0], [1.0]]]))


def test_the_first_signal_that_sets_the_latch_is_the_one_that_is_answered() -> None:
    # Broadcast 1 overtakes broadcast 0; both arrive between the ticks at 4 and 5.
    problem = quadratic_problem([1.0], capacity=1000.0, normalization=0.5)
    parts = {"channel": Script([4.75], [4.5]), "processes": [send_at(1.0, 0), send_at(2.0, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    assert story(result) == [
        "1 signal 0",
        "2 signal 1",
        "4.5 agent 0 deliver 1",
        "4.75 agent 0 deliver 0",
        "5 agent 0 respond 1",
    ]


def test_there_is_a_latch_for_each_resource() -> None:
    parts = {"channel": Script([4.5]), "processes": [send_at(1.0, 1), send_at(2.0, 0)]}
    result = simulate(two_resources(), 6.0, recording=Recording(events=True), **parts)
    answers = result.events[result.events["kind"] == "respond"]
    assert answers["time"].tolist() == [5.0, 5.0]
    assert answers["resource"].tolist() == ["memory", "disk"]  # in their order, not that of the signals
    assert answers["value"].tolist() == [2.5, 2.5]


def test_the_latch_is_cleared_by_the_tick() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, normalization=0.5)
    parts = {"channel": Script([4.5], [5.0], [5.5]), "processes": [send_at(1.0, 0, 0, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    # The copy that arrives at 5 comes before the tick at 5 and finds the latch set.
    assert [line for line in story(result) if "respond" in line] == [
        "5 agent 0 respond 0",
        "6 agent 0 respond 2",
    ]


def test_a_continuous_agent_answers_each_copy_in_the_instant_in_which_it_arrives() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    channel = BroadcastChannel(latency=0.25, duplication=1.0)
    parts = {"dynamics": "continuous", "channel": channel, "processes": [send_at(3.75, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    assert story(result) == [
        "3.75 signal 0",
        "4 agent 0 deliver 0",
        "4 agent 0 respond 0",
        "4 agent 0 deliver 0",
        "4 agent 0 respond 0",
    ]
    assert result.events["value"].tolist() == [3.75, 0.0, 2.0, 1.0, 1.0]  # 4 to 2 to 1; a duplicate is a 1
    assert result.demand_at_end.tolist() == [[1.0 + 4.0]]
    assert result.average_at_end.tolist() == [[(4 * 4 / 2 + 4 * 1 + 4 * 4 / 2) / 8]]


def test_a_discrete_agent_answers_a_copy_and_its_duplicate_once() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    channel = BroadcastChannel(latency=0.25, duplication=1.0)
    parts = {"channel": channel, "processes": [send_at(3.5, 0)]}
    result = simulate(problem, 8.0, recording=Recording(demand=1.0, events=True), **parts)
    assert [line for line in story(result) if "respond" in line] == ["4 agent 0 respond 0"]
    assert result.observations.total_demand[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 2.0, 3.0, 4.0, 5.0]
    assert result.average_at_end.tolist() == [[(0 + 1 + 2 + 3 + 4 + 2 + 3 + 4 + 5) / 9]]


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_who_holds_nothing_has_nothing_to_give_back(dynamics: str) -> None:
    # At 0 the average is 0 and lambda is 0; a discrete agent that answers holds instead of adding.
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    parts = {"dynamics": dynamics, "processes": [send_at(0.0, 0)]}
    result = simulate(problem, 3.0, recording=Recording(events=True), **parts)
    assert story(result) == ["0 signal 0", "0 agent 0 deliver 0", "0 agent 0 hold 0"]
    assert result.demand_at_end.tolist() == [[2.0 if dynamics == "discrete" else 3.0]]


def test_averages_are_taken_before_any_answer() -> None:
    # f = (x + y)**2 / 2 reads both averages.  A tick at which both latches are set folds both demands in
    # before either is cut, so both probabilities are Gamma (x + y) / x = 2 Gamma.
    own = PolynomialCosts([2], [[[0.0], [0.0]]])
    costs = CoupledCosts(own, weights=[[1.0, 1.0]], sum_coefficients=[[0.5]])
    asked: list[tuple[list[float], int]] = []

    class Asked(AgentProcess):
        def __init__(self, agent: int, system: System) -> None:
            super().__init__(agent, system)
            derivative = self.marginal_cost

            def remember(averages: list[float], j: int) -> float:
                asked.append((list(averages), j))
                return float(derivative(averages, j))

            self.marginal_cost = remember

    pair = [resource(name, capacity=1000.0, increase=1.0, normalization=0.5) for name in ("memory", "disk")]
    simulate(Problem(pair, costs), 6.0, agents=Asked, processes=[send_at(4.0, 0, 1)])
    assert asked == [([2.0, 2.0], 0), ([2.0, 2.0], 1)]


@pytest.mark.parametrize(
    ("options", "times"),
    [
        ({"period": 1.0}, [4.0, 4.0, 4.0]),
        ({"period": 1.0, "phase": [0.0, 0.25, 0.5]}, [4.0, 3.25, 3.5]),
        ({"period": [1.0, 0.75, 3.0]}, [4.0, 3.75, 6.0]),
        ({"period": 1.0, "drift": [0.0, 0.25, -0.5]}, [4.0, 3.75, 3.5]),
    ],
)
def test_each_agent_answers_at_the_next_tick_of_its_own_clock(
    options: dict[str, Any], times: list[float]
) -> None:
    problem = quadratic_problem([1.0] * 3, capacity=1000.0, normalization=0.5)
    parts = {"clocks": Clocks(**options), "processes": [send_at(3.125, 0)]}
    result = simulate(problem, 8.0, recording=Recording(events=True), **parts)
    answers = result.events[result.events["kind"] == "respond"].sort_values("agent")
    assert answers["time"].tolist() == times


# -- the state of one agent, read and set ----------------------------------------------------------------


@pytest.mark.parametrize(
    "parts", [{"dynamics": "continuous"}, {}, {"clocks": Clocks(0.7, "random", 0.01, 0.2)}]
)
def test_one_agent_is_read_as_all_are(parts: dict[str, Any]) -> None:
    problem, seen = random_problem(4, 5, 2, "coupled"), []

    def read(system: System) -> ProcessGenerator:
        for q in range(60):
            yield system.env.at(0.37 * q, EventKind.OBSERVE)
            demand, average = system.allocations()
            agents = range(5)
            each = [
                [[read_one(i, j) for i in agents] for j in range(2)]
                for read_one in (system.demand, system.average)
            ]
            seen.append((demand.tolist(), average.tolist()) == tuple(each))
            seen.append(system.totals().tolist() == [sum(row) for row in demand.tolist()])
            seen.append(system.totals().tolist() == [system.total(j) for j in range(2)])

    result = simulate(problem, 25.0, channel=BroadcastChannel(0.3, 0.2), processes=[read], **parts)
    assert result.account.responses.sum() > 10
    assert seen == [True] * 180


@pytest.mark.parametrize("time", [3.5, 4.0])
def test_a_discrete_demand_that_is_set_grows_on_from_the_next_tick(time: float) -> None:
    # At 4 as between 3 and 4, what is set is the demand that the tick at 4 finds.
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)

    def intervene(system: System) -> ProcessGenerator:
        yield system.env.at(time, EventKind.INTERVENE)
        system.set_demand(0, 0, 10.0)

    result = simulate(problem, 7.0, processes=[intervene], recording=Recording(demand=1.0, events=True))
    held = [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0]
    assert result.observations.total_demand[:, 0].tolist() == held
    averages = [sum(held[: k + 1]) / (k + 1) for k in range(8)]
    np.testing.assert_allclose(result.observations.total_average[:, 0], averages, rtol=1e-15)
    assert result.events["value"].tolist() == [6.0]
    assert story(result) == [f"{exactly(time)} agent 0 change -1"]


def test_a_continuous_demand_that_is_set_grows_on_at_once() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)

    def intervene(system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.INTERVENE)
        system.set_demand(0, 0, 0.0)
        yield system.env.at(4.0, EventKind.INTERVENE)
        system.set_demand(0, 0, 8.0)

    result = simulate(
        problem, 8.0, dynamics="continuous", processes=[intervene], recording=Recording(events=True)
    )
    assert result.events["value"].tolist() == [-3.0, 7.0]
    assert result.demand_at_end.tolist() == [[12.0]]
    assert result.average_at_end.tolist() == [[(3 * 3 / 2 + 1 / 2 + 8 * 4 + 4 * 4 / 2) / 8]]
