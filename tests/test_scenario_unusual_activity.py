"""What a camera gains by unusual activity: seeds 0 to 23, against theory that knows nothing of them."""

from functools import partial

import numpy as np
import pytest

from aimd_des.study import mean_and_error, replicate
from scenarios.common.tables import reached
from scenarios.unusual_activity.runs import Seen, Size, fluid, groups, measure, shares

SIZE = Size(24, 200.0, 450.0, 460.0, 10.0)
# By Student's t with 23 degrees of freedom, beyond once in 2,000 means.
Z = 4.0

Runs = dict[tuple[str, str], list[Seen]]


@pytest.fixture(scope="module")
def runs() -> Runs:
    cases = [("quadratic costs", "all of the past"), ("quadratic costs", "forgetting, 100")]
    cases += [("costs of power 6", name) for _, name in cases]
    jobs = [partial(measure, groups()[group], name, SIZE) for group, name in cases]
    return dict(zip(cases, replicate(jobs, SIZE.replications, 0, workers=1), strict=True))


def during(runs: Runs, group: str, name: str, part: str, first: float, last: float) -> tuple[float, float]:
    """Mean and standard error over replications of the time average over a stretch of the event."""
    since = SIZE.times - SIZE.begin
    chosen = (since >= first) & (since <= last)
    mean, error = mean_and_error([getattr(run, part)[chosen].mean() for run in runs[group, name]])
    return float(mean), float(error)


@pytest.mark.slow
def test_demand_goes_to_the_new_share_whatever_the_memory_where_costs_are_quadratic(runs: Runs) -> None:
    old, new = shares(groups()["quadratic costs"])
    for name in ("all of the past", "forgetting, 100"):
        mean, error = during(runs, "quadratic costs", name, "demand", 150.0, 250.0)
        # Relaxes with new / alpha = 67 periods: exp(-200 / 67) = 5 % of the way are left in the mean.
        expected = new - (new - old) * 0.05
        assert abs(mean - expected) < Z * error + 0.02 * new
        assert mean - old > 2 * Z * error  # negative control: it has left the old share


@pytest.mark.slow
def test_the_average_follows_as_fast_as_the_memory_allows(runs: Runs) -> None:
    for group, name in runs:
        _, average = fluid(groups()[group], name, SIZE)
        mean, error = during(runs, group, name, "average", 230.0, 250.0)
        since = SIZE.times - SIZE.begin
        expected = float(average[(since >= 230.0) & (since <= 250.0)].mean())
        # The fluid is the mean but for what scatter does to steep costs: 3 % allowed.
        assert abs(mean - expected) < Z * error + 0.03 * expected
    old, new = shares(groups()["quadratic costs"])
    slow, wrong = during(runs, "quadratic costs", "all of the past", "average", 230.0, 250.0)
    assert slow + Z * wrong < old + 0.75 * (new - old)  # negative control: not there yet


@pytest.mark.slow
def test_steep_costs_make_demand_overdo_it(runs: Runs) -> None:
    old, new = shares(groups()["costs of power 6"])
    for name in ("all of the past", "forgetting, 100"):
        mean, error = during(runs, "costs of power 6", name, "demand", 40.0, 80.0)
        assert mean - Z * error > new > old


def test_when_a_part_of_the_way_is_reached() -> None:
    times, way = np.array([0.0, 10.0, 20.0]), np.array([0.0, 0.4, 0.6])
    assert reached(times, way, 0.5) == pytest.approx(15.0)
    assert np.isnan(reached(times, way, 0.7))
