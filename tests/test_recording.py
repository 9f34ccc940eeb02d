"""When observers look, and how signals are counted."""

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import InputError, Recording, run_synchronous
from aimd_des.results.run_data import Signals
from tests.conftest import quadratic_problem


def times(until: float, *, whole: bool = False, name: Any = "demand", **options: Any) -> list[float]:
    return [float(time) for time in Recording(**options).times(name, until, whole=whole)]


def test_at_the_end_means_at_the_end() -> None:
    assert times(7.5, demand="end") == [7.5]
    assert times(7.0, demand="end", whole=True) == [7.0]


def test_auto_is_a_thousand_times_and_the_end() -> None:
    assert times(10.0, demand="auto") == pytest.approx([0.01 * q for q in range(1001)])
    assert times(3000.0, demand="auto") == [3.0 * q for q in range(1001)]


@pytest.mark.parametrize("whole", [False, True])
def test_auto_is_at_whole_times_where_the_run_is_long(whole: bool) -> None:
    looks = times(2500.0, demand="auto", whole=whole)
    assert len(looks) == 1001
    assert set(np.diff(looks)) == {2.0, 3.0}
    assert (looks[0], looks[-1]) == (0.0, 2500.0)


def test_auto_is_at_every_step_where_there_are_few() -> None:
    assert times(5, demand="auto", whole=True) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("period", "until", "looks"),
    [
        (0.1, 1.0, [0.1 * q for q in range(10)] + [1.0]),
        (0.1, 0.25, [0.0, 0.1, 0.2, 0.25]),
        (2.5, 5.0, [0.0, 2.5, 5.0]),
        (7, 5.0, [0.0, 5.0]),
    ],
)
def test_a_period_is_counted_from_zero_without_drift(period: float, until: float, looks: list[float]) -> None:
    assert times(until, demand=period) == looks


@given(st.floats(1e-3, 1e3), st.integers(1, 500))
def test_a_period_that_divides_the_run_gives_no_look_twice(period: float, ticks: int) -> None:
    looks = times(period * ticks, demand=period)
    assert len(looks) == ticks + 1
    assert (np.diff(looks) > 0.5 * period).all()
    assert looks[-1] == period * ticks


def test_times_are_kept_as_given_and_the_end_is_added() -> None:
    assert times(9.0, demand=[0.25, 3.0]) == [0.25, 3.0, 9.0]
    assert times(9.0, demand=np.array([1, 9])) == [1.0, 9.0]
    assert times(9.0, demand=[]) == [9.0]


def test_demand_and_allocations_are_apart() -> None:
    options = {"demand": "end", "allocations": [2.0]}
    assert times(4.0, **options) == [4.0]
    assert times(4.0, name="allocations", **options) == [2.0, 4.0]


@pytest.mark.parametrize(
    ("tail", "until", "looks"),
    [(3, 10.0, [7.0, 8.0, 9.0, 10.0]), (2, 2.5, [0.5, 1.5, 2.5]), (100, 2.0, [0.0, 1.0, 2.0])],
)
def test_the_tail_is_seen_at_every_unit_of_time(tail: int, until: float, looks: list[float]) -> None:
    for name in ("demand", "allocations"):
        assert times(until, name=name, demand="end", allocations="end", tail=tail) == looks
    assert times(10.0, demand=[0.0, 8.0], tail=1) == [0.0, 8.0, 9.0, 10.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"demand": "often"}, "demand = 'often': must be 'auto', 'end', a period or an array of times"),
        ({"allocations": "auto "}, "allocations = 'auto ': must be 'auto', 'end', a period"),
        ({"demand": 0.0}, "demand = 0.0: must be a finite number greater than 0"),
        ({"demand": -1}, "demand = -1.0: must be a finite number greater than 0"),
        ({"demand": math.nan}, "demand = nan: must be a finite number greater than 0"),
        ({"demand": None}, "demand = None: must be a finite number greater than 0"),
        ({"demand": True}, "demand = True: must be a finite number greater than 0"),
        ({"demand": [1.0, 1.0]}, "demand = [1.0, 1.0]: must be strictly ascending times"),
        ({"demand": [2.0, 1.0]}, "demand = [2.0, 1.0]: must be strictly ascending times"),
        ({"demand": [-1.0]}, "demand[0] = -1.0: must be a finite number at least 0"),
        ({"demand": [0.0, math.nan]}, "demand[1] = nan: must be a finite number at least 0"),
        ({"demand": ["a"]}, "demand = ['a']: must be an array of numbers of shape (n_times,)"),
        ({"demand": [[1.0]]}, "shape of demand = (1, 1): must be (n_times,)"),
        ({"tail": -1}, "tail = -1: must be an integer of at least 0"),
        ({"tail": 2.0}, "tail = 2.0: must be an integer of at least 0"),
    ],
)
def test_it_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Recording(**options)


def test_a_ragged_list_of_times_is_refused() -> None:
    with pytest.raises(InputError, match="demand"):
        Recording(demand=[[1.0], [1.0, 2.0]])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("options", "whole", "message"),
    [
        ({"demand": [1.0, 5.5]}, False, "demand = 5.5: must be times of at most 5, the end of the run"),
        ({"allocations": [6.0]}, True, "allocations = 6.0: must be times of at most 5, the end of the run"),
        ({"demand": [1.0, 2.5]}, True, "demand = 2.5: must be whole numbers: the discrete algorithm has no"),
        ({"allocations": 0.75}, True, "allocations = 0.75: must be whole numbers"),
    ],
)
def test_times_that_the_run_does_not_have_are_refused(
    options: dict[str, Any], whole: bool, message: str
) -> None:
    (name,) = options
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        times(5.0, name=name, whole=whole, **options)


def test_what_is_recorded_does_not_change_the_run() -> None:
    problem = quadratic_problem([1.0, 2.0, 3.0], capacity=1.0)
    options = [{}, {"demand": "end"}, {"demand": 1.0, "allocations": 1.0}, {"tail": 20}, {"demand": [3.0]}]
    runs = [run_synchronous(problem, steps=100, seed=0, recording=Recording(**each)) for each in options]
    assert len({run.digest for run in runs}) == 1
    assert [len(run.observations.demand_times) for run in runs] == [101, 1, 101, 101, 2]
    assert [len(run.observations.allocation_times) for run in runs] == [1, 1, 101, 21, 1]


def test_signals_are_counted_for_every_resource() -> None:
    resource = np.array([2, 0, 2, 2])
    signals = Signals(np.arange(4.0), resource, np.array([0, 0, 1, 2]))
    assert signals.counts(4).tolist() == [1, 0, 3, 0]
    nothing = np.zeros(0, dtype=np.int64)
    assert Signals(np.zeros(0), nothing, nothing).counts(2).tolist() == [0, 0]
