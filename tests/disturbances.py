"""What may happen to a run, for any number of agents: strategies that several test files share."""

from collections.abc import Callable
from typing import Any

import networkx as nx
from hypothesis import strategies as st

from aimd_des import Problem, latency, loss, topology
from aimd_des.interventions import (
    Absence,
    CapacityProfile,
    CapacityRamp,
    CapacityStep,
    Crash,
    Failover,
    Intervention,
    Join,
    Partition,
    Prices,
    UnusualActivity,
)
from aimd_des.problem.costs import Costs, weighted_costs

Made = Callable[[Problem], Any]

# Round ones fall together with ticks, looks and each other.
times = st.sampled_from([1.0, 2.5, 4.0, 6.0]) | st.floats(0.1, 9.0)
lengths = st.sampled_from([0.5, 1.0, 3.0]) | st.floats(0.1, 9.0)


def _capacity(problem: Problem, factor: float) -> float:
    return float(factor * problem.capacity[0])


def _redrawn(problem: Problem) -> Callable[[int], Costs]:
    """The k-th costs: those of each agent times 1, 2 or 3."""
    return lambda k: weighted_costs(problem.costs, [1.0 + (k + i) % 3 for i in range(problem.n_agents)])


def _conditions() -> st.SearchStrategy[Made]:
    """A change of capacity, costs, channel or control unit."""
    factors = st.sampled_from([0.3, 0.6, 1.5])
    return st.one_of(
        st.builds(lambda at, by: lambda problem: CapacityStep(0, at, _capacity(problem, by)), times, factors),
        st.builds(
            lambda at, long, by: (
                lambda problem: CapacityRamp(0, at, at + long, _capacity(problem, by), steps=3)
            ),
            times,
            lengths,
            factors,
        ),
        st.builds(
            lambda by: (
                lambda problem: CapacityProfile(
                    0, [0.0, 2.0], [_capacity(problem, by), _capacity(problem, 1.0)], period=4.0
                )
            ),
            factors,
        ),
        st.builds(lambda at, long: lambda problem: Failover(at, long), times, lengths),
        st.builds(lambda at, long: lambda problem: Partition(at, long), times, lengths),
        st.builds(lambda at, long: lambda problem: Partition(at, long, [0]), times, lengths),
        st.builds(
            lambda at, long, weight: lambda problem: UnusualActivity(0, at, at + long, weight),
            times,
            lengths,
            st.sampled_from([0.2, 3.0]),
        ),
        st.builds(lambda every: lambda problem: Prices(every, _redrawn(problem)), st.floats(2.0, 8.0)),
    )


def _absences() -> st.SearchStrategy[Callable[[int], Intervention]]:
    """What takes an agent away, for at least a part of the run."""
    return st.one_of(
        st.builds(lambda at: lambda agent: Join(agent, at), times),
        st.builds(lambda at: lambda agent: Absence(agent, at), times),
        st.builds(lambda at, long: lambda agent: Absence(agent, at, at + long), times, lengths),
        st.builds(lambda at, long: lambda agent: Crash(agent, at, at + long), times, lengths),
    )


@st.composite
def disturbances(draw: st.DrawFn) -> Made:
    """Some interventions at once; an agent has one absence at most."""
    conditions = draw(st.lists(_conditions(), max_size=3))
    absences = draw(st.lists(_absences(), max_size=2))

    def make(problem: Problem) -> list[Intervention]:
        away = [absence(agent) for agent, absence in enumerate(absences[: problem.n_agents])]
        return [*away, *(condition(problem) for condition in conditions)]

    return make


@st.composite
def networks(draw: st.DrawFn) -> Made:
    """A random connected network, as a tree or flooded, with steady or random latencies and losses."""
    seed, flooded = draw(st.integers(0, 1000)), draw(st.booleans())
    delay = draw(st.sampled_from([latency.Constant, latency.Exponential]))
    lost = draw(st.sampled_from([loss.Bernoulli, lambda p: loss.GilbertElliott(p, 2.0)]))

    def make(problem: Problem) -> Any:
        graph = nx.gnm_random_graph(problem.n_agents + 1, problem.n_agents, seed=seed)
        nx.add_path(graph, range(problem.n_agents + 1))
        for number, edge in enumerate(graph.edges):
            graph.edges[edge].update(latency=0.25 * (number % 4), loss=0.1 * (number % 3))
        spread = topology.flood if flooded else topology.tree
        return spread(graph, root=0, latency=delay, loss=lost)

    return make
