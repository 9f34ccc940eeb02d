"""What changes from outside: each intervention on small systems whose course can be told in advance."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    averaging,
    run_synchronous,
)
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import (
    Absence,
    CapacityProfile,
    CapacityRamp,
    CapacityStep,
    Crash,
    Failover,
    Join,
    Partition,
    Prices,
    UnusualActivity,
    join,
    leave,
    set_capacity,
)
from aimd_des.problem.costs import CoupledCosts, weighted_costs
from tests.conftest import quadratic_problem, quietly, random_problem

EVENTS = Recording(demand="end", events=True)
BOTH = pytest.mark.parametrize("agents", [AgentProcess, Fleet])


def growing(n: int = 3, **changes: Any) -> Problem:
    """Agents that add 1 per unit of time and never reach the capacity, unless it is said."""
    options = {"capacity": 1e6, "increase": 1.0, **changes}
    return quadratic_problem([1.0 + i for i in range(n)], **options)


def run(problem: Problem, until: float, *interventions: Any, **parts: Any) -> Result:
    options: dict[str, Any] = {"dynamics": "continuous", "control_unit": Sampled(), "seed": 1, **parts}
    if options["dynamics"] == "continuous" and "control_unit" not in parts:
        options["control_unit"] = Crossing(1.0)
    return quietly(Simulation(problem, interventions=interventions, **options).run, until)


def total_at(problem: Problem, time: float, *interventions: Any, **parts: Any) -> float:
    recording = Recording(demand=[time], overshoot=False)
    return float(
        run(problem, time + 1.0, *interventions, recording=recording, **parts).demand["total"].iloc[0]
    )


# -- agents come and go ----------------------------------------------------------------------------------


@BOTH
def test_who_leaves_releases_what_it_holds_in_that_instant(agents: Any) -> None:
    for time, total in ((4.999, 3 * 4.999), (5.0, 10.0), (6.0, 12.0)):
        found = total_at(growing(), time, Absence(0, 5.0), agents=agents)
        assert found == pytest.approx(total, rel=1e-12)


@BOTH
@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_the_total_is_the_sum_over_those_present(dynamics: str, agents: Any) -> None:
    problem, seen = random_problem(3, 6, 2), []

    def watch(system: System) -> ProcessGenerator:
        for look in range(400):
            yield system.env.at(0.1 * look, EventKind.OBSERVE)
            demand, _ = system.allocations()
            away = system.conditions.away
            assert (demand[:, away] == 0.0).all()
            present = [math.fsum(row[~away]) for row in demand]
            assert system.totals() == pytest.approx(present, rel=1e-12)
            seen.append(int(away.sum()))

    interventions = [Absence([0, 1], 5.0, 20.05), Crash(2, 10.0, 12.3), Join([3], 7.7)]
    parts: dict[str, Any] = {"dynamics": dynamics, "agents": agents, "processes": [watch]}
    run(problem, 40.0, *interventions, **parts)
    assert set(seen) == {0, 1, 2, 3}


@BOTH
def test_an_absence_counts_for_nothing_in_the_average(agents: Any) -> None:
    """Demand t over [0, 4), away until 10, then t - 10: the integral is 8 + 12.5 over 9 units of time."""
    result = run(growing(), 15.0, Absence(0, 4.0, 10.0), agents=agents)
    assert result.average_at_end[0, 0] == pytest.approx((8.0 + 12.5) / 9.0, rel=1e-12)
    assert result.demand_at_end[0, 0] == pytest.approx(5.0, rel=1e-12)
    stopped = run(growing(), 9.0, Absence(0, 4.0, 10.0), agents=agents)
    assert stopped.average_at_end[0, 0] == pytest.approx(2.0, rel=1e-12)


@BOTH
def test_ticks_of_an_absence_count_for_nothing(agents: Any) -> None:
    """Ticks 0 to 3 fold in 0, 1, 2, 3; away at 3.5, back at 6.5; tick 7 folds in 0, tick 8 folds in 1."""
    parts: dict[str, Any] = {"dynamics": "discrete", "agents": agents}
    result = run(growing(), 8.0, Absence(0, 3.5, 6.5), **parts)
    assert result.average_at_end[0, 0] == pytest.approx((0 + 1 + 2 + 3 + 0 + 1) / 6.0, rel=1e-12)
    assert result.demand_at_end[0, 0] == 1.0


@BOTH
def test_who_crashes_or_joins_has_no_past(agents: Any) -> None:
    for intervention in (Crash(0, 4.0, 10.0), Join(0, 10.0)):
        result = run(growing(), 15.0, intervention, agents=agents)
        assert result.average_at_end[0, 0] == pytest.approx(2.5, rel=1e-12)
    assert run(growing(), 15.0, Join(0, 10.0), agents=agents).demand_at_end.ravel() == pytest.approx(
        [5, 15, 15]
    )


@BOTH
@pytest.mark.parametrize("average", [averaging.Cumulative(), averaging.Forgetting(20.0)])
def test_who_has_never_held_anything_has_nothing_to_give_back(average: Any, agents: Any) -> None:
    """Agent 1 comes at 5.5 and is told at 6, before its first tick."""
    problem = growing(2, capacity=1.0, normalization=1e3)
    parts: dict[str, Any] = {"dynamics": "discrete", "averaging": average, "recording": EVENTS}
    result = run(problem, 6.5, Join(1, 5.5), agents=agents, **parts)
    events = result.events[result.events["agent"] == "1"]
    assert events.loc[events["kind"].isin(["respond", "hold"]), "kind"].tolist() == ["hold"]
    assert result.account.saturated[0, 1] == 0


@BOTH
@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_a_signal_for_an_agent_that_is_away_is_lost_on_it(dynamics: str, agents: Any) -> None:
    """Signals leave at 1, 2, ... 9 and take 2.25: those of 2 to 4 land between 4 and 7."""
    problem = growing(2, capacity=1.0, normalization=1e-9)
    channel = BroadcastChannel(latency=2.25)
    parts: dict[str, Any] = {"dynamics": dynamics, "channel": channel, "recording": EVENTS, "agents": agents}
    result = run(problem, 10.0, Absence(0, 4.0, 7.0), control_unit=Sampled(phase=1.0), **parts)
    events = result.events[result.events["agent"] == "0"]
    lost = events.loc[events["kind"] == "lost"]
    landed = events.loc[events["kind"] == "deliver", "time"].tolist()
    assert [time for time in lost["time"].tolist() if time > 0] == [4.25, 5.25, 6.25]
    assert landed == [3.25, 7.25, 8.25, 9.25]
    assert result.account.lost[0].tolist() == [3, 0]
    assert (result.account.delivered + result.account.lost + result.account.in_flight == 9).all()


@BOTH
def test_a_latch_is_forgotten_by_who_leaves(agents: Any) -> None:
    """The signal of 3 arrives at 3.25; away from 3.5 to 3.75, the agent does not answer at its tick 4."""
    problem = growing(2, capacity=5.5, normalization=1e3)
    parts: dict[str, Any] = {
        "dynamics": "discrete",
        "channel": BroadcastChannel(latency=0.25),
        "recording": EVENTS,
        "agents": agents,
    }
    stays = run(problem, 5.0, **parts).events
    leaves = run(problem, 5.0, Absence(0, 3.5, 3.75), **parts).events
    for events, answered in ((stays, ["0", "1"]), (leaves, ["1"])):
        at_tick = events[(events["kind"] == "respond") & (events["time"] == 4.0)]
        assert at_tick["agent"].tolist() == answered
    # It has arrived before the agent left: it was delivered, and not lost.
    assert (leaves["kind"] == "lost").sum() == 0


@BOTH
def test_nobody_at_all_is_no_end_of_the_world(agents: Any) -> None:
    problem = growing(2, capacity=3.0, normalization=0.1)
    result = run(problem, 20.0, Absence([0, 1], 5.0, 10.0), agents=agents)
    assert not [time for time in result.signals["time"] if 5.0 <= time < 10.0]
    assert result.pieces["agents"].tolist() == [2, 0, 2]
    assert np.isnan(result.pieces["optimal_cost"].iloc[1])
    empty = run(problem, 20.0, Absence([0, 1], 5.0), agents=agents)
    # Signals were sent and heard; what is measured of those who are here has no value.
    summary = empty.summary()
    missing = ["utilisation", "relative_error", "misallocation", "consensus_spread", "cost_ratio"]
    assert summary.columns[summary.isna().any()].tolist() == missing
    assert summary[missing].isna().all(axis=None)
    assert empty.optimum is None
    assert list(empty.measures(names=["lost", "utilisation"])) == ["lost", "utilisation"]


def test_the_last_of_two_changes_at_one_instant_counts() -> None:
    result = run(growing(), 10.0, CapacityStep(0, 5.0, 7.0), CapacityStep(0, 5.0, 8.0))
    assert result.pieces[["start", "end", "capacity"]].to_numpy().tolist() == [[0, 5, 1e6], [5, 10, 8]]


# -- capacities ------------------------------------------------------------------------------------------


@BOTH
def test_a_capacity_below_the_total_is_sensed_at_once(agents: Any) -> None:
    problem = growing(capacity=100.0, normalization=1e-9)
    result = run(problem, 12.0, CapacityStep("memory", 10.0, 20.0), agents=agents)
    assert result.signals["time"].tolist() == [10.0, 11.0]
    raised = run(problem, 60.0, CapacityStep("memory", 10.0, 120.0), agents=agents)
    assert raised.signals["time"].iloc[0] == pytest.approx(40.0, rel=1e-12)


@BOTH
def test_a_threshold_moves_with_its_capacity(agents: Any) -> None:
    problem = growing(capacity=100.0, threshold=0.5, normalization=1e-9)
    result = run(problem, 30.0, CapacityStep(0, 1.0, 60.0), agents=agents)
    assert result.signals["time"].iloc[0] == pytest.approx(10.0, rel=1e-12)


def test_a_ramp_ends_where_it_shall() -> None:
    result = run(growing(capacity=1000.0), 20.0, CapacityRamp(0, 4.0, 8.0, 500.0, steps=4))
    assert result.pieces["start"].tolist() == [0.0, 5.0, 6.0, 7.0, 8.0]
    assert result.pieces["capacity"].tolist() == [1000.0, 875.0, 750.0, 625.0, 500.0]


def test_a_ramp_begins_with_the_capacity_that_is_in_force_then() -> None:
    step, ramp = CapacityStep(0, 2.0, 600.0), CapacityRamp(0, 4.0, 8.0, 200.0, steps=4)
    result = run(growing(capacity=1000.0), 10.0, step, ramp)
    assert result.pieces["start"].tolist() == [0.0, 2.0, 5.0, 6.0, 7.0, 8.0]
    assert result.pieces["capacity"].tolist() == [1000.0, 600.0, 500.0, 400.0, 300.0, 200.0]


def test_a_profile_is_repeated(tmp_path: Path) -> None:
    path = tmp_path / "day.csv"
    path.write_text("hour,left\n0,900\n6,500\n18,700\n")
    read = CapacityProfile.from_csv(path, "memory", time="hour", capacity="left", period=24.0)
    given = CapacityProfile("memory", [0.0, 6.0, 18.0], [900.0, 500.0, 700.0], period=24.0)
    for profile in (read, given):
        pieces = run(growing(), 50.0, profile).pieces
        assert pieces["start"].tolist() == [0, 6, 18, 24, 30, 42, 48]
        assert pieces["capacity"].tolist() == [900, 500, 700, 900, 500, 700, 900]
    once = run(growing(), 50.0, CapacityProfile(0, [2.0, 3.0], [900.0, 500.0])).pieces
    assert once["capacity"].tolist() == [1e6, 900, 500]


@BOTH
@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_overshoot_is_measured_against_the_capacity_in_force(dynamics: str, agents: Any) -> None:
    """Total 3t (or steps of 3) against 30 up to time 5, and against 12 from there to 8."""
    problem = growing(capacity=30.0, normalization=1e-9)
    result = run(problem, 8.0, CapacityStep(0, 5.0, 12.0), dynamics=dynamics, agents=agents)
    pieces, over = result.pieces, result.observations.overshoot
    if dynamics == "continuous":
        assert pieces["overshoot_peak"].tolist() == pytest.approx([0.5, 2.0])
        assert pieces["overshoot_mean"].tolist() == pytest.approx([0.0, (3 + 12) / 2 / 12])
        assert pieces["utilisation"].tolist() == pytest.approx([0.25, 19.5 / 12])
    else:  # x(k) over (k - 1, k]; from 5 on there is a signal at every tick, and all hold at 15
        assert pieces["overshoot_peak"].tolist() == pytest.approx([0.5, 1.25])
        assert pieces["overshoot_mean"].tolist() == pytest.approx([0.0, 0.25])
        assert pieces["utilisation"].tolist() == pytest.approx([9 / 30, 1.25])
    assert pieces["overshoot_time"].tolist() == [0.0, 1.0]
    assert over.peak[0] == pieces["overshoot_peak"].iloc[1]
    assert over.time[0] == pytest.approx(3 / 8)
    assert over.mean[0] == pytest.approx(pieces["overshoot_mean"].iloc[1] * 3 / 8)


@BOTH
@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_each_peak_is_over_the_capacity_of_its_own_piece(dynamics: str, agents: Any) -> None:
    """3t (or steps of 3) against 12 up to time 5, and against 30 from there to 8: the worst is first."""
    problem = growing(capacity=12.0, normalization=1e-9)
    parts: dict[str, Any] = {"channel": BroadcastChannel(loss=1.0), "dynamics": dynamics, "agents": agents}
    result = run(problem, 8.0, CapacityStep(0, 5.0, 30.0), **parts)
    assert result.pieces["overshoot_peak"].tolist() == pytest.approx([1.25, 0.8], rel=1e-12)
    assert result.observations.overshoot.peak[0] == pytest.approx(1.25, rel=1e-12)


@BOTH
@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_a_total_that_lasts_no_time_is_no_peak(dynamics: str, agents: Any) -> None:
    """At 5 agent 0 takes 100 and gives it back; the total is 3 * 5 before, and 10 after."""

    def flash(system: System) -> ProcessGenerator:
        yield system.env.at(5.0, EventKind.INTERVENE)
        for demand in (100.0, 0.0):
            system.set_demand(0, 0, demand)

    def stay(system: System) -> ProcessGenerator:
        yield system.env.at(5.0, EventKind.INTERVENE)
        system.set_demand(0, 0, 100.0)

    parts: dict[str, Any] = {"dynamics": dynamics, "agents": agents}
    problem, last = growing(capacity=10.0, normalization=1e-9), 5.5
    if dynamics == "discrete":  # nobody hears, so that everybody grows
        parts["channel"] = BroadcastChannel(loss=1.0)
    peaks = [
        float(run(problem, last, processes=[process], **parts).observations.overshoot.peak[0])
        for process in (flash, stay)
    ]
    after = 100.0 + 10.0 + (1.5 if dynamics == "continuous" else 3.0)
    assert peaks == pytest.approx([1.5, after / 10.0], rel=1e-12)


@BOTH
def test_demand_that_is_answered_in_the_instant_of_a_step_is_no_peak(agents: Any) -> None:
    """Total 3t; at 5 the capacity falls to 12, and everybody halves its demand in that instant."""
    problem = growing(capacity=30.0, normalization=1e3, decrease=0.5)
    result = run(problem, 6.0, CapacityStep(0, 5.0, 12.0), agents=agents)
    assert result.pieces["overshoot_peak"].tolist() == pytest.approx([0.5, 10.5 / 12.0], rel=1e-12)
    assert result.pieces["overshoot_time"].tolist() == [0.0, 0.0]


# -- the control unit and the channel --------------------------------------------------------------------


@BOTH
def test_nobody_signals_while_the_control_unit_is_down(agents: Any) -> None:
    problem = growing(capacity=9.0, normalization=1e-9)
    crossing = run(problem, 12.0, Failover(4.5, 3.25), agents=agents)
    assert crossing.signals["time"].tolist() == [3.0, 4.0, 7.75, 8.75, 9.75, 10.75, 11.75]
    sampled = run(problem, 12.0, Failover(4.5, 3.25), agents=agents, control_unit=Sampled(2.0))
    assert sampled.signals["time"].tolist() == [4.0, 8.0, 10.0]
    discrete = run(problem, 12.0, Failover(4.5, 3.25), agents=agents, dynamics="discrete")
    assert discrete.signals["time"].tolist() == [4.0, 8.0, 9.0, 10.0, 11.0]


@BOTH
def test_what_is_on_its_way_when_a_partition_begins_arrives(agents: Any) -> None:
    problem = growing(2, capacity=1.0, normalization=1e-9)
    parts: dict[str, Any] = {"channel": BroadcastChannel(latency=1.5), "recording": EVENTS, "agents": agents}
    unit = Sampled(phase=1.0)
    result = run(problem, 10.0, Partition(3.0, 3.0, ["1"]), control_unit=unit, **parts)
    events = result.events[result.events["agent"] == "1"]
    assert events.loc[events["kind"] == "deliver", "time"].tolist() == [2.5, 3.5, 7.5, 8.5, 9.5]
    assert events.loc[events["kind"] == "lost", "time"].tolist() == [3.0, 4.0, 5.0]
    assert result.account.lost.sum(axis=0).tolist() == [0, 3]
    everybody = run(problem, 10.0, Partition(3.0, 3.0), control_unit=unit, **parts)
    assert everybody.account.lost.sum(axis=0).tolist() == [3, 3]


@BOTH
def test_no_second_copy_gets_through_a_partition(agents: Any) -> None:
    problem = growing(2, capacity=1.0, normalization=1e-9)
    doubling = BroadcastChannel(latency=1.5, duplication=1.0)
    parts: dict[str, Any] = {"control_unit": Sampled(phase=1.0), "agents": agents}
    account = run(problem, 10.0, Partition(3.0, 3.0, ["1"]), channel=doubling, **parts).account
    assert account.delivered.sum(axis=0).tolist() == [8, 5]
    assert account.duplicated.sum(axis=0).tolist() == [8, 5]


# -- costs -----------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("family", ["polynomial", "coupled"])
@pytest.mark.parametrize("dynamics", ["continuous", "discrete"])
def test_costs_that_change_at_the_start_are_the_costs_of_the_run(
    family: str, dynamics: str, agents: Any
) -> None:
    problem = random_problem(4, 5, 2, family)
    weights = [1.0, 0.5, 2.0, 1.0, 3.0]
    other = Problem(problem.resources, weighted_costs(problem.costs, weights))
    activity = [UnusualActivity(i, 0.0, None, weight) for i, weight in enumerate(weights)]
    parts: dict[str, Any] = {"dynamics": dynamics, "agents": agents}
    weighed, plain = run(problem, 60.0, *activity, **parts), run(other, 60.0, **parts)
    assert weighed.digest == plain.digest
    assert weighed.digest != run(problem, 60.0, **parts).digest
    assert weighed.summary().equals(plain.summary())


@BOTH
def test_unusual_activity_is_over_and_nothing_is_left_of_it(agents: Any) -> None:
    problem = random_problem(4, 5, 2)
    result = run(problem, 30.0, UnusualActivity([0, "3"], 5.0, 10.0, 0.1), agents=agents)
    costs = [piece.costs for piece in result.history]
    assert costs[0] is costs[2] is problem.costs
    assert isinstance(costs[1], PolynomialCosts)
    assert isinstance(problem.costs, PolynomialCosts)
    ratio = costs[1].coefficients / problem.costs.coefficients
    assert ratio[:, 0, 0].tolist() == pytest.approx([0.1, 1, 1, 0.1, 1])


@BOTH
def test_prices_are_drawn_at_their_interval(agents: Any) -> None:
    problem, drawn = random_problem(4, 5, 2), []

    def draw(k: int) -> Any:
        drawn.append(k)
        return weighted_costs(problem.costs, np.full(5, float(k)))

    result = run(problem, 35.0, Prices(10.0, draw), agents=agents)
    assert drawn == [1, 1, 2, 3]  # the first is looked at before anything runs
    multipliers = result.pieces["multiplier"].to_numpy().reshape(4, 2)
    assert multipliers / multipliers[0] == pytest.approx(np.array([[1, 1], [1, 1], [2, 2], [3, 3]]), rel=1e-6)


def test_costs_that_couple_resources_do_not_follow_those_that_do_not() -> None:
    """Agents that are separable compute the averages of one resource only."""
    problem = random_problem(2, 3, 2, "custom")
    coupled = random_problem(2, 3, 2, "custom coupled").costs
    assert type(coupled) is type(problem.costs)
    assert problem.costs.separable != coupled.separable
    with pytest.raises(InputError, match="separable of CustomCosts = False: must be True, as of the costs"):
        run(problem, 5.0, Prices(1.0, lambda k: coupled))


# -- the optimum follows ---------------------------------------------------------------------------------


def test_the_tracking_error_is_that_of_the_optimum_in_force() -> None:
    """Quadratic costs c_i: shares are in proportion to 1 / c_i among those who are here."""
    problem = quadratic_problem([1.0, 2.0, 4.0], capacity=7.0, increase=0.05)
    looks = Recording(allocations=[10.0, 20.0, 30.0])
    result = run(problem, 40.0, CapacityStep(0, 15.0, 3.0), Absence(0, 25.0), recording=looks)
    shares = {10.0: [4, 2, 1], 20.0: [12 / 7, 6 / 7, 3 / 7], 30.0: [2, 1], 40.0: [2, 1]}
    frame, allocations = result.tracking, result.allocations
    assert frame["time"].tolist() == [10.0, 20.0, 30.0, 40.0]
    assert frame["capacity"].tolist() == [7.0, 3.0, 3.0, 3.0]
    for row in frame.to_dict("records"):
        average = allocations.loc[allocations["time"] == row["time"], "average"].to_numpy()
        here = average[-len(shares[row["time"]]) :]
        wanted = np.array(shares[row["time"]])
        assert row["relative_error"] == pytest.approx(abs(here - wanted).sum() / wanted.sum(), rel=1e-6)
        assert row["level"] == pytest.approx(here.sum() / row["capacity"])
    summary = result.summary()
    assert summary["relative_error"].iloc[0] == pytest.approx(frame["relative_error"].iloc[-1])
    assert result.pieces["multiplier"].tolist() == pytest.approx([8.0, 24 / 7, 8.0])


def test_at_the_instant_of_a_change_averages_are_held_against_what_is_new() -> None:
    problem = quadratic_problem([1.0, 2.0], capacity=3.0, increase=0.05)
    looks = Recording(allocations=[9.75, 10.0])
    result = run(problem, 12.0, CapacityStep(0, 10.0, 1.5), recording=looks)
    assert result.tracking["capacity"].tolist() == [3.0, 1.5, 1.5]
    average = result.observations.average[1, 0]
    error = abs(average - np.array([1.0, 0.5])).sum() / 1.5
    assert result.tracking["relative_error"].iloc[1] == pytest.approx(error, rel=1e-9)
    assert result.tracking["level"].iloc[1] == pytest.approx(average.sum() / 1.5, rel=1e-12)


# -- a process of one's own ------------------------------------------------------------------------------


@BOTH
def test_a_process_may_do_what_is_declared(agents: Any) -> None:
    def meddle(system: System) -> ProcessGenerator:
        yield system.env.at(4.0, EventKind.INTERVENE)
        leave(system, 0)
        yield system.env.at(6.0, EventKind.INTERVENE)
        set_capacity(system, 0, 2.5)
        yield system.env.at(10.0, EventKind.INTERVENE)
        join(system, 0)

    problem = random_problem(4, 5, 1)
    parts: dict[str, Any] = {"agents": agents, "recording": EVENTS}
    own = run(problem, 30.0, processes=[meddle], **parts)
    declared = run(problem, 30.0, Absence(0, 4.0, 10.0), CapacityStep(0, 6.0, 2.5), **parts)
    assert own.digest == declared.digest


def test_the_log_tells_what_has_changed() -> None:
    result = run(
        growing(2),
        20.0,
        Crash(1, 2.0, 3.0),
        CapacityStep(0, 4.0, 50.0),
        UnusualActivity(0, 5.0, 6.0),
        Partition(7.0, 1.0, [0]),
        Failover(9.0, 1.0),
        recording=EVENTS,
    )
    events = result.events
    told = events[~events["kind"].isin(["signal", "lost", "deliver", "respond", "hold", "change"])]
    rows = [(row["time"], row["kind"], row["value"]) for row in told.to_dict("records")]
    assert rows == [
        (2.0, "leave", 0.0),
        (3.0, "join", 1.0),
        (4.0, "capacity", 50.0),
        (5.0, "costs", 0.0),
        (6.0, "costs", 0.0),
        (7.0, "cut", 0.0),
        (8.0, "heal", 0.0),
        (9.0, "fail", 0.0),
        (10.0, "recover", 0.0),
    ]


# -- errors ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CapacityStep("memroy", 1.0, 5.0), "did you mean 'memory'?"),
        (lambda: CapacityStep(0, -1.0, 5.0), "CapacityStep.at = -1.0"),
        (lambda: CapacityStep(0, 1.0, 0.0), "CapacityStep.capacity = 0.0"),
        (lambda: CapacityStep(7, 1.0, 5.0), "resource = 7"),
        (
            lambda: CapacityRamp(0, 5.0, 5.0, 1.0),
            "CapacityRamp.end = 5.0: must be a finite number greater than 5",
        ),
        (lambda: CapacityRamp(0, 5.0, 6.0, 1.0, steps=0), "CapacityRamp.steps = 0"),
        (lambda: CapacityProfile(0, [1.0, 1.0], [1.0, 2.0]), "strictly ascending"),
        (lambda: CapacityProfile(0, [1.0, 2.0], [1.0]), "CapacityProfile.capacities"),
        (lambda: CapacityProfile(0, [1.0, 2.0], [1.0, 2.0], period=2.0), "CapacityProfile.period = 2.0"),
        (lambda: Absence("north", 1.0), "agent = 'north'"),
        (lambda: Absence([0, 0], 1.0), "different ones"),
        (lambda: Absence([], 1.0), "one agent or several"),
        (lambda: Absence(0, 2.0, 2.0), "Absence.until = 2.0"),
        (lambda: Join(0, 0.0), "Join.at = 0.0"),
        (lambda: UnusualActivity(0, 1.0, 2.0, 0.0), "UnusualActivity.weight = 0.0"),
        (lambda: Prices(0.0, lambda k: None), "Prices.every = 0.0"),
        (lambda: Prices(1.0, 5), "Prices.draw = 5"),
        (
            lambda: Prices(1.0, lambda k: CoupledCosts(PolynomialCosts([2], [[[1.0]]]))),
            "separable of CoupledCosts",
        ),
        (lambda: Prices(1.0, lambda k: PolynomialCosts([2], [[[1.0]]])), "for 3 agents and 1 resources"),
        (lambda: Failover(1.0, 0.0), "Failover.duration = 0.0"),
        (lambda: Partition(1.0, 1.0, [5]), "agent = 5"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_runs(make: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        Simulation(growing(), interventions=[make()], seed=0)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "absences",
    [
        [Absence(0, 1.0, 5.0), Crash(0, 3.0, 4.0)],
        [Absence(0, 1.0), Crash(0, 30.0)],
        [Join([1, 0], 5.0), Absence(0, 5.0)],
    ],
)
def test_absences_of_one_agent_do_not_overlap(absences: Any) -> None:
    with pytest.raises(InputError, match=r"absence of agent 0 = .*let one begin after the other"):
        Simulation(growing(), interventions=absences, seed=0)


def test_functions_refuse_what_cannot_be() -> None:
    caught = []

    def meddle(system: System) -> ProcessGenerator:
        yield system.env.at(1.0, EventKind.INTERVENE)
        for wrong in (
            lambda: join(system, 0),
            lambda: (leave(system, 0), leave(system, 0)),
            lambda: system.set_demand(0, 0, 1.0),
            lambda: set_capacity(system, 0, -1.0),
        ):
            with pytest.raises(InputError) as refusal:
                wrong()
            caught.append(str(refusal.value))

    run(growing(), 5.0, processes=[meddle])
    for message, words in zip(
        caught, ("is here already", "is away already", "let it join first", "-1.0"), strict=True
    ):
        assert words in message


# -- averages --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "way",
    [
        averaging.Cumulative(),
        averaging.Window(40.0, parts=8),
        averaging.Forgetting(20.0),
        averaging.Polynomial(1.5),
    ],
    ids=type,
)
def test_in_phase_each_average_is_that_of_the_synchronous_algorithm(way: Any) -> None:
    problem = random_problem(5, 6, 3, "coupled")
    synchronous = quietly(run_synchronous, problem, steps=300, seed=2, averaging=way)
    for agents in (AgentProcess, Fleet):
        parts: dict[str, Any] = {"channel": BroadcastChannel(latency=0.5), "agents": agents, "seed": 2}
        assert run(problem, 300.0, dynamics="discrete", averaging=way, **parts).digest == synchronous.digest


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: averaging.Window(0.0), "Window.length = 0.0"),
        (lambda: averaging.Window(5.0, parts=1), "Window.parts = 1"),
        (lambda: averaging.Forgetting(-1.0), "Forgetting.time_constant = -1.0"),
        (lambda: averaging.Polynomial(0.5), "Polynomial.gain = 0.5"),
        (
            lambda: Simulation(growing(), averaging=averaging.Window(50.0), seed=0),
            "a multiple of its 20 parts",
        ),
    ],
)
def test_averages_are_checked(make: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert words in str(caught.value)
