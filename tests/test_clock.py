"""Tick q is at phase + q * period, and the next tick is exact where the division is not."""

import math
import re
from bisect import bisect_left
from typing import Any

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from aimd_des import InputError
from aimd_des.clock import Clock

PERIODS = st.one_of(st.sampled_from([0.1, 0.3, 1.0, 1 / 3, 7e-4]), st.floats(1e-4, 1e4))
PHASES = st.one_of(st.sampled_from([0.0, 0.1, 0.5, 1e6]), st.floats(0.0, 1e6))


def test_ticks_do_not_drift_in_a_million() -> None:
    clock = Clock(period=0.1)
    assert [clock.time(10 * q) for q in range(100_001)] == [float(q) for q in range(100_001)]


def test_two_clocks_tie_where_they_tie_on_paper() -> None:
    fine, coarse = Clock(period=0.1), Clock(period=0.5)
    for look in range(0, 200_000, 997):
        assert fine.time(5 * look) == coarse.time(look)
        assert fine.next_tick(coarse.time(look)) == 5 * look


def test_adding_periods_would_drift() -> None:
    total = 0.0
    for _ in range(10**6):
        total += 0.1
    assert total != Clock(period=0.1).time(10**6) == 100_000.0


@given(PERIODS, PHASES, st.integers(0, 300), st.floats(-3.0, 300.0))
def test_next_tick_is_what_a_search_finds(period: float, phase: float, tick: int, elsewhere: float) -> None:
    clock = Clock(period, phase)
    ticks = [clock.time(q) for q in range(320)]
    exact = ticks[tick]
    near = [math.nextafter(exact, -math.inf), exact, math.nextafter(exact, math.inf)]
    for time in [*near, phase + elsewhere * period]:
        assert clock.next_tick(time) == bisect_left(ticks, time)


@given(PERIODS, PHASES, st.integers(0, 10**9))
@example(0.1, 0.0, 10**6)
def test_next_tick_is_exact_far_from_the_start(period: float, phase: float, tick: int) -> None:
    clock = Clock(period, phase)
    time = clock.time(tick)
    assume(clock.time(tick - 1) < time < clock.time(tick + 1) if tick else True)
    assert clock.next_tick(time) == tick
    assert clock.next_tick(math.nextafter(time, math.inf)) == tick + 1


@pytest.mark.parametrize("time", [-1e300, -5.0, 0.0, 2.5])
def test_no_tick_is_before_the_first(time: float) -> None:
    assert Clock(period=1.0, phase=2.5).next_tick(time) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.0}, "period = 0.0: must be a finite number greater than 0"),
        ({"period": -1}, "period = -1.0: must be a finite number greater than 0"),
        ({"period": math.nan}, "period = nan: must be a finite number greater than 0"),
        ({"period": "1"}, "period = '1': must be a finite number greater than 0"),
        ({"phase": -0.5}, "phase = -0.5: must be a finite number at least 0"),
        ({"phase": math.inf}, "phase = inf: must be a finite number at least 0"),
        ({"phase": None}, "phase = None: must be a finite number at least 0"),
    ],
)
def test_a_clock_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        Clock(**options)


def test_a_clock_cannot_be_changed_and_is_equal_to_its_like() -> None:
    clock = Clock(period=2, phase=1)
    assert clock == Clock(2.0, 1.0)
    assert (type(clock.period), type(clock.phase)) == (float, float)
    with pytest.raises(AttributeError):
        clock.period = 3.0  # type: ignore[misc]
