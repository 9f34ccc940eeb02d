"""The measures beside their formulas, written out with loops."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import PolynomialCosts, solve_optimum
from aimd_des.results import metrics
from aimd_des.utils.validation import FloatArray
from tests.conftest import random_problem

SIZES = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 3))


def averages(seed: int, n: int, m: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.0, 5.0, (n, m)), rng.uniform(0.1, 5.0, (n, m)), rng.uniform(1.0, 30.0, m)


@given(SIZES)
def test_relative_error_and_utilisation_are_the_papers(sizes: tuple[int, int, int]) -> None:
    average, optimum, capacity = averages(*sizes)
    n, m = average.shape
    error, use = metrics.relative_error(average, optimum), metrics.utilisation(average, capacity)
    assert error.shape == use.shape == (m,)
    for j in range(m):
        off = math.fsum(abs(average[i, j] - optimum[i, j]) for i in range(n))
        assert error[j] == pytest.approx(off / math.fsum(optimum[:, j]), rel=1e-13)
        assert use[j] == pytest.approx(math.fsum(average[:, j]) / capacity[j], rel=1e-13)


@given(SIZES, st.integers(1, 4))
def test_a_leading_axis_is_time(sizes: tuple[int, int, int], looks: int) -> None:
    average, optimum, capacity = averages(*sizes)
    history = np.array([average * (1 + look) for look in range(looks)])
    errors, uses = metrics.relative_error(history, optimum), metrics.utilisation(history, capacity)
    assert errors.shape == uses.shape == (looks, len(capacity))
    for look in range(looks):
        np.testing.assert_allclose(errors[look], metrics.relative_error(history[look], optimum), rtol=1e-13)
        np.testing.assert_allclose(uses[look], metrics.utilisation(history[look], capacity), rtol=1e-13)


@given(SIZES)
def test_the_consensus_spread_is_standard_deviation_over_mean(sizes: tuple[int, int, int]) -> None:
    problem = random_problem(*sizes)
    average, _, _ = averages(*sizes)
    spread, gradient = metrics.consensus_spread(problem.costs, average), problem.costs.gradient(average)
    for j in range(problem.n_resources):
        mean = math.fsum(gradient[:, j]) / len(gradient)
        variance = math.fsum((slope - mean) ** 2 for slope in gradient[:, j]) / len(gradient)
        assert spread[j] == pytest.approx(math.sqrt(variance) / mean, rel=1e-9, abs=1e-12)


def test_the_consensus_spread_is_zero_where_nobody_holds_anything() -> None:
    costs = PolynomialCosts([2], [[[1.0]], [[2.0]]])
    assert metrics.consensus_spread(costs, np.zeros((2, 1))).tolist() == [0.0]


@given(SIZES)
def test_the_cost_ratio_is_that_of_all_costs_together(sizes: tuple[int, int, int]) -> None:
    costs = random_problem(*sizes).costs
    average, optimum, _ = averages(*sizes)
    one, other = (math.fsum(costs.value(x)) for x in (average, optimum))
    assert metrics.cost_ratio(costs, average, optimum) == pytest.approx(one / other, rel=1e-12)


@pytest.mark.parametrize("family", ["polynomial", "coupled"])
def test_at_the_optimum_there_is_consensus_and_no_error(family: str) -> None:
    problem = random_problem(7, 6, 2, family)
    best = solve_optimum(problem).allocation
    assert metrics.relative_error(best, best).tolist() == [0.0, 0.0]
    assert metrics.cost_ratio(problem.costs, best, best) == 1.0
    np.testing.assert_allclose(metrics.utilisation(best, problem.capacity), 1.0, rtol=1e-9)
    if family == "polynomial":  # no linear term: everybody holds something
        np.testing.assert_allclose(metrics.consensus_spread(problem.costs, best), 0.0, atol=1e-8)
        moved = best * np.linspace(0.8, 1.2, 6)[:, None]
        assert (metrics.consensus_spread(problem.costs, moved) > 0.05).all()


@given(
    st.lists(
        st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 10.0), st.floats(1e-3, 5.0)), min_size=1, max_size=20
    )
)
def test_overshoot_is_folded_in_interval_by_interval(pieces: list[tuple[float, float, float]]) -> None:
    capacity = np.array([3.0, 7.5])
    peak, above, excess, used = np.zeros((4, 2))
    for first, second, duration in pieces:
        metrics.fold_overshoot(np.array([first, second]), capacity, duration, peak, above, excess, used)
    for j in range(2):
        totals = [(piece[j], piece[2]) for piece in pieces]
        over = [(total - capacity[j], duration) for total, duration in totals if total > capacity[j]]
        assert peak[j] == max(total for total, _ in totals)
        assert used[j] == pytest.approx(math.fsum(total * duration for total, duration in totals), rel=1e-12)
        assert above[j] == pytest.approx(math.fsum(duration for _, duration in over), rel=1e-12)
        assert excess[j] == pytest.approx(math.fsum(size * duration for size, duration in over), rel=1e-12)


def test_demand_at_the_capacity_is_no_overshoot() -> None:
    peak, above, excess, used = np.zeros((4, 1))
    metrics.fold_overshoot(np.array([2.0]), np.array([2.0]), 1.0, peak, above, excess, used)
    assert (peak[0], above[0], excess[0], used[0]) == (2.0, 0.0, 0.0, 2.0)
