"""The sum of absolute values of jointly normal variates, against draws; and trajectories."""

import math

import numpy as np
import pytest

from aimd_des.theory.absolute_sum import _cumulants, absolute_interval, absolute_mean
from aimd_des.theory.trajectory import Trajectory
from aimd_des.utils.validation import FloatArray

DRAWS = 100_000


def shared_total(n: int, biased: float) -> tuple[FloatArray, FloatArray]:
    """Means and covariance of n variates of different sizes whose sum does not vary, as of averages."""
    rng = np.random.default_rng(n)
    spread = rng.uniform(0.5, 2.0, n)
    keep = np.eye(n) - np.outer(spread**2, np.ones(n)) / (spread**2).sum()
    mean = rng.normal(0.0, biased, n) * spread
    return mean - mean.mean(), keep @ np.diag(spread**2) @ keep.T


def sums(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    drawn = np.random.default_rng(1).multivariate_normal(mean, covariance, DRAWS, method="eigh")
    return np.asarray(np.abs(drawn).sum(axis=1))


def parts(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    variance = np.diag(covariance).copy()
    return variance, covariance - np.diag(variance)


@pytest.mark.parametrize(("n", "biased"), [(8, 0.0), (20, 0.5), (60, 0.2), (60, 1.5)])
def test_cumulants_and_interval_are_those_of_draws(n: int, biased: float) -> None:
    mean, covariance = shared_total(n, biased)
    variance, shared = parts(covariance)
    drawn = sums(mean, covariance)
    width, off = drawn.std(ddof=1), drawn - drawn.mean()
    first, second, third = _cumulants(mean, variance, shared)
    # Standard errors from the draws themselves.
    assert abs(first - drawn.mean()) < 4 * width / math.sqrt(DRAWS)
    assert abs(second - (off**2).mean()) < 4 * (off**2).std() / math.sqrt(DRAWS)
    assert abs(third - (off**3).mean()) < 4 * (off**3 - 3 * width**2 * off).std() / math.sqrt(DRAWS)
    # The share of draws beyond a bound has the error of a count; the page says by how much a bound may be off
    # besides, a twentieth of the width, where the density of a normal variate is 0.058 / width.
    allowed = 4 * math.sqrt(0.025 * 0.975 / DRAWS) + 0.058 * (0.01 if n >= 20 else 0.05)
    low, high = absolute_interval(mean, variance, shared)
    assert abs((drawn < low).mean() - 0.025) < allowed
    assert abs((drawn > high).mean() - 0.025) < allowed


def test_without_what_agents_share_variance_and_interval_are_wrong() -> None:
    mean, covariance = shared_total(8, 0.0)
    variance, _ = parts(covariance)
    drawn = sums(mean, covariance)
    off = drawn - drawn.mean()
    _, second, third = _cumulants(mean, variance, None)
    assert abs(second - (off**2).mean()) > 4 * (off**2).std() / math.sqrt(DRAWS)
    assert abs(third - (off**3).mean()) > 4 * (off**3).std() / math.sqrt(DRAWS)
    low, _ = absolute_interval(mean, variance, None)
    assert abs((drawn < low).mean() - 0.025) > 4 * math.sqrt(0.025 * 0.975 / DRAWS)


def test_two_variates_with_mean_0_have_the_covariance_of_the_arcsine_law() -> None:
    # E|X||Y| = 2 / pi (sqrt(1 - r**2) + r asin r) for unit variances; the series stops at r**2.
    r = 0.1
    exact = 2 * (1 - 2 / math.pi) + 2 * (2 / math.pi) * (math.sqrt(1 - r * r) + r * math.asin(r) - 1)
    _, second, _ = _cumulants(np.zeros(2), np.ones(2), np.array([[0.0, r], [r, 0.0]]))
    assert second == pytest.approx(exact, abs=r**4)


def test_what_does_not_vary_has_no_interval() -> None:
    mean = np.array([1.0, -2.0])
    assert absolute_interval(mean, np.zeros(2), np.zeros((2, 2))) == (3.0, 3.0)
    low, high = absolute_interval(mean, np.zeros(2), None, np.array([0.2, 0.1]))
    off = abs((np.sign(mean) * [0.2, 0.1]).sum())
    assert (low, high) == pytest.approx((3.0 - 1.96 * off, 3.0 + 1.96 * off), rel=1e-4)
    # Far from 0 the variates' own sum is all there is, and it is constant.
    low, high = absolute_interval(np.array([9.0, 9.0]), np.ones(2), np.array([[0.0, -1.0], [-1.0, 0.0]]))
    assert low == pytest.approx(18.0)
    assert high == pytest.approx(18.0)
    assert absolute_mean(mean, np.zeros(2)).tolist() == [1.0, 2.0]


def test_a_trajectory_is_followed_no_further_than_asked_and_never_anew() -> None:
    calls: list[float] = []

    def slope(at: float, state: FloatArray) -> FloatArray:
        calls.append(at)
        return -state

    start = np.array([[1.0], [2.0]])
    way = Trajectory(slope, 0.0, start)
    assert way(3.0) == pytest.approx(start * math.exp(-3.0), abs=2e-5)
    assert 3.0 < max(calls) < 5.0
    count = len(calls)
    assert way(0.5) == pytest.approx(start * math.exp(-0.5), abs=2e-5)
    assert len(calls) == count
    other = Trajectory(slope, 0.0, start)
    assert [other(at).tolist() for at in (0.5, 3.0)] == [way(at).tolist() for at in (0.5, 3.0)]
