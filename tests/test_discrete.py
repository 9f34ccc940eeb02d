"""The synchronous algorithm beside a plain reading of the paper's Algorithms 1 and 2, step by step."""

import math
import re
import signal
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from aimd_des import InputError, Problem, Recording, run_synchronous
from aimd_des.utils.rng import Purpose
from models import smart_cameras
from tests.conftest import (
    as_custom,
    assert_same_run,
    problems,
    quadratic_problem,
    quietly,
    random_problem,
    reference_draws,
    signals_of,
)
from tests.support.reference_synchronous import step_by_step


@given(problems(), st.integers(1, 60), st.integers(0, 2**32), st.sampled_from([0, 1]))
def test_it_is_the_paper_step_by_step(problem: Problem, steps: int, seed: int, lag: int) -> None:
    paper = step_by_step(problem, steps, seed, lag)
    assume(paper.margin > 1e-9)  # no decision hangs on the last bits of a float
    every_step = Recording(demand=1.0, allocations=1.0)
    result = quietly(run_synchronous, problem, steps=steps, seed=seed, lag=lag, recording=every_step)
    assert signals_of(result) == paper.signals
    assert result.account.responses.sum() == paper.responses
    assert result.account.saturated.sum() == paper.saturated
    seen = result.observations
    assert seen.allocation_times.tolist() == list(range(steps + 1))
    for ours, theirs in ((seen.demand, paper.demand), (seen.average, paper.average)):
        np.testing.assert_allclose(
            ours.transpose(0, 2, 1), theirs, rtol=1e-9, atol=1e-9 * problem.capacity.min()
        )
    np.testing.assert_allclose(seen.total_demand, np.sum(paper.demand, axis=1), rtol=1e-9)
    np.testing.assert_allclose(seen.total_average, np.sum(paper.average, axis=1), rtol=1e-9)


def test_random_problems_are_no_idle_ones() -> None:
    """Were there no signals, no responses or no saturation, the test above would show little."""
    runs = [step_by_step(random_problem(seed, 5, 2), 60, seed, 1) for seed in range(40)]
    assert sum(len(run.signals) > 10 for run in runs) >= 36
    assert sum(run.responses > 20 for run in runs) >= 36
    assert sum(run.saturated > 0 for run in runs) >= 1
    assert sum(run.margin > 1e-9 for run in runs) >= 36


@given(problems(("polynomial", "coupled", "custom")), st.integers(2, 50), st.integers(0, 1), st.data())
def test_a_shorter_run_is_the_beginning_of_a_longer_one(
    problem: Problem, steps: int, lag: int, data: st.DataObject
) -> None:
    k = data.draw(st.integers(1, steps - 1))
    watching = Recording(demand=[float(k)], allocations=[float(k)])
    long = quietly(run_synchronous, problem, steps=steps, seed=3, lag=lag, recording=watching)
    short = quietly(run_synchronous, problem, steps=k, seed=3, lag=lag)
    assert signals_of(short) == [signal for signal in signals_of(long) if signal[0] < k]
    assert np.array_equal(long.observations.demand[0], short.observations.demand[-1])
    assert np.array_equal(long.observations.average[0], short.observations.average[-1])
    assert np.array_equal(long.observations.total_demand[0], short.observations.total_demand[-1])
    assert np.array_equal(long.observations.total_average[0], short.observations.total_average[-1])


@given(
    st.integers(0, 2**32 - 1),
    st.one_of(st.integers(1, 5), st.just(37)),  # more than a pass along agents, and no whole number of them
    st.integers(1, 3),
    st.integers(0, 1),
)
def test_costs_from_functions_give_the_run_of_the_family_that_they_wrap(
    seed: int, n: int, m: int, lag: int
) -> None:
    problem = random_problem(seed, n, m, threshold=True)
    wrapped = Problem(problem.resources, as_custom(problem.costs))
    every_step = Recording(demand=1.0, allocations=1.0)
    one, other = (
        quietly(run_synchronous, each, steps=50, seed=seed, lag=lag, recording=every_step)
        for each in (problem, wrapped)
    )
    assert_same_run(one, other)


@given(problems(("polynomial", "coupled")), st.integers(1, 60), st.integers(0, 1))
def test_overshoot_is_what_the_totals_of_every_step_give(problem: Problem, steps: int, lag: int) -> None:
    result = quietly(run_synchronous, problem, steps=steps, seed=0, lag=lag, recording=Recording(demand=1.0))
    totals = result.observations.total_demand
    assert len(totals) == steps + 1
    for j, capacity in enumerate(problem.capacity):
        excess = [max(total - capacity, 0.0) for total in totals[1:, j]]  # x(k) is held over (k - 1, k]
        overshoot = result.observations.overshoot
        assert overshoot.peak[j] == totals[:, j].max() / capacity
        assert overshoot.time[j] == sum(value > 0 for value in excess) / steps
        assert overshoot.mean[j] == pytest.approx(math.fsum(excess) / steps / capacity, rel=1e-12)


def binary_problem(**changes: Any) -> Problem:
    """Four agents whose demands are sums of quarters, so that totals are exact."""
    return quadratic_problem([1.0, 2.0, 3.0, 4.0], **{"capacity": 8.0, "increase": 0.25, **changes})


def test_demand_at_the_capacity_is_no_excess() -> None:
    # The total is k: 8 at k = 8 is not above the capacity, 9 at k = 9 is.
    totals = run_synchronous(binary_problem(), steps=10, seed=0, recording=Recording(demand=1.0))
    assert totals.observations.total_demand[:10, 0].tolist() == [float(k) for k in range(10)]
    assert signals_of(totals)[0] == (9.0, 0, 0)


def test_a_threshold_below_one_brings_signals_before_the_capacity() -> None:
    result = run_synchronous(binary_problem(threshold=0.75), steps=10, seed=0)
    assert signals_of(result)[0] == (7.0, 0, 0)  # 0.75 * 8 = 6 is not above 6, 7 is


def test_with_the_lag_a_signal_acts_one_step_after_the_excess() -> None:
    # All respond for certain and give everything back: lambda = 2 Gamma c >= 1 for the smallest c.
    problem = binary_problem(decrease=0.0, normalization=0.5)
    every_step = Recording(demand=1.0)
    lagged, at_once = (
        quietly(run_synchronous, problem, steps=13, seed=0, lag=lag, recording=every_step) for lag in (1, 0)
    )
    rise = [float(k) for k in range(10)]
    # x(9) = 9 is seen at 9; at 9 the agents still grow, at 10 they act on it; 10 is above the capacity, too.
    assert lagged.observations.total_demand[:, 0].tolist() == [*rise, 10.0, 0.0, 0.0, 1.0]
    assert [time for time, _, _ in signals_of(lagged)] == [9.0, 10.0]
    assert at_once.observations.total_demand[:, 0].tolist() == [*rise, 0.0, 1.0, 2.0, 3.0]
    assert [time for time, _, _ in signals_of(at_once)] == [9.0]


def test_nobody_responds_with_probability_zero_and_everybody_holds() -> None:
    problem = binary_problem(normalization=1e-300)
    result = run_synchronous(problem, steps=50, seed=0, recording=Recording(demand=1.0))
    assert result.account.responses.sum() == 0
    # Growth ends with the first signal in force, at k = 10.
    assert result.observations.total_demand[10:, 0].tolist() == [10.0] * 41


def test_one_agent_alone() -> None:
    problem = quadratic_problem([1.0], capacity=1.0, increase=0.3, decrease=0.5, normalization=0.3)
    result = run_synchronous(problem, steps=200, seed=1, recording=Recording(allocations=1.0))
    paper = step_by_step(problem, 200, 1, 1)
    assert signals_of(result) == paper.signals
    assert len(paper.signals) > 20
    np.testing.assert_allclose(
        result.observations.average[:, 0, 0], np.array(paper.average)[:, 0, 0], rtol=1e-9
    )
    assert result.demand_at_end.shape == result.average_at_end.shape == (1, 1)


def test_every_copy_of_every_signal_arrives() -> None:
    result = run_synchronous(random_problem(4, 5, 3), steps=60, seed=0)
    summary = result.summary()
    assert summary["signals"].sum() > 10
    assert (summary["delivered"] == 5 * summary["signals"]).all()
    assert (summary[["lost", "in_flight"]] == 0).all(axis=None)


def test_saturated_responses_are_counted_and_warned_about_once() -> None:
    # lambda is 0.5 for the first agent and 1.5 for the second, whatever the averages.
    problem = quadratic_problem([1.0, 3.0], capacity=1.0, increase=0.03, normalization=0.25)
    with pytest.warns(RuntimeWarning) as caught:
        result = run_synchronous(problem, steps=400, seed=0)
    assert len(caught) == 1
    acted = len([time for time, _, _ in signals_of(result) if time < 399])
    assert acted > 20
    assert result.account.saturated.tolist() == [[0, acted]]
    assert result.account.responses[0, 1] == acted
    assert 0 < result.account.responses[0, 0] < acted
    total = result.account.responses.sum()
    assert str(caught[0].message) == (
        f"{acted} of {total} responses had a probability above 1, which was cut off: "
        "the normalization factor is too large for these costs"
    )


def test_a_probability_of_one_is_not_above_one() -> None:
    # lambda = 2 * 0.5 * 1 = 1 up to rounding of x-bar / x-bar, which is exact.
    problem = quadratic_problem([1.0], capacity=1.0, increase=0.25, normalization=0.5)
    result = run_synchronous(problem, steps=100, seed=0)
    assert result.account.saturated.sum() == 0
    assert result.account.responses.sum() == len([time for time, _, _ in signals_of(result) if time < 99])


@pytest.mark.parametrize("demand", [[6.0], "end"])
def test_allocations_may_be_looked_at_before_totals(demand: Any) -> None:
    """Two agents add 1 in each step and never reach the capacity: at step k each holds k."""
    problem = quadratic_problem([1.0, 1.0], capacity=1e6, increase=1.0)
    result = run_synchronous(
        problem, steps=9, seed=1, recording=Recording(demand=demand, allocations=[0.0, 2.0, 5.0])
    )
    seen = result.observations
    assert seen.demand[:, 0, :].tolist() == [[0.0] * 2, [2.0] * 2, [5.0] * 2, [9.0] * 2]
    assert seen.average[:, 0, :].tolist() == [[0.0] * 2, [1.0] * 2, [2.5] * 2, [4.5] * 2]


def test_the_same_seed_gives_the_same_run_and_another_another() -> None:
    problem = random_problem(1, 6, 2)
    runs = [quietly(run_synchronous, problem, steps=80, seed=seed) for seed in (5, 5, 6)]
    assert_same_run(runs[0], runs[1])
    assert runs[0].digest != runs[2].digest


def test_an_agent_more_does_not_change_the_luck_of_the_others() -> None:
    # Cost factors make lambda constant, so that who responds depends on the draws alone.
    few, many = [1.0, 4.0, 2.0], [1.0, 4.0, 2.0, 3.0]
    one = run_synchronous(quadratic_problem(few, capacity=3.0, normalization=0.1), steps=400, seed=2)
    other = run_synchronous(quadratic_problem(many, capacity=4.0, normalization=0.1), steps=400, seed=2)
    draws = np.array([reference_draws(2, Purpose.RESPONSE, 0, b, 4) for b in range(1000)])
    for result, factors in ((one, few), (other, many)):
        acted = len([time for time, _, _ in signals_of(result) if time < 399])
        expected = (draws[:acted, : len(factors)] < 0.2 * np.array(factors)).sum(axis=0)
        assert acted > 20
        assert result.account.responses[0].tolist() == expected.tolist()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 0}, "steps = 0: must be an integer of at least 1"),
        ({"steps": 2.0}, "steps = 2.0: must be an integer of at least 1"),
        ({"steps": True}, "steps = True: must be an integer of at least 1"),
        ({"lag": 2}, "lag = 2: must be an integer of at least 0 and at most 1"),
        ({"lag": -1}, "lag = -1: must be an integer of at least 0 and at most 1"),
        ({"seed": "a"}, "seed = 'a': must be an integer of at least 0"),
        ({"seed": -1}, "seed = -1: must be an integer of at least 0"),
        ({"seed": 0.5}, "seed = 0.5: must be an integer of at least 0"),
        ({"recording": Recording(demand=0.5)}, "demand = 0.5: must be whole numbers: the discrete algorithm"),
        (
            {"recording": Recording(allocations=[1.0, 11.0])},
            "allocations = 11.0: must be times of at most 10",
        ),
    ],
)
def test_it_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        run_synchronous(binary_problem(), **{"steps": 10, "seed": 0, **options})


def test_a_run_does_not_change_its_problem() -> None:
    problem = random_problem(0, 3, 2)
    names = ("capacity", "limit", "normalization", "increase", "decrease")
    before = {name: getattr(problem, name).copy() for name in names}
    quietly(run_synchronous, problem, steps=300, seed=0)
    assert all(np.array_equal(getattr(problem, name), value) for name, value in before.items())


def test_an_event_log_is_refused_where_there_are_no_events() -> None:
    message = r"^recording\.events = True: must be False: the synchronous algorithm has no events$"
    with pytest.raises(InputError, match=message):
        run_synchronous(smart_cameras(n_cameras=3), steps=5, seed=0, recording=Recording(events=True))


def test_steps_taken_in_blocks_are_the_same_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = random_problem(3, 5, 2)
    recording = Recording(demand=7.0, allocations=11.0)
    whole = quietly(run_synchronous, problem, steps=1000, seed=4, recording=recording)
    for entries in (1, 10 * 37, 10 * 500):
        monkeypatch.setattr("aimd_des.synchronous.run_in_steps._IN_ONE_GO", entries)
        assert_same_run(quietly(run_synchronous, problem, steps=1000, seed=4, recording=recording), whole)
    assert (
        whole.signals.groupby("resource", observed=True)["number"]
        .apply(lambda b: list(b) == [*range(len(b))])
        .all()
    )


class PressedError(Exception):
    """Raised as Ctrl-C raises: from a handler of signals."""


def test_many_steps_can_be_interrupted() -> None:
    problem = quadratic_problem([1.0, 2.0], increase=1e-9)
    run_synchronous(problem, steps=10, seed=0)  # what is compiled is no part of it

    def press(*_: object) -> None:
        raise PressedError

    earlier = signal.signal(signal.SIGALRM, press)
    try:
        began = time.monotonic()
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(PressedError):
            run_synchronous(problem, steps=10**9, seed=0)
        assert time.monotonic() - began < 5.0
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, earlier)


def test_steps_whose_signals_have_no_room_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"^steps = 10{15}: must be less: a byte for each step and resource would"
    ):
        run_synchronous(quadratic_problem([1.0]), steps=10**15, seed=0)
