"""Tick q is at phase + q * period, and the next tick is exact where the division is not."""

import math
import re
from bisect import bisect_left
from typing import Any

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from aimd_des import InputError, Recording, Simulation
from aimd_des.dynamics.clocks import AgentClocks, Clock, Clocks
from aimd_des.utils.rng import Purpose, key
from tests.conftest import quadratic_problem, quietly, reference_draws

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


def start(n: int = 3, seed: int = 5, **options: Any) -> AgentClocks:
    return Clocks(**options).start(n, key(seed, Purpose.CLOCK))


def test_all_agents_share_a_clock_unless_something_tells_them_apart() -> None:
    clocks = start(period=0.1, phase=0.5)
    assert clocks.common
    assert [clocks.time(agent, 7) for agent in range(3)] == [Clock(0.1, 0.5).time(7)] * 3
    assert clocks.next_ticks(1.0).tolist() == [Clock(0.1, 0.5).next_tick(1.0)]
    assert start(period=[0.1, 0.1, 0.1]).common
    for own in (
        {"period": [1.0, 1.0, 2.0]},
        {"phase": "random"},
        {"drift": [0.0, 0.0, 0.1]},
        {"jitter": 0.5},
    ):
        assert not start(**own).common


def test_each_agent_may_have_its_own_period_phase_and_drift() -> None:
    clocks = start(period=[1.0, 0.5, 2.0], phase=[0.0, 0.25, 3.0], drift=[0.0, 0.1, -0.5])
    for tick in range(20):
        assert clocks.time(0, tick) == tick
        assert clocks.time(1, tick) == pytest.approx(0.25 + 0.55 * tick, rel=1e-15)
        assert clocks.time(2, tick) == 3.0 + tick


def test_random_phases_are_draws_within_a_period() -> None:
    clocks = start(n=50, seed=9, period=4.0, phase="random")
    expected = 4.0 * reference_draws(9, Purpose.CLOCK, 1, 0, 50)
    assert [clocks.time(agent, 0) for agent in range(50)] == expected.tolist()
    assert (clocks.time(7, 3) - clocks.time(7, 0)) == pytest.approx(12.0)


def test_random_phases_are_spread_over_the_period_that_a_clock_has() -> None:
    clocks = start(n=3, seed=9, period=4.0, phase="random", drift=[0.0, 0.5, -0.5])
    draws = reference_draws(9, 4, 1, 0, 3)
    assert [clocks.time(agent, 0) for agent in range(3)] == [4.0 * draws[0], 6.0 * draws[1], 2.0 * draws[2]]


def test_the_clocks_of_a_run_are_drawn_for_clocks() -> None:
    """Nobody answers but at the ticks that the numbers of clocks give."""
    problem = quadratic_problem([1.0, 1.0, 1.0], capacity=1.0, increase=0.1)
    simulation = Simulation(
        problem, clocks=Clocks(phase="random", jitter=0.5), seed=8, recording=Recording(events=True)
    )
    events = quietly(simulation.run, 12.0).events
    phase = reference_draws(8, 4, 1, 0, 3)
    ticks = [phase + tick + 0.5 * reference_draws(8, 4, 0, tick, 3) for tick in range(12)]
    answers = events[events["kind"].isin(["respond", "hold"])]
    assert len(answers) > 12
    for time, agent in zip(answers["time"], answers["agent"].astype(int), strict=True):
        assert time in [tick[agent] for tick in ticks]


def test_jitter_delays_each_tick_by_a_draw_of_its_own() -> None:
    clocks = start(n=4, seed=9, period=1.0, jitter=[0.0, 0.5, 0.9, 0.999])
    for tick in range(50):
        draws = reference_draws(9, Purpose.CLOCK, 0, tick, 4)
        expected = [tick + jitter * draw for jitter, draw in zip([0.0, 0.5, 0.9, 0.999], draws, strict=True)]
        assert [clocks.time(agent, tick) for agent in range(4)] == expected
    ticks = [clocks.time(3, tick) for tick in range(200)]
    assert ticks == sorted(ticks)


@given(PERIODS, st.floats(0.0, 0.99), st.integers(0, 2**32), st.integers(0, 100), st.floats(-1.0, 101.0))
def test_the_next_tick_of_each_agent_is_what_a_search_finds(
    period: float, jitter: float, seed: int, tick: int, elsewhere: float
) -> None:
    clocks = start(
        n=3,
        seed=seed,
        period=[period, 2 * period, period],
        phase="random",
        jitter=[0.0, 0.0, jitter * period],
    )
    ticks = [[clocks.time(agent, q) for q in range(220)] for agent in range(3)]
    exact = [row[tick] for row in ticks]
    near = [math.nextafter(time, to) for time in exact for to in (-math.inf, time, math.inf)]
    for time in [*near, elsewhere * period]:
        expected = [bisect_left(row, time) for row in ticks]
        assert [clocks.next_tick(agent, time) for agent in range(3)] == expected
        assert clocks.next_ticks(time).tolist() == expected


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.0}, "period = 0.0: must be a finite number greater than 0"),
        ({"period": [1.0, math.nan]}, "period[1] = nan: must be a finite number greater than 0"),
        ({"phase": "anything"}, "phase = 'anything': must be 'random', a number or an array of numbers"),
        ({"phase": [-1.0]}, "phase[0] = -1.0: must be a finite number at least 0"),
        ({"drift": -1.0}, "drift = -1.0: must be a finite number greater than -1"),
        ({"jitter": -0.1}, "jitter = -0.1: must be a finite number at least 0"),
    ],
)
def test_clocks_refuse_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Clocks(**options)


@pytest.mark.parametrize("name", ["period", "phase", "drift", "jitter"])
def test_a_value_for_each_agent_must_be_one_for_each(name: str) -> None:
    with pytest.raises(InputError, match=rf"^shape of {name} = \(2,\): must be \(3,\)"):
        start(n=3, **{name: [0.5, 0.5]})


def test_jitter_must_be_less_than_the_period_with_its_drift() -> None:
    with pytest.raises(InputError, match=r"^jitter of agent 1 = 0\.6: must be less than the period, 0\.5$"):
        start(n=2, period=1.0, drift=[0.0, -0.5], jitter=0.6)
