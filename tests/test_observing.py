"""What observers see and integrate: held against fine sampling, and without a trace in the run.

Sampling at a step h misses little, and by how much is known.  With V the total variation of total demand
and J the number of its jumps in a run: the mean excess misses at most h V / until, since it is no rougher
than demand itself; the time above capacity misses at most h at every passage through the capacity, and there
are at most 2 J + 1 of them, one at each jump and one by growth after it; and the peak is above the highest
sample by no more than can be added within h.
"""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    latency,
)
from aimd_des.engine import observers
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.demand_sums import DemandSums
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from tests.conftest import assert_same_run, problems, quadratic_problem, quietly, random_problem
from tests.support.reference_asynchronous import tick_times
from tests.support.scripts import send_at

LATE = BroadcastChannel(latency.Exponential(1.0), loss=0.2, duplication=0.2)
RHYTHM: dict[str, Any] = {"period": 1.1, "phase": "random", "drift": 0.01, "jitter": 0.4}
IN_PHASE: dict[str, Any] = {"period": 1.0, "phase": 0.0, "drift": 0.0, "jitter": 0.0}
CONTINUOUS: dict[str, dict[str, Any]] = {
    "sampled": {"dynamics": "continuous", "control_unit": Sampled(0.7, 0.1), "channel": LATE},
    "crossing": {"dynamics": "continuous", "control_unit": Crossing(0.5), "channel": LATE},
}
DISCRETE: dict[str, dict[str, Any]] = {
    "in phase": {"control_unit": Sampled(), "channel": LATE},
    "own clocks": {"control_unit": Sampled(0.6, 0.3), "channel": LATE, "clocks": Clocks(**RHYTHM)},
}
WAYS = CONTINUOUS | DISCRETE
UNTIL = 30.0
MEDDLED = [3.625 * q for q in range(1, 8)]


def meddle(system: System) -> ProcessGenerator:
    """Set demands now and then, between ticks and up as well as down."""
    for q, time in enumerate(MEDDLED):
        yield system.env.at(time, EventKind.INTERVENE)
        system.set_demand(q % system.problem.n_agents, 0, (q % 3) * system.total(0) / 4.0)


def run(problem: Problem, until: float = UNTIL, **parts: Any) -> Result:
    return quietly(Simulation(problem, **{"seed": 0, **parts}).run, until)


def jumps_of(result: Result, j: int) -> list[tuple[float, float]]:
    """When total demand changed other than by growth, and by how much."""
    events = result.events
    mine = events[events["resource"] == result.problem.resource_names[j]]
    signs = mine["kind"].map({"respond": -1.0, "change": 1.0}).astype(float)
    kept = signs.notna()
    return list(zip(mine["time"][kept].tolist(), (signs * mine["value"])[kept].tolist(), strict=True))


def ticks_of(way: str, n: int) -> list[list[float]]:
    return tick_times(0, UNTIL, n, **(RHYTHM if way == "own clocks" else IN_PHASE))


# -- beside sampling -------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("processes", [[], [meddle]], ids=["alone", "with interventions"])
def test_overshoot_is_what_fine_sampling_finds(way: str, processes: list[Any]) -> None:
    problem, step = random_problem(2, 5, 2), 1.0 / 1024.0
    recording = Recording(demand=step, events=True)
    result = run(problem, recording=recording, processes=processes, **WAYS[way])
    seen = result.observations
    for j, capacity in enumerate(problem.capacity.tolist()):
        total, changes = seen.total_demand[1:, j], jumps_of(result, j)
        rate = float(problem.increase[:, j].sum())
        if way in CONTINUOUS:
            ticks, added, rise = 0, rate * UNTIL, rate * step
        else:
            counts = [len(row) for row in ticks_of(way, 5)]
            ticks, added, rise = sum(counts), float(problem.increase[:, j] @ counts), rate
        passages = 2 * (len(changes) + ticks) + 1
        variation = added + sum(abs(change) for _, change in changes)
        share, mean = (total > capacity).mean(), np.maximum(total - capacity, 0.0).mean() / capacity
        assert share > 0.05
        exact = seen.overshoot
        assert abs(exact.time[j] - share) <= step * passages / UNTIL
        assert abs(exact.mean[j] - mean) <= step * variation / UNTIL / capacity
        slack = 1e-9 * capacity  # the running total and the sum over agents round differently
        assert total.max() - slack <= exact.peak[j] * capacity <= total.max() + rise + slack


# -- beside the same integrals, written down once more ---------------------------------------------------


def integrate_line(
    jumps: list[tuple[float, float]], slope: float, capacity: float, until: float
) -> tuple[float, float, float]:
    """Peak, share of time above and mean excess over the capacity, of a line that jumps."""
    total = time = above = excess = peak = 0.0
    for at, change in [*jumps, (until, 0.0)]:
        end = total + slope * (at - time)
        peak = max(peak, total, end)
        begins = min(max(time, time + (capacity - total) / slope), at)
        above += at - begins
        excess += 0.5 * (at - begins) * (max(total - capacity, 0.0) + max(end - capacity, 0.0))
        total, time = end + change, at
    return max(peak, total) / capacity, above / until, excess / until / capacity


@pytest.mark.parametrize("way", CONTINUOUS)
@given(problems(("polynomial",)), st.integers(0, 2**32), st.sampled_from([0.5, 7.0, UNTIL]), st.booleans())
def test_continuous_overshoot_is_the_integral_over_the_log(
    way: str, problem: Problem, seed: int, until: float, meddling: bool
) -> None:
    recording = Recording(demand="end", events=True)
    processes = [meddle] if meddling else []
    result = run(problem, until, seed=seed, recording=recording, processes=processes, **CONTINUOUS[way])
    exact = result.observations.overshoot
    for j, capacity in enumerate(problem.capacity.tolist()):
        slope = float(problem.increase[:, j].sum())
        expected = integrate_line(jumps_of(result, j), slope, capacity, until)
        assert (exact.peak[j], exact.time[j], exact.mean[j]) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("way", DISCRETE)
@given(problems(("polynomial",)), st.sampled_from([0.5, 7.0, UNTIL]), st.booleans())
def test_discrete_overshoot_is_the_sum_over_what_is_held_between_ticks(
    way: str, problem: Problem, until: float, meddling: bool
) -> None:
    # A look at a tick sees what was held since the tick before, just before an intervention what ends there.
    rhythm = RHYTHM if way == "own clocks" else IN_PHASE
    ticks = {time for row in tick_times(0, until, problem.n_agents, **rhythm) for time in row}
    meddled = {time for time in MEDDLED if meddling and time < until}
    looks = sorted(ticks | meddled | {math.nextafter(time, 0.0) for time in meddled} | {0.0, until})
    processes = [meddle] if meddling else []
    result = run(problem, until, recording=Recording(demand=looks), processes=processes, **DISCRETE[way])
    lengths, exact = np.diff(looks), result.observations.overshoot
    for j, capacity in enumerate(problem.capacity.tolist()):
        held = result.observations.total_demand[1:, j]
        excess = np.maximum(held - capacity, 0.0)
        assert exact.peak[j] == pytest.approx(held.max() / capacity, rel=1e-12)
        assert exact.time[j] == pytest.approx(lengths[held > capacity].sum() / until, abs=1e-9)
        assert exact.mean[j] == pytest.approx(
            (lengths * excess).sum() / until / capacity, rel=1e-9, abs=1e-12
        )


def test_overshoot_by_hand() -> None:
    # Two agents that add 0.5 each, a capacity of 8, everything answered 2 later: a line from 0 to 10, then
    # from 5 to 10 again and again.  It is above 8 from 8 to 10, 13 to 15 and 18 to 20, by 1 on average.
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, normalization=0.5)
    parts = {"dynamics": "continuous", "control_unit": Crossing(3.0), "channel": BroadcastChannel(2.0)}
    exact = run(problem, 20.0, **parts).observations.overshoot
    assert exact.peak.tolist() == [1.25]
    assert exact.time.tolist() == [6.0 / 20.0]
    assert exact.mean.tolist() == [6.0 / 20.0 / 8.0]


def test_a_discrete_overshoot_by_hand() -> None:
    # Ticks at 0, 1, 2, ...: x(k) = k is held until the tick at k, which is answered from x(9) = 9 on.
    problem = quadratic_problem([1.0, 1.0], capacity=8.0, increase=0.5, normalization=0.5)
    exact = run(problem, 12.5).observations.overshoot
    assert exact.peak.tolist() == [9.0 / 8.0]
    assert exact.time.tolist() == [1.0 / 12.5]
    assert exact.mean.tolist() == [1.0 / 12.5 / 8.0]


# -- read only -------------------------------------------------------------------------------------------

RECORDINGS = [
    Recording(demand="end", overshoot=False),
    Recording(demand="end", allocations="end"),
    Recording(demand=0.05, allocations=0.07),
    Recording(demand=np.linspace(0.0, UNTIL, 333), allocations="auto", tail=5),
]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("events", [False, True])
def test_recording_leaves_no_trace_in_the_run(way: str, events: bool) -> None:
    problem = random_problem(2, 5, 2, "coupled")
    digests = set()
    for recording in RECORDINGS:
        seen = Recording(recording.demand, recording.allocations, recording.tail, recording.overshoot, events)
        result = run(problem, recording=seen, processes=[meddle], **WAYS[way])
        digests.add(result.digest)
    assert len(result.signals) > 20
    assert len(digests) == 1


def test_the_digest_holds_the_log_where_it_is_kept() -> None:
    problem = random_problem(2, 5, 2)
    with_log, without = (run(problem, recording=Recording(events=events)) for events in (True, False))
    assert with_log.digest != without.digest
    for name in ("signals", "demand", "allocations"):
        assert getattr(with_log, name).equals(getattr(without, name))


@pytest.mark.parametrize("way", WAYS)
def test_what_is_integrated_does_not_depend_on_what_else_is_seen(way: str) -> None:
    problem = random_problem(2, 5, 2)
    parts = {"processes": [meddle], **WAYS[way]}
    for name in ("peak", "time", "mean"):
        of_each = [
            getattr(run(problem, recording=recording, **parts).observations.overshoot, name).tolist()
            for recording in RECORDINGS[1:]
        ]
        assert of_each[0] == of_each[1] == of_each[2]


@pytest.mark.parametrize("way", WAYS)
def test_without_overshoot_there_is_none(way: str) -> None:
    recording = Recording(overshoot=False)
    result = run(random_problem(2, 5, 2), recording=recording, **WAYS[way])
    overshoot = result.observations.overshoot
    for name in ("peak", "time", "mean"):
        assert np.isnan(getattr(overshoot, name)).tolist() == [True, True], name
    summary = result.summary()
    assert summary[["overshoot_peak", "overshoot_time", "overshoot_mean"]].isna().all(axis=None)
    assert summary["utilisation"].notna().all()


@pytest.mark.parametrize("buffered", [1, 2, 7])
def test_how_many_changes_are_integrated_in_one_go_does_not_matter(
    buffered: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, parts = random_problem(2, 5, 2), {"processes": [meddle], **CONTINUOUS["crossing"]}
    usual = run(problem, **parts)
    assert usual.account.responses.sum() > 30
    monkeypatch.setattr(observers, "_BUFFERED", buffered)
    assert_same_run(run(problem, **parts), usual)


# -- looks -----------------------------------------------------------------------------------------------


def test_a_look_sees_what_has_arrived_by_then() -> None:
    problem = quadratic_problem([1.0], capacity=1000.0, increase=1.0, normalization=0.5)
    looks = [0.0, math.nextafter(4.0, 0.0), 4.0, 6.0]
    recording = Recording(demand=looks, allocations=looks)
    parts = {"dynamics": "continuous", "channel": BroadcastChannel(1.0), "processes": [send_at(3.0, 0)]}
    result = run(problem, 8.0, recording=recording, **parts)
    demand = result.demand
    assert demand["time"].tolist() == [*looks, 8.0]
    assert demand["total"].tolist() == [0.0, looks[1], 2.0, 4.0, 6.0]
    np.testing.assert_allclose(demand["average"], [0.0, 2.0, 2.0, 14.0 / 6.0, 3.0], rtol=1e-15)
    # One agent: what it holds is the total.
    allocations = result.allocations
    assert allocations["demand"].tolist() == demand["total"].tolist()
    assert allocations["average"].tolist() == demand["average"].tolist()


@pytest.mark.parametrize("way", WAYS)
def test_totals_are_sums_of_what_agents_hold(way: str) -> None:
    looks = [0.0, 0.1, 1.0, 7.25, 20.0, UNTIL]
    result = run(random_problem(2, 5, 2), recording=Recording(demand=looks, allocations=looks), **WAYS[way])
    seen = result.observations
    assert seen.demand_times.tolist() == seen.allocation_times.tolist() == looks
    for total, each in ((seen.total_demand, seen.demand), (seen.total_average, seen.average)):
        assert total.tolist() == [[sum(row) for row in page] for page in each.tolist()]


def test_a_tick_of_one_agent_reads_no_other() -> None:
    """So the overshoot of agents whose clocks differ does not grow with the square of their number."""
    problem = random_problem(1, 37, 2)
    parts = (problem, BroadcastChannel(), Clocks(1.0, "random"), 0, 9.0)
    one, other = (System(*parts) for _ in range(2))
    sums, others = DemandSums(one), DemandSums(other)
    rng, held = np.random.default_rng(1), np.zeros((2, 37))
    for _ in range(40):
        several, values = rng.permutation(37)[:5], rng.uniform(0.0, 3.0, (2, 5))
        # Put there behind everybody's back, with nothing grown since: it counts once its agent is named.
        one.state.demand[:, several] = other.state.demand[:, several] = values
        for i in several[:4].tolist():
            sums.ticks(i, -1)
            others.ticks(i, -1)
            if i % 2:
                others.read()
            held[:, i] = one.state.demand[:, i]
        assert sums.read().tolist() == pytest.approx(held.sum(axis=1).tolist(), rel=1e-14)
        # Whatever was read in between, to the last bit.
        assert sums.read().tolist() == others.read().tolist()
    assert not np.array_equal(held, one.state.demand)
    one.break_line(5, 1, 100.0)
    assert sums.read()[1] > 100.0
