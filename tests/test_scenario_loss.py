"""How much loss is usable, and what luck leaves where losses differ: three draws of the costs."""

import numpy as np
import pytest

from aimd_des.theory import critical_loss, needed_rate
from aimd_des.utils.validation import FloatArray
from scenarios.common.systems import memory_alone, usable
from scenarios.loss import _LATE, _NEW, _SAME, _SPREAD, _WAYS, _Case, _measured

DRAWS = range(3)
SLOW, FAST, CLOCK = _WAYS
SPAN = (500.0, 1000.0, 3000.0)


def above(way: object, loss: float) -> FloatArray:
    cases = [_Case(way, _SAME, loss, SPAN) for _ in DRAWS]  # type: ignore[arg-type]
    found = [_measured(case, draw, 1000 * draw) for draw, case in zip(DRAWS, cases, strict=True)]
    return np.array([row[_LATE] for (row,) in found])


def test_loss_that_is_survived_need_not_be_usable() -> None:
    for draw, time in zip(DRAWS, above(SLOW, 0.25), strict=True):
        assert critical_loss(needed_rate(memory_alone(draw=draw)), hold_off=1.0)[0] > 0.25
        assert time > 0.02
    # Negative control: with a short hold-off, hardly ever.
    assert (above(FAST, 0.25) < 0.001).all()


def test_the_usable_loss_is_where_theory_puts_it() -> None:
    """It rises ninefold from 0.1 below to 0.1 beyond, so that the two tell a tenth of loss."""
    expected = usable(memory_alone(), FAST.hold_off)
    below, beyond = above(FAST, expected - 0.1), above(FAST, expected + 0.1)
    assert (below < 0.01).all()
    assert (beyond > 0.01).all()


def test_on_the_clock_demand_is_above_the_capacity_without_any_loss() -> None:
    assert (above(CLOCK, 0.0) > 0.3).all()


@pytest.mark.slow
def test_what_is_left_from_the_reweighted_optimum_is_luck_that_wears_off() -> None:
    """Ten times as long a run leaves 0.32 of the luck; a bias would be as it was.

    The misallocation of a run scatters by a sixth of itself, so that 0.6 is more than three errors of the
    ratio away.
    """
    case = _Case(CLOCK, _SPREAD, 0.4, (500.0, 3000.0, 30_000.0))
    found = np.array([[row[_NEW] for row in _measured(case, draw, 1000 * draw)] for draw in DRAWS])
    assert (found[:, 1] < 0.6 * found[:, 0]).all()
