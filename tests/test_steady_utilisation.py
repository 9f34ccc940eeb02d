"""The mean utilisation of a run without its start is exact: held against integrals made another way."""

import math
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    InputError,
    Recording,
    Result,
    Simulation,
    run_synchronous,
)
from aimd_des.dynamics.averaging import Forgetting, Window
from aimd_des.interventions import Absence, CapacityStep
from aimd_des.results.event_log import Entry
from aimd_des.study.statistics.steady_state import batch_means
from aimd_des.study.statistics.steady_utilisation import steady_utilisation
from tests.conftest import quadratic_problem, quietly

PROBLEM = quadratic_problem([1.0, 2.0, 3.0, 4.0, 5.0])
CAPACITY = PROBLEM.capacity[0]
# Two ways to add up some ten thousand numbers, each rounded by 1e-16.
ROUNDING = 1e-11


def run(
    until: float = 1000.0, dynamics: str = "continuous", seed: int = 3, *, parts: Any = None, **recording: Any
) -> Result:
    made: dict[str, Any] = {"control_unit": Crossing(0.5)} if dynamics == "continuous" else {}
    simulation = Simulation(
        PROBLEM,
        dynamics=dynamics,
        channel=BroadcastChannel(latency=0.3),
        agents=Fleet,
        seed=seed,
        recording=Recording(**{"demand": 0.5, **recording}),
        **{**made, **(parts or {})},
    )
    return quietly(simulation.run, until)  # type: ignore[no-any-return]


@pytest.mark.parametrize("period", [0.5, 0.37, 4.0])
def test_continuous_it_is_what_the_event_log_integrates(period: float) -> None:
    result = run(demand=period, events=True)
    found = steady_utilisation(result, 200.0).loc["memory"]
    begin, end = found["warm_up"], 1000.0
    assert 200.0 <= begin < 200.0 + period
    # All that grows, less what is given back, each from the instant of the response to the end.
    log = result.events
    given = log[log["kind"] == Entry.RESPOND.name.lower()]
    assert len(given) > 300
    grown = PROBLEM.increase[:, 0].sum() * (end**2 - begin**2) / 2.0
    back = (given["value"].abs() * (end - given["time"].clip(lower=begin))).sum()
    assert found["utilisation"] == pytest.approx((grown - back) / (end - begin) / CAPACITY, rel=ROUNDING)


@pytest.mark.parametrize(("period", "until"), [(0.5, 1000.0), (0.37, 1000.0), (4.0, 1000.0), (0.7, 600.4)])
def test_discrete_it_is_the_sum_over_the_ticks(period: float, until: float) -> None:
    found = steady_utilisation(run(until, "discrete", demand=period), 200.0).loc["memory"]
    begin = float(found["warm_up"])
    whole = run(until, "discrete", demand=1.0)  # the same run; x(k) is held from k - 1 to k
    seen = dict(zip(whole.observations.demand_times, whole.observations.total_demand[:, 0], strict=True))
    held = 0.0
    for k in range(math.floor(begin), math.ceil(until)):
        length = min(k + 1.0, until) - max(float(k), begin)
        held += length * seen[min(k + 1.0, until)]
    assert found["utilisation"] == pytest.approx(held / (until - begin) / CAPACITY, rel=ROUNDING)


def test_the_synchronous_algorithm_and_the_ticking_agents_agree() -> None:
    # In phase, with latency up to a period, the two are the same run.
    alone = run_synchronous(PROBLEM, steps=1000, seed=3, recording=Recording(demand=1.0))
    ticking = run(dynamics="discrete", demand=1.0)
    assert steady_utilisation(alone, 200.0).equals(steady_utilisation(ticking, 200.0))


@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_it_is_what_a_piece_integrates(dynamics: str) -> None:
    # A capacity that is set to what it is begins a piece: the way out where averages do not tell.
    step = {"interventions": [CapacityStep("memory", 200.0, CAPACITY)]}
    exact = run(dynamics=dynamics, parts=step).pieces["utilisation"].iloc[-1]
    assert steady_utilisation(run(dynamics=dynamics), 200.0).loc["memory", "utilisation"] == pytest.approx(
        exact, rel=ROUNDING
    )


def test_the_interval_is_of_means_between_looks() -> None:
    result = run(demand=1.0)
    found = steady_utilisation(result, 200.0, batches=16).loc["memory"]
    seen = result.observations
    means = np.diff(seen.demand_times * seen.total_average[:, 0]) / CAPACITY
    expected = batch_means(means, 16, leave_out=200)
    assert found["standard_error"] == pytest.approx(expected.interval.standard_error, rel=1e-9)
    assert found["correlation"] == pytest.approx(expected.correlation, rel=1e-9)
    assert found["high"] - found["utilisation"] == pytest.approx(expected.interval.half_width, rel=1e-9)


def test_a_look_at_the_end_that_comes_early_counts_for_the_mean_alone() -> None:
    # Looks at 0, 4, ..., 996 and at 997: the last is too short to stand beside the others.
    result = run(997.0, demand=4.0)
    found = steady_utilisation(result, 200.0).loc["memory"]
    integrals = result.observations.demand_times * result.observations.total_average[:, 0] / CAPACITY
    assert found["utilisation"] == pytest.approx((integrals[-1] - integrals[50]) / 797.0, rel=ROUNDING)
    expected = batch_means(np.diff(integrals[:-1]) / 4.0, leave_out=50).interval
    assert found["standard_error"] == pytest.approx(expected.standard_error, rel=1e-9)


def test_growth_from_nothing_is_found_and_matters() -> None:
    result = run(demand=1.0)
    found = steady_utilisation(result).loc["memory"]
    rise = CAPACITY / PROBLEM.increase[:, 0].sum()  # until the first signal
    assert rise - 5.0 <= found["warm_up"] < 100.0
    # Negative control: with the start the mean is lower by half the rise, more than the interval reaches.
    whole = result.observations.total_average[-1, 0] / CAPACITY
    assert found["utilisation"] - whole == pytest.approx(rise / 2.0 / 1000.0, rel=0.2)
    assert not found["low"] < whole


def test_a_run_that_is_too_short_to_settle_has_no_steady_state() -> None:
    assert steady_utilisation(run(26.0)).isna().all(axis=None)


@pytest.mark.slow
def test_its_interval_holds_the_truth_as_often_as_it_says() -> None:
    # 200 runs: a coverage of 95 % has a standard error of 1.5 %. The truth comes from 140 times as much as
    # each of them has, and is off by a twelfth of their standard error: that takes 0.1 % off the coverage.
    long = [steady_utilisation(run(30_000.0, seed=1000 + k, demand=50.0), 300.0) for k in range(8)]
    truth = np.mean([found.loc["memory", "utilisation"] for found in long])
    rows = [steady_utilisation(run(2000.0, seed=k, demand=1.0), 300.0).loc["memory"] for k in range(200)]
    assert np.mean([row["low"] <= truth <= row["high"] for row in rows]) == pytest.approx(
        0.95, abs=3 * 0.0154
    )


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (lambda: run(parts={"averaging": Window(300.0)}), "deviation of averages from the integral"),
        (lambda: run(parts={"averaging": Forgetting(1e6)}), "deviation of averages from the integral"),
        (lambda: run(dynamics="discrete", parts={"clocks": Clocks(period=2.0)}), "deviation of averages"),
        (lambda: run(dynamics="discrete", parts={"clocks": Clocks(phase="random")}), "deviation of averages"),
        (
            lambda: run(parts={"interventions": [CapacityStep("memory", 5.0, 3.0)]}),
            "number of pieces = 2: must be 1.*result.pieces",
        ),
        (
            lambda: run(parts={"interventions": [Absence([0], 5.0, 9.0)]}),
            "number of pieces = 3: must be 1.*result.pieces",
        ),
        (lambda: run(overshoot=False), "exact integrals of the run = 'missing'.*overshoot=True"),
        (
            lambda: run(demand=5.0, tail=20),
            "longest over shortest time between totals = 5.0: must be at most 2.5",
        ),
        (lambda: run(demand="end"), "length of series = 1: must be 50 or more; look more often"),
    ],
)
def test_where_averages_do_not_tell_it_is_refused(result: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        steady_utilisation(result())


def test_a_window_longer_than_the_run_is_an_average_over_all_of_the_past() -> None:
    # Negative control of the check: what it lets through is the same, to the last digits.
    wide = steady_utilisation(run(parts={"averaging": Window(2000.0)}), 200.0)
    assert wide.equals(steady_utilisation(run(), 200.0))


def test_a_warm_up_that_leaves_nothing_is_refused() -> None:
    result = run(100.0)
    with pytest.raises(InputError, match=r"^warm_up = 100.0: must be .* less than 100"):
        steady_utilisation(result, 100.0)
    with pytest.raises(InputError, match=r"^batches = 1: must be an integer of at least 2"):
        steady_utilisation(result, batches=1)
    with pytest.raises(
        InputError, match=r"^number of totals after the warm-up = 10: must be 20 or more.*shorter"
    ):
        steady_utilisation(result, 95.0)
