"""What a camera gains by unusual activity: 8 draws of the costs, 3 runs each, beside theory of these."""

import numpy as np
import pytest

from aimd_des.study import mean_and_error
from scenarios.common.measure import run_draws
from scenarios.common.tables import reached
from scenarios.unusual_activity import (
    ONE,
    STEEP,
    Case,
    Seen,
    expected_scatter,
    fluid,
    kin,
    measure,
    progress,
    scatter,
)

DRAWS, EACH = 8, 3
WHOLE, SHORT = "all of the past", "forgetting, 100"
CASES = [Case(group, name, 200.0, 450.0, 460.0, 10.0) for group in (ONE, STEEP) for name in (WHOLE, SHORT)]
# By Student's t with 7 degrees of freedom, beyond once in 1,000 means.
Z = 5.4

Runs = dict[Case, list[list[Seen]]]


@pytest.fixture(scope="module")
def runs() -> Runs:
    return dict(run_draws(measure, CASES, DRAWS, EACH, 0, quick=True))


def during(runs: Runs, case: Case, part: int, first: float, last: float) -> tuple[float, float, float]:
    """Average a part of the way over a stretch of the event: mean and error over draws, and theory."""
    chosen = (case.since >= first) & (case.since <= last)
    found = [
        progress(case.group, draw, np.mean([run.course[part] for run in seen], axis=0))[chosen].mean()
        for draw, seen in enumerate(runs[case])
    ]
    mean, error = mean_and_error(found)
    known = [fluid(case, draw)[part, chosen].mean() for draw in range(DRAWS)]
    return float(mean), float(error), float(np.mean(known))


@pytest.mark.slow
def test_demand_goes_to_the_new_share_whatever_the_memory_where_costs_are_quadratic(runs: Runs) -> None:
    for case in CASES[:2]:
        mean, error, _ = during(runs, case, 0, 150.0, 250.0)
        # Relaxes with new / alpha = 67 periods: exp(-200 / 67) = 5 % of the way are left in the mean.
        assert abs(mean - 0.95) < Z * error + 0.02
        assert mean > 2 * Z * error  # negative control: it has left the old share


@pytest.mark.slow
def test_the_average_follows_as_fast_as_the_memory_allows(runs: Runs) -> None:
    for case in CASES:
        mean, error, known = during(runs, case, 1, 230.0, 250.0)
        # The fluid is the mean but for what scatter does to steep costs: 3 % allowed.
        assert abs(mean - known) < Z * error + 0.03 * known
    slow, wrong, _ = during(runs, CASES[0], 1, 230.0, 250.0)
    assert slow + Z * wrong < 0.75  # negative control: not there yet


@pytest.mark.slow
def test_steep_costs_make_demand_overdo_it(runs: Runs) -> None:
    for case in CASES[2:]:
        mean, error, _ = during(runs, case, 0, 40.0, 80.0)
        assert mean - Z * error > 1.0


@pytest.mark.slow
def test_the_price_of_a_memory_is_the_scatter_that_theory_has(runs: Runs) -> None:
    """Some 160 cameras with 2 degrees of freedom each; theory has the mean square to within 15 %."""
    squares = {}
    for case in CASES[:2]:
        found = [scatter(case, draw, seen) for draw, seen in enumerate(runs[case])]
        squares[case] = np.mean([expected_scatter(case, draw) for draw in range(DRAWS)])
        count = sum(len(kin(case.group, draw)) for draw in range(DRAWS))
        allowed = 4.0 * squares[case] * np.sqrt(1.0 / count) + 0.15 * squares[case]
        assert abs(np.mean(found) - squares[case]) < allowed
        # Negative control: a memory of half the length would scatter twice as much in squares.
        assert abs(np.mean(found) - 2.0 * squares[case]) > allowed


def test_when_a_part_of_the_way_is_reached() -> None:
    times, way = np.array([0.0, 10.0, 20.0]), np.array([0.0, 0.4, 0.6])
    assert reached(times, way, 0.5) == pytest.approx(15.0)
    assert np.isnan(reached(times, way, 0.7))
