"""What the studies of latency are to show, at a small size: draws 0 to 3 of the costs."""

import math

import numpy as np
import pytest

from aimd_des import theory
from aimd_des.study import mean_and_error
from scenarios.common.measure import run_draws
from scenarios.common.systems import memory_alone, rate
from scenarios.delay import Case, expect, measure, taken
from scenarios.usable import Case as Search
from scenarios.usable import search, usable_delay, usable_loss

# Standard errors by which a mean may be off: by Student's t with 3 degrees of freedom once in 200.
Z = 6.0
DRAWS = 4

Found = dict[tuple[float, float], list[dict[str, float]]]


@pytest.fixture(scope="module")
def found() -> Found:
    """Measures of each latency and hold-off, draw by draw; 1,500 units after the start."""
    where = [
        (0.0, 0.5),
        (0.0, 1.4),
        (0.5, 0.5),
        (2.0, 0.1),
        (5.0, 0.5),
        (10.0, 0.1),
        (10.0, 0.5),
        (0.0, 2.0),
        (10.0, 2.0),
    ]
    cases = [Case(*each, 1_500.0) for each in where]
    outcomes = run_draws(measure, cases, DRAWS, 1, 0, quick=True)
    return {each: [one for (one,) in runs] for each, (_, runs) in zip(where, outcomes, strict=True)}


def column(found: Found, name: str, *where: float) -> np.ndarray:
    return np.array([one[name] for one in found[where]])  # type: ignore[index]


@pytest.mark.parametrize("where", [(2.0, 0.1), (10.0, 0.1), (10.0, 0.5)])
@pytest.mark.parametrize("name", ["signals", "utilisation", "smallest"])
def test_signals_on_their_way_do_what_the_limit_cycle_says(
    where: tuple[float, float], name: str, found: Found
) -> None:
    """Ratios draw by draw, so that the spread of the costs cancels: 3 % is claimed."""
    wanted = [expect(Case(*where, 1_500.0), draw)[name] for draw in range(DRAWS)]
    mean, error = mean_and_error((column(found, name, *where) / wanted).tolist())
    assert abs(mean - 1.0) < 0.03 + Z * error
    # Negative control: without latency all of them are others.
    plain = [expect(Case(0.0, where[1], 1_500.0), draw)[name] for draw in range(DRAWS)]
    apart, error = mean_and_error((column(found, name, *where) / plain).tolist())
    if where[1] == 0.1:
        assert abs(apart - 1.0) > 0.03 + Z * error


def test_what_they_take_orders_the_shares(found: Found) -> None:
    """Differences from no latency, draw by draw: none up to X = 0.7, and more than a point at 1.4."""
    floor = column(found, "misallocation", 0.0, 0.5)
    right, error = mean_and_error((column(found, "misallocation", 5.0, 0.5) - floor).tolist())
    assert taken(5.0, 0.5) == pytest.approx(0.7, abs=0.05)
    assert abs(right) < 0.005 + Z * error
    short, error = mean_and_error((column(found, "misallocation", 2.0, 0.1) - floor).tolist())
    assert taken(2.0, 0.1) == pytest.approx(1.4, abs=0.1)
    assert short > 0.01
    # Far from the noise of a run, at five times that: no chance is left.
    far, error = mean_and_error(column(found, "misallocation", 10.0, 0.1).tolist())
    assert far - Z * error > 0.15


def test_beyond_one_over_rho_demand_runs_away_whatever_the_latency(
    found: Found,
) -> None:
    assert min(1.0 / rate(memory_alone(draw=draw)) for draw in range(DRAWS)) < 2.0
    for latency in (0.0, 10.0):
        mean, error = mean_and_error(column(found, "utilisation", latency, 2.0).tolist())
        assert mean > 1.05
        assert (column(found, "signals", latency, 2.0) > 0.95 * 0.5).all()
    mean, error = mean_and_error(column(found, "utilisation", 10.0, 0.5).tolist())
    assert mean + Z * error < 1.05


def test_peaks_stay_on_the_line_only_where_one_cut_is_enough(
    found: Found,
) -> None:
    for latency in (0.0, 0.5):
        assert (column(found, "level", latency, 0.5) <= 0.0).all()
    assert (column(found, "level", 0.0, 1.4) > 0.01).all()


@pytest.mark.slow
@pytest.mark.parametrize("hold_off", [0.1, 0.7])
def test_usable_delay_is_what_the_threshold_leaves_for_growth(hold_off: float) -> None:
    """Within a tenth of a period, of draws 0 and 1."""
    case = Search("latency", 4.0, 0.02, hold_off, 0.9, 1_000.0)
    room = 0.1 * memory_alone().capacity[0] / memory_alone().increase.sum()
    wanted = usable_delay(case)["above"]
    assert wanted == pytest.approx(room, abs=0.2)
    for draw in (0, 1):
        assert search(case, draw, 1_000 * draw)["above"] == pytest.approx(wanted, abs=0.1)
    # Negative control: another threshold.
    other = usable_delay(case._replace(threshold=0.95))["above"]
    assert abs(other - wanted) > 0.5


@pytest.mark.slow
def test_a_threshold_below_the_capacity_makes_more_loss_usable() -> None:
    """A tenth of loss is told from another: the time above the capacity rises ninefold over two of them."""
    edges = {}
    for threshold in (1.0, 0.95):
        case = Search("loss", 0.95, 0.01, 0.5, threshold, 1_500.0)
        found, wanted = search(case, 0, 0), usable_loss(case)["above"]
        assert found["above"] == pytest.approx(wanted, abs=0.1)
        assert (
            found["misallocation"] > found["above"] + 0.1
        )  # losses that are the same for all cost no shares
        edges[threshold] = found["above"]
    assert edges[0.95] - edges[1.0] > 0.1


@pytest.mark.slow
def test_usable_delay_by_the_shares_grows_with_the_hold_off() -> None:
    """Noise of a run is 2 %, which leaves sqrt(25 - 4) = 4.6 of 5 % to the bias."""
    edges = []
    for hold_off in (0.1, 0.2):
        case = Search("latency", 8.0, 0.1, hold_off, 0.9, 3_000.0)
        edge, wanted = search(case, 0, 0)["misallocation"], usable_delay(case)["misallocation"]
        assert math.sqrt(0.046 / 0.05) * wanted * 0.85 < edge < 1.1 * wanted
        edges.append(edge)
    assert edges[1] == pytest.approx(2.0 * edges[0], rel=0.25)
    # It is where X is about one and a half: the bounds of theory are proportional to it.
    shortest, _ = theory.hold_off_bounds(memory_alone(), edges[0], taken=1.5)
    assert shortest[0] == pytest.approx(0.1, rel=0.25)


def test_a_limit_that_is_never_kept_or_always_is_said_so() -> None:
    always = Search("latency", 0.5, 0.1, 0.5, 0.9, 500.0)
    assert search(always, 0, 0)["above"] == 0.5
    never = Search("latency", 0.5, 0.1, 2.0, 1.0, 500.0)
    assert search(never, 0, 0)["above"] == 0.0
