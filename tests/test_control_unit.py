"""When the control unit broadcasts: at looks, or at the very instant at which the threshold is reached."""

import math
import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    SimulationError,
    latency,
)
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from tests.conftest import problems, quadratic_problem, quietly, random_problem, resource
from tests.support.scripts import Script

CERTAIN = {"normalization": 0.5}  # with a factor of 1 in the costs: everybody responds to every signal


def run(
    problem: Problem, until: float, control_unit: Any, channel: dict[str, Any] | None = None, **parts: Any
) -> Result:
    parts = {"dynamics": "continuous", "seed": 0, "recording": Recording(events=True), **parts}
    carrier = BroadcastChannel(**(channel or {}))
    return quietly(Simulation(problem, control_unit=control_unit, channel=carrier, **parts).run, until)


def times_of(result: Result, j: int = 0) -> list[float]:
    sent = result.signals_sent
    return [float(time) for time in sent.time[sent.resource == j]]


def arrivals_of(result: Result, agent: str = "0") -> list[float]:
    events = result.events
    return [
        float(time) for time in events["time"][(events["kind"] == "deliver") & (events["agent"] == agent)]
    ]


# -- the instant of a crossing ---------------------------------------------------------------------------


@given(problems(("polynomial", "coupled")), st.integers(0, 2**32), st.sampled_from([0.0, 0.3, 1.0]))
def test_the_first_signal_is_at_the_limit_over_the_slope(
    problem: Problem, seed: int, hold_off: float
) -> None:
    first = problem.limit / problem.increase.sum(axis=0)
    result = run(problem, 1.01 * float(first.max()), Crossing(hold_off), seed=seed)
    for j, time in enumerate(first):
        assert times_of(result, j)[0] == pytest.approx(time, rel=1e-12)


@given(problems(("polynomial", "coupled")), st.integers(0, 2**32))
def test_without_latency_and_hold_off_no_total_exceeds_its_limit(problem: Problem, seed: int) -> None:
    result = run(problem, 25.0, Crossing(0.0), seed=seed)
    entries = result.events[result.events["kind"] == "signal"]
    limit = problem.limit[entries["resource"].cat.codes]
    np.testing.assert_allclose(entries["value"], limit, rtol=1e-12)
    peak = result.observations.overshoot.peak * problem.capacity
    crossed = np.isin(np.arange(problem.n_resources), result.signals_sent.resource)
    np.testing.assert_allclose(peak[crossed], problem.limit[crossed], rtol=1e-12)
    assert (peak[~crossed] < problem.limit[~crossed]).all()


def test_synchronised_agents_cross_with_the_period_of_theory() -> None:
    # All respond: the total falls to beta C and needs (1 - beta) C / (n alpha) to come back.
    problem = quadratic_problem([1.0] * 3, capacity=6.0, increase=0.1, decrease=0.25, **CERTAIN)
    result = run(problem, 200.0, Crossing(1.0))
    expected = 20.0 + 15.0 * np.arange(12)
    np.testing.assert_allclose(times_of(result), expected[expected < 200.0], rtol=1e-12)
    np.testing.assert_allclose(result.observations.overshoot.peak, 1.0, rtol=1e-12)
    # The last period is cut short: 20 units from 0 to 6, then 12 periods of mean (1 + beta) C / 2.
    assert len(times_of(result)) == 12
    assert result.observations.total_average[-1, 0] == pytest.approx((60.0 + 12 * 15.0 * 3.75) / 200.0)


@pytest.mark.parametrize("delay", [0.5, 1.75])
def test_a_latency_common_to_all_lifts_every_peak_by_the_growth_on_the_way(delay: float) -> None:
    # The crossing is noted at once, the response comes `delay` later: peak C + n alpha d.
    problem = quadratic_problem([1.0] * 3, capacity=6.0, increase=0.1, decrease=0.25, **CERTAIN)
    result = run(problem, 200.0, Crossing(2.0), {"latency": delay})
    peak = 6.0 + 0.3 * delay
    np.testing.assert_allclose(result.observations.overshoot.peak, peak / 6.0, rtol=1e-12)
    # From beta times the peak back to the limit, and the latency: the time between two signals.
    period = delay + (6.0 - 0.25 * peak) / 0.3
    np.testing.assert_allclose(np.diff(times_of(result)), period, rtol=1e-9)
    assert len(times_of(result)) > 10


def test_each_resource_is_sensed_for_itself() -> None:
    pair = [
        resource("memory", capacity=4.0, increase=0.5, decrease=0.5, **CERTAIN),
        resource("disk", capacity=3.0, increase=0.25, decrease=0.5, **CERTAIN),
    ]
    both = Problem(pair, PolynomialCosts([2], [[[1.0], [1.0]]]))
    result = run(both, 40.0, Crossing(1.0))
    for j in range(2):
        alone = run(Problem([pair[j]], PolynomialCosts([2], [[[1.0]]])), 40.0, Crossing(1.0))
        assert times_of(result, j) == times_of(alone)
    assert times_of(result, 0)[:3] == [8.0, 12.0, 16.0]
    assert times_of(result, 1)[:3] == [12.0, 18.0, 24.0]


def test_resources_that_cross_at_one_instant_signal_in_their_order() -> None:
    names = ["memory", "disk", "bandwidth"]
    three = [resource(name, capacity=4.0, increase=0.5, decrease=0.5, **CERTAIN) for name in names]
    problem = Problem(three, PolynomialCosts([2], [[[1.0]] * 3]))
    sent = run(problem, 40.0, Crossing(1.0)).signals
    assert sent["time"].tolist() == [float(time) for time in range(8, 40, 4) for _ in range(3)]
    assert sent["resource"].tolist() == names * 8


def test_a_demand_that_is_lowered_from_outside_puts_the_crossing_off() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)

    def lower(system: System) -> ProcessGenerator:
        yield system.env.at(4.0, EventKind.INTERVENE)
        system.set_demand(0, 0, 0.5)

    assert times_of(run(problem, 9.0, Crossing(1.0))) == [8.0]
    assert times_of(run(problem, 10.0, Crossing(1.0), processes=[lower])) == [9.5]


@pytest.mark.parametrize(("demand", "time"), [(5.0, 4.5), (6.5, 3.0), (9.0, 3.0)])
def test_a_demand_that_is_raised_from_outside_brings_the_crossing_forward(demand: float, time: float) -> None:
    # At 3 the total is 3, and 1.5 of it is replaced: the limit of 8 is reached earlier, or at once.
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)

    def lift(system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.INTERVENE)
        system.set_demand(0, 0, demand)

    assert times_of(run(problem, 6.0, Crossing(1.0), processes=[lift]))[0] == time


@pytest.mark.parametrize(
    ("demands", "expected"),
    [
        ([9.0, 9.5, 10.0], [3.0]),  # raised three times: one crossing
        ([9.0, 0.0], [9.5]),  # raised and lowered again before anybody looks: none at 3
        ([9.0, 1.5], [8.0]),  # to where it was: the crossing of before
        ([0.0, 9.0], [3.0]),  # its hold-off ends where the crossing was due
    ],
)
def test_what_counts_is_the_demand_when_the_control_unit_looks(
    demands: list[float], expected: list[float]
) -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)

    def change(system: System) -> ProcessGenerator:
        for demand in demands:
            yield system.env.at(3.0, EventKind.INTERVENE)
            system.set_demand(0, 0, demand)

    assert times_of(run(problem, 10.0, Crossing(5.0), {"loss": 1.0}, processes=[change]))[:1] == expected


@pytest.mark.parametrize(
    ("raised_at", "expected"),
    [(8.5, [8.0, 12.0]), (8.0, [8.0, 12.0]), (7.5, [7.5, 11.5])],
)
def test_a_demand_that_is_raised_within_the_hold_off_is_found_at_its_end(
    raised_at: float, expected: list[float]
) -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)

    def lift(system: System) -> ProcessGenerator:
        yield system.env.at(raised_at, EventKind.INTERVENE)
        system.set_demand(0, 0, 20.0)

    result = run(problem, 13.0, Crossing(4.0), {"loss": 1.0}, processes=[lift])
    assert times_of(result) == expected


def test_a_demand_that_is_raised_after_the_look_is_found_at_the_same_instant() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)

    def lift(system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.OBSERVE)
        system.set_demand(1, 0, 20.0)

    assert times_of(run(problem, 3.5, Crossing(4.0), processes=[lift])) == [3.0]


# -- the hold-off ----------------------------------------------------------------------------------------


@given(
    problems(("polynomial", "coupled")),
    st.integers(0, 2**32),
    st.sampled_from([0.1, 0.7, 3.0]),
    st.sampled_from([0.0, 0.5, latency.Exponential(1.0)]),
    st.sampled_from([0.0, 0.4, 1.0]),
)
def test_no_two_signals_of_a_resource_are_closer_than_the_hold_off(
    problem: Problem, seed: int, hold_off: float, late: Any, lost: float
) -> None:
    channel = {"latency": late, "loss": lost}
    result = run(problem, 20.0, Crossing(hold_off), channel, seed=seed)
    for j in range(problem.n_resources):
        assert all(one + hold_off <= other for one, other in pairwise(times_of(result, j)))


def test_it_signals_again_at_once_at_the_end_of_the_hold_off_while_demand_is_above() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)
    result = run(problem, 20.0, Crossing(0.7), {"loss": 1.0})
    expected = [8.0]
    while expected[-1] + 0.7 < 20.0:
        expected.append(expected[-1] + 0.7)
    assert times_of(result) == expected


@pytest.mark.parametrize(
    ("hold_off", "expected"),
    [
        # At 9 the signal arrives before the control unit looks, and the total falls from 9 to 4.5.
        (0.25, [8.0, 8.25, 8.5, 8.75, 12.5]),
        (0.75, [8.0, 8.75, 12.5]),
        (1.0, [8.0, 12.5]),
        (4.0, [8.0, 12.5]),
        (4.5, [8.0, 12.5]),
        (5.0, [8.0, 13.0]),
    ],
)
def test_at_the_end_of_the_hold_off_demand_is_above_or_the_next_crossing_is_awaited(
    hold_off: float, expected: list[float]
) -> None:
    # What is sent at 8 arrives at 9, all else never; after 9 the total is back at its limit of 8 at 12.5.
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)
    channel = Script([9.0, 9.0], *[[math.inf, math.inf]] * 9)
    parts = {"dynamics": "continuous", "channel": channel, "seed": 0}
    result = Simulation(problem, control_unit=Crossing(hold_off), **parts).run(13.125)
    assert times_of(result)[: len(expected)] == expected


def test_the_ideal_model_signals_until_demand_is_below() -> None:
    # Each responds with a probability of 0.02: it takes some twelve signals at every crossing.
    problem = quadratic_problem([1.0] * 4, capacity=8.0, increase=0.5, normalization=0.01)
    result = run(problem, 200.0, Crossing(0.0))
    times, entries = times_of(result), result.events
    assert len(times) > 3 * len(set(times)) > 30
    last = {number for number, (one, other) in enumerate(pairwise([*times, math.inf])) if one != other}
    assert set(entries["number"][entries["kind"] == "respond"]) == last


# -- strictness ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_a_look_signals_above_the_threshold_and_not_at_it(dynamics: str) -> None:
    # Two agents that add 0.5: the total is t, the limit 0.5 * 16.
    problem = quadratic_problem([1.0, 1.0], capacity=16.0, threshold=0.5, increase=0.5, **CERTAIN)
    above = math.nextafter(8.0, 9.0)
    assert times_of(run(problem, 9.0, Sampled(8.0), dynamics=dynamics)) == []
    if dynamics == "continuous":
        assert times_of(run(problem, 9.0, Sampled(above), dynamics=dynamics)) == [above]
    assert times_of(run(problem, 10.0, Sampled(), dynamics=dynamics)) == [9.0]


def test_a_crossing_is_where_demand_reaches_the_threshold() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=16.0, threshold=0.5, increase=0.5, **CERTAIN)
    assert times_of(run(problem, 9.0, Crossing(1.0))) == [8.0]
    # Also at the end of a hold-off: lost at 4, the total of 8 at 8 is found there.
    problem = quadratic_problem([1.0, 1.0], capacity=4.0, increase=0.5, **CERTAIN)

    def lower(system: System) -> ProcessGenerator:
        yield system.env.at(6.0, EventKind.INTERVENE)
        for agent in range(2):
            system.set_demand(agent, 0, 1.0)  # a total of 2 at 6, of 4 at 8

    result = run(problem, 8.5, Crossing(4.0), {"loss": 1.0}, processes=[lower])
    assert times_of(result) == [4.0, 8.0]


# -- the sensing delay -----------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [Sampled, lambda **options: Crossing(2.0, **options)])
def test_a_sensing_delay_is_a_latency_in_front_of_the_channel(make: Any) -> None:
    problem = random_problem(3, 4, 2)
    delayed = run(problem, 40.0, make(sensing_delay=0.625), {"loss": 0.2})
    late = run(problem, 40.0, make(), {"latency": 0.625, "loss": 0.2})
    at_once = run(problem, 40.0, make(), {"loss": 0.2})
    assert len(arrivals_of(delayed)) > 10
    assert delayed.digest == late.digest != at_once.digest


def test_a_signal_keeps_the_time_of_its_look_and_arrives_a_sensing_delay_later() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)
    for control_unit, sent in ((Crossing(2.0, 0.25), 8.0), (Sampled(3.0, sensing_delay=0.25), 9.0)):
        result = run(problem, 12.0, control_unit, {"latency": 0.5})
        assert times_of(result)[0] == sent
        assert arrivals_of(result) == [sent + 0.75]
        assert result.events["time"][result.events["kind"] == "respond"].tolist() == [sent + 0.75] * 2


def test_the_hold_off_counts_from_the_crossing() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)
    result = run(problem, 13.0, Crossing(1.0, sensing_delay=2.25), {"loss": 1.0})
    assert times_of(result) == [8.0, 9.0, 10.0, 11.0, 12.0]


# -- when time cannot advance ----------------------------------------------------------------------------


def standstill(problem: Problem, control_unit: Crossing, channel: dict[str, Any]) -> str:
    with pytest.raises(SimulationError) as caught:
        run(problem, 100.0, control_unit, channel)
    return str(caught.value)


@pytest.mark.parametrize(
    ("control_unit", "channel"),
    [
        (Crossing(0.0), {"latency": 0.5}),
        (Crossing(0.0), {"latency": latency.Exponential(1.0)}),
        (Crossing(0.0), {"loss": 1.0}),
        (Crossing(0.0, sensing_delay=0.5), {}),
        (Crossing(1e-20), {"loss": 1.0}),  # a hold-off that is lost in the digits of the time
    ],
    ids=str,
)
def test_a_state_in_which_time_cannot_advance_is_an_error(
    control_unit: Crossing, channel: dict[str, Any]
) -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, **CERTAIN)
    assert standstill(problem, control_unit, channel) == (
        "time 8.0, resource memory: after 10000 signals at this instant total demand is still at its "
        f"threshold, and time cannot advance since hold_off = {control_unit.hold_off!r}; set hold_off "
        "greater than 0, or let signals arrive at once and reach an agent that can respond"
    )


def test_the_error_names_the_resource_that_stands_still() -> None:
    pair = [
        resource("memory", capacity=1000.0, increase=0.5, **CERTAIN),
        resource("disk", capacity=2.0, increase=0.5, **CERTAIN),
    ]
    problem = Problem(pair, PolynomialCosts([2], [[[1.0], [1.0]]]))
    assert standstill(problem, Crossing(0.0), {"loss": 1.0}).startswith("time 4.0, resource disk: after ")


def test_it_is_no_error_where_somebody_can_respond() -> None:
    # One of two agents hears nothing; the other responds with a probability of 1/500, and holds something
    # until the first alone takes all, at 16.
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, normalization=0.001)
    result = run(problem, 12.0, Crossing(0.0), {"loss": [1.0, 0.0]})
    assert result.account.responses[0, 0] == 0 < result.account.responses[0, 1]
    assert len(times_of(result)) > 100


def test_time_that_stands_still_is_told_from_time_that_goes_on() -> None:
    # The limit is counted for one instant: what happens over a long run does not add up.
    problem = quadratic_problem([1.0], capacity=1.0, increase=1.0, decrease=0.99, **CERTAIN)
    result = run(problem, 120.0, Crossing(0.0), recording=Recording(demand="end"))
    assert len(times_of(result)) > 11_000


# -- what is refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"dynamics": "discrete", "control_unit": Crossing(1.0)},
            (
                "control_unit = Crossing(hold_off=1.0, sensing_delay=0.0, longest_hold_off=None): must be a "
                "Sampled with discrete agents: their demand jumps at ticks and crosses nothing; "
                "or choose continuous dynamics"
            ),
        ),
        (
            {"control_unit": Crossing(0.0)},  # discrete is the default
            "control_unit = Crossing(hold_off=0.0, sensing_delay=0.0, longest_hold_off=None): must be a Samp",
        ),
        (
            {"dynamics": "continuous", "clocks": Clocks()},
            (
                "clocks = Clocks(period=1.0, phase=0.0, drift=0.0, jitter=0.0): must be None with continuous "
                "agents, which have no ticks; leave clocks out, or choose discrete dynamics"
            ),
        ),
        ({"dynamics": "fluid"}, "dynamics = 'fluid': must be 'discrete' or 'continuous'"),
        ({"dynamics": None}, "dynamics = None: must be 'discrete' or 'continuous'"),
    ],
)
def test_combinations_that_make_no_sense_are_refused_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Simulation(quadratic_problem([1.0]), seed=0, **options)


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_all_other_combinations_run(dynamics: str) -> None:
    problem = random_problem(3, 4, 2)
    units: list[Sampled | Crossing] = [Sampled(), Sampled(0.3, 0.1, 0.2)]
    if dynamics == "continuous":
        units += [Crossing(0.0), Crossing(0.5), Crossing(0.5, 0.2)]
    for control_unit in units:
        assert len(run(problem, 40.0, control_unit, dynamics=dynamics).signals) > 10


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Crossing(-1.0), "hold_off = -1.0: must be a finite number at least 0"),
        (lambda: Crossing(math.nan), "hold_off = nan: must be a finite number at least 0"),
        (lambda: Crossing(math.inf), "hold_off = inf: must be a finite number at least 0"),
        (lambda: Crossing("1"), "hold_off = '1': must be a finite number at least 0"),  # type: ignore[arg-type]
        (lambda: Crossing(1.0, -0.5), "sensing_delay = -0.5: must be a finite number at least 0"),
        (lambda: Sampled(sensing_delay=-0.5), "sensing_delay = -0.5: must be a finite number at least 0"),
        (lambda: Sampled(sensing_delay=math.nan), "sensing_delay = nan: must be a finite number at least 0"),
    ],
)
def test_a_control_unit_refuses_by_name(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        make()
