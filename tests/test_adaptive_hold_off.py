"""The hold-off that adapts: doubled while nobody answers, halved where answers did not suffice."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import BroadcastChannel, Crossing, Fleet, InputError, Problem, Result, Simulation, latency
from aimd_des.engine.control_unit.crossing import adapted
from aimd_des.interventions import Absence, Join
from tests.conftest import assert_same_run, problems, quadratic_problem, quietly, signals_of
from tests.support.scripts import Script

NEVER = [math.inf, math.inf]
CERTAIN = {"normalization": 0.5}  # with a factor of 1 in the costs: everybody responds to every signal


def run(problem: Problem, until: float, unit: Crossing, channel: Any, **parts: Any) -> Result:
    parts = {"dynamics": "continuous", "seed": 0, **parts}
    return quietly(Simulation(problem, control_unit=unit, channel=channel, **parts).run, until)


def times(result: Result) -> list[float]:
    return [time for time, _, _ in signals_of(result)]


def two(decrease: float = 0.5) -> Problem:
    """Two agents that add 0.5: the total is t until somebody answers, and the limit 8."""
    return quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, decrease=decrease, **CERTAIN)


# -- the rule --------------------------------------------------------------------------------------------


@given(st.floats(0.01, 4.0), st.floats(0.0, 1.0), st.floats(1.0, 50.0))
def test_the_rule_doubles_without_an_answer_and_halves_with_one(
    hold_off: float, part: float, expected: float
) -> None:
    assert adapted(hold_off, 0.01, 100.0, expected, expected) == 2.0 * hold_off
    assert adapted(hold_off, 0.01, 3.0, expected, expected) == min(2.0 * hold_off, 3.0)
    answered = expected * (1.0 - 1e-6) * part
    assert adapted(hold_off, 0.001, 3.0, expected, answered) == 0.5 * hold_off
    assert adapted(hold_off, 0.01, 3.0, expected, answered) == max(0.5 * hold_off, 0.01)


def test_rounding_is_nobodys_answer() -> None:
    assert adapted(1.0, 0.1, 8.0, 32.0, np.nextafter(32.0, 0.0)) == 2.0
    assert adapted(1.0, 0.1, 8.0, 32.0, 32.0 - 1e-10) == 2.0
    assert adapted(1.0, 0.1, 8.0, 32.0, 32.0 - 1e-6) == 0.5
    assert adapted(1.0, 0.1, 8.0, 32.0, 33.0) == 2.0  # somebody was given more from outside


# -- in a run --------------------------------------------------------------------------------------------


BOTH = pytest.mark.parametrize("agents", [{}, {"agents": Fleet}], ids=["processes", "fleet"])


@BOTH
def test_while_nobody_answers_the_hold_off_doubles_up_to_the_longest(agents: dict[str, Any]) -> None:
    unit = Crossing(0.5, longest_hold_off=3.0)
    found = times(run(two(), 20.0, unit, BroadcastChannel(loss=1.0), **agents))
    # Held off for 0.5, then 1, 2, and 3 from there on.
    assert found == [8.0, 8.5, 9.5, 11.5, 14.5, 17.5]


@BOTH
def test_answers_that_do_not_suffice_halve_it_down_to_the_shortest(agents: dict[str, Any]) -> None:
    # Nobody hears the first four, so that the hold-off grows to 4; demand is 15.5 at 15.5. From then on each
    # signal takes a tenth at once, and leaves more than 8: the hold-off is 4, 2, 1, 0.5, and stays there.
    unit = Crossing(0.5, longest_hold_off=4.0)
    heard = [15.5, 19.5, 21.5, 22.5, 23.0, 23.5]
    channel = Script(*[NEVER] * 4, *[[time, time] for time in heard])
    found = times(run(two(0.9), 23.75, unit, channel, **agents))
    assert found == [8.0, 8.5, 9.5, 11.5, *heard]


@BOTH
def test_it_is_kept_from_one_crossing_to_the_next(agents: dict[str, Any]) -> None:
    # Lost at 8 and 8.5; heard at 9.5: the total falls from 9.5 to 4.75, and is back at 8 at 12.75. What is
    # sent there is lost, and the hold-off is 2, as it was.
    unit = Crossing(0.5, longest_hold_off=8.0)
    channel = Script(NEVER, NEVER, [9.5, 9.5], *[NEVER] * 9)
    found = times(run(two(), 15.0, unit, channel, **agents))
    assert found == [8.0, 8.5, 9.5, 12.75, 14.75]


@BOTH
def test_an_agent_that_comes_or_goes_is_no_answer(agents: dict[str, Any]) -> None:
    lost, unit = BroadcastChannel(loss=1.0), Crossing(0.5, longest_hold_off=8.0)
    # The total is t, and from 8.25 on it grows by 1.5: at 8.5 it is less than if it had always done so.
    joined = quadratic_problem([1.0] * 3, capacity=8.0, increase=0.5)
    found = times(run(joined, 14.0, unit, lost, interventions=[Join(2, 8.25)], **agents))
    assert found == [8.0, 8.5, 9.5, 11.5]
    # The total is 1.5 t, falls from 12 to 8 at 8, and is 9.5 at 9.5.
    left = quadratic_problem([1.0] * 3, capacity=9.0, increase=0.5)
    found = times(run(left, 14.0, unit, lost, interventions=[Absence(2, 8.0)], **agents))
    assert found == [6.0, 6.5, 7.5, 9.5, 13.5]


@pytest.mark.parametrize("value", [0.25, 1.0])
@settings(max_examples=15)
@given(problem=problems(("polynomial",)), seed=st.integers(0, 2**32))
def test_without_room_to_adapt_it_is_the_plain_one(value: float, problem: Problem, seed: int) -> None:
    channel = BroadcastChannel(latency=0.5, loss=0.3)
    plain, bounded = (
        run(problem, 20.0, unit, channel, seed=seed)
        for unit in (Crossing(value), Crossing(value, longest_hold_off=value))
    )
    assert_same_run(plain, bounded)


def test_the_plain_one_does_not_adapt() -> None:
    assert times(run(two(), 11.0, Crossing(0.5), BroadcastChannel(loss=1.0))) == [
        8.0,
        8.5,
        9.0,
        9.5,
        10.0,
        10.5,
    ]
    assert Crossing(0.5).longest_hold_off is None
    assert Crossing(0.5).bounds == (0.5, 0.5)
    assert Crossing(0.5, longest_hold_off=4.0).bounds == (0.5, 4.0)


@settings(max_examples=15)
@given(
    problems(("polynomial",)),
    st.integers(0, 2**32),
    st.sampled_from([0.0, 1.5, latency.Exponential(1.0)]),
    st.sampled_from([0.0, 0.4, 1.0]),
)
def test_signals_keep_the_bounds_and_a_fleet_does_what_processes_do(
    problem: Problem, seed: int, late: Any, lost: float
) -> None:
    channel, unit = BroadcastChannel(latency=late, loss=lost), Crossing(0.3, longest_hold_off=2.0)
    processes, fleet = (
        run(problem, 25.0, unit, channel, seed=seed, **agents) for agents in ({}, {"agents": Fleet})
    )
    assert_same_run(processes, fleet)
    for j in range(problem.n_resources):
        own = [time for time, resource, _ in signals_of(processes) if resource == j]
        assert all(one + 0.3 <= other for one, other in pairwise(own))
        if lost == 1.0:  # demand stays above: the longest is the longest
            assert all(other - one <= 2.0 + 1e-9 for one, other in pairwise(own))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Crossing(0.0, longest_hold_off=1.0), r"hold_off = 0\.0.*greater than 0.*cannot be doubled"),
        (lambda: Crossing(1.0, longest_hold_off=0.5), r"longest_hold_off = 0\.5.*at least 1"),
        (lambda: Crossing(1.0, longest_hold_off=math.inf), "longest_hold_off = inf"),
        (lambda: Crossing(1.0, longest_hold_off=True), "longest_hold_off = True"),
    ],
)
def test_bounds_that_make_no_sense_are_refused(make: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()
