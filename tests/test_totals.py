"""Sums over agents, and the order of answers: fast ways give what plain ones give, to the last bit."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import averaging
from aimd_des.dynamics.state import agent_parameters, start
from aimd_des.dynamics.totals import average_of, observe_totals, piece
from aimd_des.fleet.arrays import Answers
from aimd_des.fleet.observer_kernels import _sort
from tests.conftest import random_problem


@pytest.mark.parametrize("rule", [averaging.Cumulative(), averaging.Forgetting(3.0)])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (5, 2), (600, 3), (256, 4), (257, 7)])
def test_totals_are_sums_in_the_order_of_agents(n: int, m: int, rule: Any) -> None:
    problem, rng = random_problem(n, n, m, per_agent=True), np.random.default_rng(m)
    parameters = agent_parameters(problem, 0.0, rule)
    state = start(m, n, 0.0, parameters)
    for rows in (state.demand, state.accumulated, state.anchor, state.origin):
        rows[:] = rng.uniform(0.0, 4.0, (m, n))
    # Some are away: since before now, or since before they were ever here.
    state.pause[:, ::3] = rng.uniform(0.0, 5.0, state.pause[:, ::3].shape)
    demand, average = np.full((2, m), np.nan)
    observe_totals(state, parameters, np.array([5.0]), 0.0, piece(m), demand, average)
    for j in range(m):
        held = used = 0.0
        for i in range(n):
            held += float(state.demand[j, i] + parameters.increase[j, i] * (5.0 - state.anchor[j, i]))
            used += float(average_of(state, parameters, j, i, 5.0, 0.0))
        assert (demand[j], average[j]) == (held, used)


def answers_at(times: Any, ranks: Any, room: int = 0) -> Answers:
    count = len(times)
    # With room behind them, as in runs.
    keys, rank, agent, resource, interval = np.zeros((5, count + room), dtype=np.int64)
    keys[:count], rank[:count] = np.array(times, dtype=np.float64).view(np.int64), ranks
    return Answers(keys, rank, agent, resource, np.zeros(count + room), np.array([count]), interval)


times = st.one_of(
    st.lists(st.floats(0.0, 9.0), max_size=300),
    st.lists(st.sampled_from([0.0, 1.0, 1.0 + 2.0**-52, 2.0]), max_size=300),
    # Nearly all in one of many intervals: more moves than are allowed.
    st.lists(st.floats(0.0, 1e-9) | st.just(1e9), min_size=65, max_size=300),
)


@given(times, st.randoms(use_true_random=False), st.sampled_from([0, 32]))
def test_answers_are_sorted_by_time_and_order_number(times: list[float], random: Any, room: int) -> None:
    ranks = list(range(len(times)))
    random.shuffle(ranks)
    answers, count = answers_at(times, ranks, room), len(times)
    order, spare = np.zeros((2, len(times)), dtype=np.int64)
    _sort(answers, order, spare)
    assert np.array_equal(order, np.lexsort((answers.rank[:count], answers.key[:count])))


@pytest.mark.parametrize("count", [65, 1000, 5000])
def test_clustered_times_are_sorted_too(count: int) -> None:
    rng = np.random.default_rng(count)
    clustered = 3.0 + rng.integers(0, 2, count) + 1e-12 * rng.random(count)
    for found in (clustered, rng.exponential(0.5, count), np.full(count, 2.5), 1.0 + rng.pareto(0.3, count)):
        answers = answers_at(found, rng.permutation(count))
        order, spare = np.zeros((2, count), dtype=np.int64)
        _sort(answers, order, spare)
        assert np.array_equal(order, np.lexsort((answers.rank, answers.key)))
