"""Losses that are not independent: limits by hand; runs are held against them in tests of the scenarios."""

import numpy as np
import pytest

from aimd_des import InputError, theory
from models.smart_cameras import smart_cameras
from scenarios.common.systems import memory_alone


def test_without_bursts_shares_are_those_of_independent_losses_to_half_a_tooth() -> None:
    problem = memory_alone()
    allocation, signals = theory.burst_shares(problem, 0.2, 0.0)
    expected = theory.predict(problem, "continuous", loss=0.2)
    assert signals == pytest.approx(float(expected.signals[0]), rel=0.05)
    assert allocation.sum() == pytest.approx(problem.capacity[0] - 0.5 * problem.increase.sum() / signals)
    assert np.abs(allocation - expected.allocation).sum() < 0.02 * allocation.sum()


def test_bad_links_that_hold_everything_leave_no_prediction() -> None:
    problem = memory_alone()
    most = float(problem.capacity[0] / (0.2 * problem.increase.sum()))
    assert np.isfinite(theory.burst_shares(problem, 0.2, 0.9 * most)[1])
    allocation, signals = theory.burst_shares(problem, 0.2, most)
    assert np.isnan(allocation).all()
    assert np.isnan(signals)


def test_two_bits_make_a_third_a_fifteenth() -> None:
    believed = theory.believed_loss([0.0, 1 / 3, 0.5], 2)
    assert believed == pytest.approx([0.0, 1 / 15, 0.0], abs=1e-12)
    assert theory.believed_loss(0.3, 5) == pytest.approx(0.3, abs=1e-6)
    assert theory.believed_loss(0.3, 8) == 0.3


def test_what_is_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match="number_bits"):
        theory.believed_loss(0.1, 1)
    with pytest.raises(InputError, match="loss"):
        theory.believed_loss(1.0, 3)
    with pytest.raises(InputError, match="burst"):
        theory.burst_shares(memory_alone(), 0.1, -1.0)
    with pytest.raises(InputError, match="number of resources"):
        theory.burst_shares(smart_cameras(0), 0.1, 1.0)
