"""A night of charging: meters, averages, signals that get lost, and a threshold that prevents overload.

Nights have 12 vehicles and the seeds 0 to 3; means over them are held to within Z standard errors.
"""

import numpy as np
import pytest

from aimd_des.utils.validation import FloatArray
from scenarios.common.tables import theory_of
from scenarios.ev_day import LOSS, Case, Night, night, run

NIGHTS, VEHICLES, STEP = 4, 12, 120
# By Student's t with 3 degrees of freedom, beyond this on one side once in 200.
Z = 6.0


def nights(case: Case) -> list[Night]:
    return [night(case, VEHICLES, STEP, seed) for seed in range(NIGHTS)]


@pytest.fixture(scope="module")
def perfect() -> list[Night]:
    return nights(Case(late=False, lossy=False))


@pytest.fixture(scope="module")
def lossy() -> list[Night]:
    return nights(Case(late=True, lossy=True))


def measured(runs: list[Night], name: str) -> FloatArray:
    return np.array([found.numbers[name] for found in runs])


def error(values: FloatArray) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def test_meters_agree_with_the_averages_over_the_stay() -> None:
    # The average over the stay times the stay is the energy, exactly. A meter that reads by the minute
    # takes a fall for a slope: an answer is off by at most 0.15 of the demand times a minute, either way.
    result, garage = run(Case(late=True, lossy=True), 8, 240, seed=0)
    stay = (garage.gone - garage.vehicles.arrival) / 60.0
    exact = result.average_at_end[:, 0] * stay
    answers = result.account.responses[0]
    largest = 2.0 * garage.energy / stay  # demand rarely exceeds twice its mean
    np.testing.assert_array_less(np.abs(garage.energy - exact), 0.15 * largest / 60.0 * answers + 0.01)
    np.testing.assert_allclose(garage.energy, exact, rtol=0.02)
    # Who is full by its meter leaves; who is not would leave on time.
    early = garage.gone < garage.vehicles.departure
    assert early.all()
    assert (garage.energy >= garage.vehicles.energy).all()
    # Negative control: the same with averages that forget is no energy.
    other, forgetful = run(Case(late=True, lossy=True, forgets=True), 8, 240, seed=0)
    hours = (forgetful.gone - forgetful.vehicles.arrival) / 60.0
    assert np.abs(other.average_at_end[:, 0] * hours / forgetful.energy - 1.0).max() > 0.1


@pytest.mark.slow
def test_lost_signals_are_replaced_by_more_signals(perfect: list[Night], lossy: list[Night]) -> None:
    # Paired: with the ratio r = 1 / (1 - p), lossy - r * perfect is 0 in the mean, but for what is used
    # besides: demand that is late to fall is higher by 1 or 2 %, and takes 5 % fewer signals at most.
    ratio, name = 1.0 / (1.0 - LOSS), "signals, 22:00 to 1:00"
    one, other = measured(lossy, name), measured(perfect, name)
    gap = one - ratio * other
    assert abs(gap.mean()) < 0.05 * ratio * other.mean() + Z * error(gap)
    # Negative control: they are not as many as without loss.
    assert (one - other).mean() > 0.05 * other.mean() + Z * error(one - other)


@pytest.mark.slow
def test_the_threshold_of_theory_prevents_overload(lossy: list[Night]) -> None:
    lowered, name = nights(Case(late=True, lossy=True, lowered=True)), "minutes above capacity"
    above = measured(lowered, name)
    allowed = np.array([found.numbers[theory_of(name)] for found in lowered])
    assert (above - allowed).mean() < -Z * error(above - allowed)
    # Negative control: with the threshold at the capacity it is more than is allowed.
    excess = measured(lossy, name) - allowed
    assert excess.mean() > Z * error(excess)
    for runs in (lossy, lowered):
        assert (measured(runs, "energy missing") == 0.0).all()


@pytest.mark.slow
def test_late_signals_are_a_part_of_why_vehicles_are_full_earlier(
    perfect: list[Night], lossy: list[Night]
) -> None:
    """Latency alone brings something in every night, and less than latency and loss together."""
    name = "hours to spare"
    late = measured(nights(Case(late=True, lossy=False)), name) - measured(perfect, name)
    both = measured(lossy, name) - measured(perfect, name)
    assert (late > 0.0).all()
    assert late.mean() < both.mean()
