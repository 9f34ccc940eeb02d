"""Cures for loss and delay: what they send by hand, and at a reduced size what they are worth."""

from functools import lru_cache

import numpy as np
import pytest

from aimd_des.study import mean_and_error
from scenarios.cures import (
    BURSTS,
    CURES,
    DELAY,
    INFERRED,
    KNOWN,
    LOSS,
    NOTHING,
    THRICE,
    WAIT,
    Case,
    Cure,
    _inferring,
    losses,
    measure,
)

DRAWS = 8
# By Student's t with 7 degrees of freedom a mean is so far off once in 1,000.
Z = 5.4


@lru_cache
def runs(setting: str, cure: str) -> list[dict[str, float]]:
    return [measure(Case(setting, cure, 80.0, 5000.0), draw, 1000 * draw) for draw in range(DRAWS)]


def gap(name: str, setting: str, one: str, other: str) -> tuple[float, float]:
    pairs = zip(runs(setting, one), runs(setting, other), strict=True)
    mean, error = mean_and_error([a[name] - b[name] for a, b in pairs])
    return float(mean), float(error)


def test_copies_are_lost_together_with_the_power_of_the_loss() -> None:
    channel = Cure(copies=2, both_heard=True).channel(LOSS, np.array([0.0, 0.2]))
    assert channel.loss.mean == pytest.approx([0.0, 0.04])
    # Both of two copies arrive with probability 0.64, which is 2/3 of the 0.96 of which at least one does.
    assert channel.duplication == pytest.approx([1.0, 2 / 3])
    # In a burst both are lost, or none.
    bursty = Cure(copies=2, both_heard=True).channel(BURSTS, np.array([0.0, 0.2]))
    assert bursty.loss.mean == pytest.approx([0.0, 0.2])
    assert bursty.duplication == pytest.approx(1.0)
    assert (Cure(copies=3).bits, Cure(number_bits=5).bits, Cure().bits) == (3, 6, 1)
    assert losses(3).mean() == pytest.approx(0.25)
    assert not np.array_equal(losses(3), losses(4))


def test_loss_is_inferred_from_second_copies() -> None:
    """Over a link that loses 0.4 of all copies, and 0.16 of the signals of which two are sent."""
    draws = np.random.default_rng(0).random((20_000, 2)) > 0.4
    memory, answer = np.zeros(3), 0.0
    for time, copies in enumerate(draws):
        if copies.any():
            answer = _inferring(0.01, 2.0, 0.5, float(time), memory)
        if copies.all():
            assert _inferring(0.01, 2.0, 0.5, float(time), memory) == 0.0
    # The frequency of second copies has an error of sqrt(f (1 - f) / heard), f = 0.36 / 0.84.
    share = 0.36 / 0.84
    error = np.sqrt(share * (1.0 - share) / draws.any(axis=1).sum())
    slope = 2.0 * 0.4 * 2.0 / (1.0 + share) ** 2  # d p**2 / df with p = (1 - f) / (1 + f)
    assert 1.0 - 0.04 / answer == pytest.approx(0.16, abs=4.0 * slope * error)


def test_a_hold_off_that_is_too_long_for_what_is_needed_is_left_out() -> None:
    assert Case(DELAY, WAIT, 45.0, 1.0).possible
    assert not Case(DELAY, WAIT, 250.0, 1.0).possible
    assert all(Case(setting, NOTHING, 90.0, 1.0).possible for setting in CURES)


@pytest.mark.slow
def test_who_knows_or_infers_its_loss_is_nearer_than_three_copies_bring_it() -> None:
    for one, other in ((NOTHING, THRICE), (THRICE, KNOWN), (THRICE, INFERRED)):
        mean, error = gap("misallocation", LOSS, one, other)
        assert mean > Z * error
    saved, error = gap("bits", LOSS, THRICE, KNOWN)
    assert saved > Z * error
    apart, error = gap("misallocation", LOSS, INFERRED, KNOWN)
    assert abs(apart) < Z * error
    bits = [np.mean([one["bits"] for one in runs(LOSS, cure)]) for cure in (KNOWN, INFERRED, THRICE)]
    # Nothing is sent twice by who knows, and who infers needs as many signals.
    assert bits[1] / bits[0] == pytest.approx(2.0, rel=0.1)
    assert bits[2] > bits[1] > bits[0]


@pytest.mark.slow
def test_against_latency_a_longer_hold_off_takes_fewer_bits_and_uses_more() -> None:
    fewer, error = gap("bits", DELAY, NOTHING, WAIT)
    assert fewer > Z * error
    more, error = gap("utilisation", DELAY, WAIT, NOTHING)
    assert more > Z * error
    for cure in (NOTHING, WAIT):
        above, error = mean_and_error([one["above"] for one in runs(DELAY, cure)])
        assert above < 0.02 + Z * error  # risk is about the same, of 1 %


def test_in_bursts_copies_are_worth_nothing() -> None:
    once, twice = (measure(Case(BURSTS, cure, 80.0, 100.0), 0, 0) for cure in (NOTHING, INFERRED))
    assert twice == {**once, "bits": 2.0 * once["bits"]}
    alone, other = (measure(Case(LOSS, cure, 80.0, 100.0), 0, 0) for cure in (NOTHING, INFERRED))
    assert other != {**alone, "bits": 2.0 * alone["bits"]}  # negative control: each lost for itself


@pytest.mark.slow
def test_in_bursts_known_loss_helps_less() -> None:
    nearer, error = gap("misallocation", BURSTS, NOTHING, KNOWN)
    assert nearer > Z * error
    pairs = zip(runs(BURSTS, KNOWN), runs(LOSS, KNOWN), strict=True)
    worse, error = mean_and_error([a["misallocation"] - b["misallocation"] for a, b in pairs])
    assert worse > Z * error
