"""Random configurations of a run: a strategy for each kind of part, and one that composes them.

A new kind of latency, average, response, ... is one more line in the strategy of its kind; a new argument of
`Simulation` is a strategy and a line in `PARTS`; a new family of costs is a branch in `conftest.random_costs`
and a name in `conftest.TERMS`, `conftest.COMPILED` or `conftest.FAMILIES`.  What a strategy here gives is run
by processes, by a fleet and, as far as `setting_of` in test_reference_asynchronous.py can write it in plain
numbers, by the reference simulator.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import networkx as nx
import numba
import numpy as np
from hypothesis import strategies as st

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    averaging,
    compensation,
    latency,
    loss,
    responses,
    topology,
)
from aimd_des.control_units import EarlyDetection
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import (
    Absence,
    CapacityProfile,
    CapacityRamp,
    CapacityStep,
    ChangeChannel,
    ChangeThreshold,
    Crash,
    Failover,
    Intervention,
    Join,
    Partition,
    Prices,
    UnusualActivity,
)
from aimd_des.lowlevel import (
    Draws,
    Purpose,
    SampledTable,
    SampledUnit,
    exp,
    exps,
    log,
    logs,
    lost_table,
    quantile_table,
)
from aimd_des.problem.costs import Costs, weighted_costs
from aimd_des.utils.validation import FloatArray
from tests.conftest import COMPILED, problems, quietly

Strategy = st.SearchStrategy[Any]

SEEDS = st.integers(0, 2**32)

# Round numbers fall together with ticks, looks and each other.
times = st.sampled_from([0.0, 0.25, 0.5, 1.0, 1.5]) | st.floats(0.0, 3.0)
lengths = st.sampled_from([0.5, 1.0, 3.0]) | st.floats(0.1, 9.0)
positive = st.floats(0.05, 3.0)
probabilities = st.sampled_from([0.0, 0.3]) | st.floats(0.0, 0.9)


def one_kind(*kinds: Strategy) -> Strategy:
    """One of several kinds, each as likely as the others: `one_of` counts the alternatives within each."""
    return st.integers(0, len(kinds) - 1).flatmap(kinds.__getitem__)


def of_each(values: Strategy, n: int, low: float, high: float) -> Strategy:
    """One number for all agents, or for each its own between two bounds."""
    # From a seed: a list of numbers for 200 agents is more than Hypothesis can draw.
    own = SEEDS.map(lambda seed: np.random.default_rng(seed).uniform(low, high, n).tolist())
    return one_kind(values, values, own)


# -- the channel -----------------------------------------------------------------------------------------


def plain_latencies(n: int) -> Strategy:
    """Latencies that the reference simulator knows."""
    return one_kind(
        of_each(times, n, 0.0, 2.0),
        st.builds(lambda low, more: latency.Uniform(low, low + more), times, times),
        st.builds(latency.Uniform, of_each(st.just(0.5), n, 0.0, 1.0), of_each(st.just(2.0), n, 1.0, 3.0)),
        st.builds(latency.Exponential, of_each(times, n, 0.1, 2.0)),
    )


@numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
def stretched(u: float, scale: float, power: float) -> float:
    """A Weibull number."""
    return scale * exp(power * log(0.0 - log(1.0 - u)))


@dataclass(frozen=True)
class Stretched:
    """A latency of the user's own, in compiled code."""

    scale: float
    power: float

    def check(self, n_agents: int) -> None: ...

    def draw(self, draws: Draws) -> FloatArray:
        u = draws.uniforms(Purpose.LATENCY)
        return np.asarray(self.scale * exps(self.power * logs(0.0 - logs(1.0 - u))))

    def table(self, n_agents: int) -> Any:
        return quantile_table(stretched, n_agents, self.scale, self.power)


@numba.njit  # type: ignore[untyped-decorator]
def again(u: float, time: float, chance: float, memory: FloatArray) -> bool:
    """Lost with a probability that is twice as high, at most, after a loss."""
    memory[0] = 1.0 if u < chance * (1.0 + memory[0]) else 0.0
    return bool(memory[0] > 0.0)


@dataclass(frozen=True)
class Again:
    """A loss of the user's own, with memory, in compiled code."""

    chance: float

    def start(self, n_agents: int) -> "AgainOfRun":
        return AgainOfRun(self.chance, np.zeros(n_agents))

    def table(self, n_agents: int) -> Any:
        return lost_table(again, n_agents, self.chance, memory=1)


@dataclass(frozen=True, eq=False)
class AgainOfRun:
    """Its losses in one run."""

    chance: float
    bad: FloatArray

    def draw(self, draws: Draws) -> Any:
        self.bad[:] = draws.uniforms(Purpose.LOSS) < self.chance * (1.0 + self.bad)
        return self.bad > 0.0


def latencies(n: int) -> Strategy:
    """Latencies of all kinds."""
    return one_kind(
        plain_latencies(n),
        st.builds(latency.ShiftedGamma, positive, positive, times),
        st.builds(latency.LogNormal, positive, times),
        st.builds(latency.Pareto, st.floats(0.3, 4.0), positive),
        st.builds(latency.Empirical, st.lists(times, min_size=1, max_size=5)),
        st.builds(Stretched, times, positive),
    )


def plain_losses(n: int) -> Strategy:
    """Losses that the reference simulator knows."""
    return one_kind(
        of_each(probabilities | st.just(1.0), n, 0.0, 0.7),
        st.builds(loss.GilbertElliott, of_each(probabilities, n, 0.1, 0.6), of_each(positive, n, 0.3, 4.0)),
    )


def losses(n: int) -> Strategy:
    """Losses of all kinds, and two at once."""
    rows = st.lists(st.booleans(), min_size=1, max_size=7)
    single = one_kind(
        plain_losses(n),
        st.builds(loss.CommonMode, probabilities),
        st.builds(lambda rows: loss.Trace(rows, repeat=True), rows),
        st.builds(Again, probabilities),
    )
    return one_kind(single, single, st.builds(loss.Combined, single, single))


def channels(
    n: int, latency: Strategy | None = None, loss: Strategy | None = None
) -> st.SearchStrategy[BroadcastChannel]:
    """Broadcast channels, with latencies and losses of all kinds unless others are given."""
    return st.builds(
        BroadcastChannel,
        latency=latencies(n) if latency is None else latency,
        loss=losses(n) if loss is None else loss,
        duplication=of_each(st.sampled_from([0.0, 0.0, 0.4]), n, 0.1, 0.9),
        fifo=st.booleans(),
    )


def plain_channels(n: int) -> st.SearchStrategy[BroadcastChannel]:
    """Channels that the reference simulator knows."""
    return channels(n, plain_latencies(n), plain_losses(n))


@st.composite
def networks(draw: st.DrawFn, n: int) -> Any:
    """A random connected network, as a tree or flooded, with steady or random latencies and losses."""
    graph = nx.gnm_random_graph(n + 1, n, seed=draw(st.integers(0, 1000)))
    nx.add_path(graph, range(n + 1))
    for number, edge in enumerate(graph.edges):
        graph.edges[edge].update(latency=0.25 * (number % 4), loss=0.1 * (number % 3))
    spread = draw(st.sampled_from([topology.tree, topology.flood]))
    delay = draw(st.sampled_from([latency.Constant, latency.Exponential]))
    lost = draw(st.sampled_from([loss.Bernoulli, lambda p: loss.GilbertElliott(p, 2.0)]))
    return spread(graph, root=0, latency=delay, loss=lost)


# -- control unit and agents -----------------------------------------------------------------------------


@numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
def rising(total: float, threshold: float, time: float, look: int, resource: int) -> float:
    """A probability that depends on all that it is given."""
    above = min(max(total / threshold - 0.7, 0.0) / 0.4, 1.0)
    return 0.0 if look % 7 == 3 or time < 1.0 else above ** (2 + resource)


@dataclass(frozen=True)
class OwnLooks(SampledUnit):
    """A control unit of the user's own, with a compiled function in its table."""

    period: float
    phase: float
    sensing_delay: float

    def table(self) -> SampledTable:
        """Say when it looks, and with which probability it signals."""
        return SampledTable(self.period, self.phase, self.sensing_delay, probability=rising)


def samplers() -> Strategy:
    """Control units that look on a clock."""
    looks: dict[str, Strategy] = {
        "period": st.sampled_from([1.0, 0.5, 0.7, 2.3]) | st.floats(0.3, 1.5),
        "phase": st.sampled_from([0.0, 0.25, 0.5]),
        "sensing_delay": st.sampled_from([0.0, 0.0, 0.5]) | st.floats(0.1, 1.5),
    }
    shares = {"low": st.sampled_from([0.5, 0.9]), "high": st.sampled_from([0.95, 1.1])}
    plain = st.builds(Sampled, **looks)
    return one_kind(plain, plain, st.builds(EarlyDetection, **looks, **shares), st.builds(OwnLooks, **looks))


def control_units(dynamics: str) -> Strategy:
    """Control units of all kinds that go with the dynamics."""
    crossers = st.builds(
        Crossing,
        hold_off=st.sampled_from([1.0, 0.5]) | st.floats(0.1, 3.0),
        sensing_delay=st.sampled_from([0.0, 0.5]) | st.floats(0.1, 1.5),
        longest_hold_off=st.sampled_from([None, None, 3.0, 8.0]),
    )
    return samplers() if dynamics == "discrete" else one_kind(samplers(), crossers)


def clocks(n: int) -> st.SearchStrategy[Clocks]:
    """Clocks in phase, or as different as may be; jitter stays below the shortest period."""
    return st.builds(
        Clocks,
        period=of_each(st.sampled_from([1.0, 0.5, 0.7, 1.3]), n, 0.45, 1.5),
        phase=one_kind(st.just("random"), of_each(st.sampled_from([0.0, 0.25, 3.0]), n, 0.0, 2.0)),
        drift=of_each(st.sampled_from([0.0, 0.01, -0.1]), n, -0.1, 0.1),
        jitter=of_each(st.sampled_from([0.0, 0.0, 0.3]), n, 0.0, 0.4),
    )


def averagings() -> Strategy:
    """Averages of all kinds."""
    windows = [averaging.Window(*window) for window in ((4.0, 4), (10.0, 2), (6.0, 3), (12.0, 4))]
    return one_kind(
        st.sampled_from([None, averaging.Cumulative()]),
        st.sampled_from(windows),
        st.builds(averaging.Forgetting, st.sampled_from([5.0, 8.0]) | st.floats(2.0, 10.0)),
        st.builds(averaging.Polynomial, st.sampled_from([1.0, 1.5, 2.0]) | st.floats(1.0, 20.0)),
    )


@numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
def damped(normalization: float, slope: float, average: float, demand: float) -> float:
    """The paper's probability where demand is large, and less elsewhere."""
    return normalization * slope / average * min(1.0, demand / average)


@numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
def remembering(
    slope: float,
    normalization: float,
    resource: float,
    agent: float,
    age: float,
    increase: float,
    decrease: float,
    memory: FloatArray,
) -> float:
    """A probability that depends on the answers before, and on what `damped` does not read."""
    memory[0] += 1.0
    memory[1] = 0.5 * memory[1] + 0.5 * normalization * slope / (age * increase)
    return (2.0 - decrease) * memory[1] / (memory[0] + agent + resource)


def answers() -> Strategy:
    """Responses of all kinds, and the default."""
    derandomised = st.builds(
        responses.Derandomised, st.sampled_from(["average", "events"]), full=st.booleans()
    )
    cuts = ("drawn", "fractional", "full")
    own = [responses.CustomResponse(damped, cut) for cut in cuts]  # type: ignore[arg-type]
    own += [responses.CustomResponse(remembering, cut, memory=2) for cut in cuts]  # type: ignore[arg-type]
    return one_kind(st.none(), st.just(responses.EventNormalised()), derandomised, st.sampled_from(own))


def compensations(n: int) -> Strategy:
    """Compensations of all kinds, and none."""
    return one_kind(
        st.none(),
        st.builds(compensation.KnownLoss, of_each(st.just(0.3), n, 0.0, 0.6)),
        st.sampled_from([compensation.EstimatedLoss(), compensation.EstimatedLoss(3)]),
    )


# -- what changes from outside ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Redrawn:
    """The k-th costs: those of each agent times 1, 2 or 3."""

    costs: Costs

    def __call__(self, k: int) -> Costs:
        return weighted_costs(self.costs, [1.0 + (k + i) % 3 for i in range(self.costs.n_agents)])


def moments(until: float) -> st.SearchStrategy[float]:
    """Instants of a run at which interventions begin."""
    early = min(until, 12.0)
    round_ones = [time for time in (0.0, 1.0, 2.5, 4.0, 6.0, 11.0) if time < until]
    return st.sampled_from(round_ones) | st.floats(0.0, early, exclude_max=True)


@st.composite
def conditions(draw: st.DrawFn, problem: Problem, until: float) -> Intervention:
    """A change of capacity, costs, channel or control unit."""
    j, agent = draw(st.integers(0, problem.n_resources - 1)), draw(st.integers(0, problem.n_agents - 1))
    at, long, steps = draw(moments(until)), draw(lengths), draw(st.integers(1, 5))
    capacity = float(draw(st.sampled_from([0.3, 0.6, 1.5]) | st.floats(0.4, 1.5)) * problem.capacity[j])
    # A period is longer than the table: `times` are 3 at most.
    table, period = [0.0, 1.0 + draw(times)], draw(st.sampled_from([None, 4.5, 7.3]))
    members = draw(st.sampled_from([None, [0], [agent], list(range(0, problem.n_agents, 2))]))
    kinds = [
        lambda: CapacityStep(j, at, capacity),
        lambda: CapacityRamp(j, at, at + long, capacity, steps),
        lambda: CapacityProfile(j, table, [capacity, float(problem.capacity[j])], period),
        lambda: UnusualActivity(agent, at, at + long if period else None, 0.2 if steps < 3 else 3.0),
        lambda: Prices(1.5 + long, Redrawn(problem.costs)),
        lambda: Failover(at, long),
        lambda: Partition(at, long, members),
        lambda: ChangeThreshold(at, 0.7 if period else 1.0, j if steps < 3 else None),
        lambda: ChangeChannel(
            at, BroadcastChannel(latency.Exponential(long), 0.3, 0.2 if period else 0.0, steps < 3)
        ),
    ]
    return draw(st.sampled_from(kinds))()


@st.composite
def absences(draw: st.DrawFn, agent: int, until: float) -> Intervention:
    """What takes an agent away, for at least a part of the run."""
    at, long = draw(moments(until)), draw(lengths)
    kinds = [Absence(agent, at), Absence(agent, at, at + long), Crash(agent, at, at + long)]
    return draw(st.sampled_from([*kinds, Join(agent, at)] if at > 0.0 else kinds))


@st.composite
def interventions(draw: st.DrawFn, problem: Problem, until: float) -> list[Intervention]:
    """Some interventions at once, in any order; an agent has one absence at most."""
    away = draw(st.lists(st.integers(0, problem.n_agents - 1), max_size=2, unique=True))
    found = [draw(absences(agent, until)) for agent in away]
    found += draw(st.lists(conditions(problem, until), max_size=4))
    # A run refuses what would begin after its end.
    return draw(st.permutations([one for one in found if getattr(one, "begins", 0.0) < until]))


@dataclass(frozen=True)
class SetDemands:
    """A process that sets demands from outside: (time, agent, resource, demand), in the order of time."""

    changes: tuple[tuple[float, int, int, float], ...]

    def __call__(self, system: System) -> ProcessGenerator:
        """Set what is due, if the agent is here."""
        for time, agent, j, demand in self.changes:
            yield system.env.at(time, EventKind.INTERVENE)
            if not system.conditions.away[agent]:
                system.set_demand(agent, j, demand)


@st.composite
def set_demands(draw: st.DrawFn, problem: Problem, until: float) -> list[SetDemands]:
    """Up to five demands, set at quarters of a unit of time to up to twice the share of an agent."""
    quarters = st.integers(0, min(int(4 * until) - 1, 80)).map(lambda quarter: 0.25 * quarter)
    agents, resources = st.integers(0, problem.n_agents - 1), st.integers(0, problem.n_resources - 1)
    shares = st.floats(0.0, 2.0)
    share = problem.capacity / problem.n_agents
    planned = draw(st.lists(st.tuples(quarters, agents, resources, shares), min_size=1, max_size=5))
    return [SetDemands(tuple((at, i, j, float(by * share[j])) for at, i, j, by in sorted(planned)))]


# -- whole runs ------------------------------------------------------------------------------------------


def recordings(until: float) -> st.SearchStrategy[Recording]:
    """What is looked at, and when."""
    return st.builds(
        Recording,
        demand=st.sampled_from(["auto", "end", 0.5, [time for time in (0.0, 2.5, 5.0) if time < until]]),
        allocations=st.sampled_from(["end", min(until, 3.0)]),
        tail=st.sampled_from([0, 3]),
        overshoot=st.booleans(),
        events=st.booleans(),
    )


def both(problem: Problem, until: float, **parts: Any) -> tuple[Result, Result]:
    """Run with a process for each agent, and with a fleet."""
    processes = quietly(Simulation(problem, agents=AgentProcess, **parts).run, until)
    return processes, quietly(Simulation(problem, agents=Fleet, **parts).run, until)


@dataclass(frozen=True)
class Configuration:
    """One run: a problem, and arguments of `Simulation`."""

    problem: Problem
    seed: int
    until: float
    parts: dict[str, Any]

    def run(self, **changes: Any) -> Result:
        """Run it, by processes and with the drawn parts unless others are given."""
        parts = {"seed": self.seed, **self.parts, **changes}
        return quietly(Simulation(self.problem, **parts).run, self.until)

    def both(self, **changes: Any) -> tuple[Result, Result]:
        """Run it with a process for each agent, and with a fleet."""
        return both(self.problem, self.until, seed=self.seed, **{**self.parts, **changes})


#: Makes the strategy of a part from the problem, the dynamics and the end of the run.
PartOf = Callable[[Problem, str, float], Strategy]

PARTS: dict[str, PartOf] = {
    "channel": lambda problem, dynamics, until: one_kind(
        channels(problem.n_agents), networks(problem.n_agents)
    ),
    "control_unit": lambda problem, dynamics, until: control_units(dynamics),
    "clocks": lambda problem, dynamics, until: (
        one_kind(st.none(), clocks(problem.n_agents)) if dynamics == "discrete" else st.none()
    ),
    "averaging": lambda problem, dynamics, until: averagings(),
    "response": lambda problem, dynamics, until: answers(),
    "compensation": lambda problem, dynamics, until: compensations(problem.n_agents),
    "interventions": lambda problem, dynamics, until: one_kind(st.just([]), interventions(problem, until)),
    "processes": lambda problem, dynamics, until: one_kind(st.just([]), set_demands(problem, until)),
    "recording": lambda problem, dynamics, until: recordings(until),
}


@st.composite
def configurations(
    draw: st.DrawFn,
    *,
    problem: st.SearchStrategy[Problem] | None = None,
    dynamics: tuple[str, ...] = ("discrete", "continuous"),
    until: st.SearchStrategy[float] | None = None,
    **parts: PartOf,
) -> Configuration:
    """Any run, or one in which parts are drawn in another way than `PARTS` has it."""
    system = draw(problems(COMPILED) if problem is None else problem)
    way = draw(st.sampled_from(dynamics))
    end = draw(st.just(20.0) if until is None else until)
    drawn = {name: draw(part(system, way, end)) for name, part in {**PARTS, **parts}.items()}
    return Configuration(system, draw(SEEDS), end, {"dynamics": way, **drawn})


# -- the same run in two ways ----------------------------------------------------------------------------


def digests(configuration: Configuration, **changes: Any) -> tuple[str, str]:
    """The digests of processes and of a fleet, which must be equal."""
    processes, fleet = configuration.both(**changes)
    return processes.digest, fleet.digest


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
