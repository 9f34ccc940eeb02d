"""Latencies that differ, at a tenth of the size of the study: eight draws of the costs and of who is late."""

import numpy as np
import pytest

from aimd_des import theory
from aimd_des.study import mean_and_error
from scenarios.common.systems import memory_alone, rate
from scenarios.unequal_delays import (
    ALL,
    EVEN,
    HALF,
    SCATTERED,
    THREE,
    Case,
    N,
    groups,
    latencies,
    measure,
)

DRAWS = 8
# By Student's t with 7 degrees of freedom a mean is so far off once in 1,000.
Z = 5.4


def runs(mixture: str, latency: float) -> list[dict[str, float]]:
    case = Case(mixture, latency, 0.5, 4000.0)
    return [measure(case, draw, 1000 * draw) for draw in range(DRAWS)]


def test_mixtures_have_the_mean_and_who_is_late_is_drawn() -> None:
    for mixture in (ALL, HALF, EVEN, THREE, SCATTERED):
        assert latencies(mixture, 10.0, 3).mean() == pytest.approx(10.0)
    first, others, three = groups(3)
    assert sorted([*first, *others]) == list(range(N))
    assert (latencies(HALF, 10.0, 3)[first] == 0.0).all()
    assert set(np.flatnonzero(latencies(THREE, 10.0, 3) == 0.0)) == set(three)
    assert not np.array_equal(groups(3)[0], groups(4)[0])


@pytest.mark.slow
def test_who_is_late_gets_neither_more_nor_less() -> None:
    """Half of a percent is left to the order 1 / n, which pairs of a few agents feel."""
    found = runs(HALF, 10.0)
    for name in ("first", "others"):
        mean, error = mean_and_error([one[name] for one in found])
        assert abs(mean - 1.0) < 0.005 + Z * error
    early, alike = runs(THREE, 10.0), runs(ALL, 10.0)
    mean, error = mean_and_error(
        [one["three"] / same["three"] for one, same in zip(early, alike, strict=True)]
    )
    assert abs(mean - 1.0) < 0.005 + Z * error
    # Negative control: signals at scattered times do change what one gets.
    mean, error = mean_and_error([one["first"] - one["others"] for one in runs(SCATTERED, 10.0)])
    assert mean + 0.01 + Z * error < 0.0


@pytest.mark.slow
def test_a_mixture_is_milder_than_its_mean() -> None:
    problem = memory_alone()
    # What is exceeded for 1 % of the time is less than the peak by the growth over 1 % of a cycle.
    rise = float(theory.limit_cycle(problem, 0.5, 10.0).period[0] * problem.increase.sum())
    below = 0.01 * rise / float(problem.capacity[0])
    lift, allowed, wanted = {}, {}, {}
    for mixture in (ALL, EVEN, HALF):
        mean, error = mean_and_error([one["high"] for one in runs(mixture, 10.0)])
        lift[mixture], allowed[mixture] = float(mean) - 1.0, Z * float(error) + below
        growth = theory.mixture_lift(problem.increase[:, 0], latencies(mixture, 10.0, 0), rate(problem), 0.5)
        wanted[mixture] = growth / float(problem.capacity[0])
        assert abs(lift[mixture] - wanted[mixture]) < allowed[mixture]
    # Negative control: the mean latency of all would have 0.47 for each.
    for mixture in (EVEN, HALF):
        assert wanted[ALL] - lift[mixture] > allowed[mixture] + 0.2
