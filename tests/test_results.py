"""What comes out: tidy frames, a digest, and a summary with the measures of the model."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from aimd_des import (
    BroadcastChannel,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    run_synchronous,
    solve_optimum,
)
from aimd_des.engine.simulation import Simulation
from aimd_des.metrics import measures
from aimd_des.results.measures import MEASURED, MEASURES
from tests.conftest import quietly, random_problem, resource

N, M, STEPS = 4, 2, 60


@pytest.fixture(scope="module")
def problem() -> Problem:
    coefficients = np.random.default_rng(0).uniform(0.5, 2.0, (N, M, 1))
    resources = [
        resource("memory", capacity=3.0, increase=0.04),
        resource("disk", capacity=5.0, increase=0.1, threshold=0.9),
    ]
    names = ["north", "east", "south", "west"]
    return Problem(resources, PolynomialCosts([2], coefficients), agent_names=names)


def run(problem: Problem, **options: Any) -> Result:
    options.setdefault("recording", Recording(demand=2.0, allocations=20.0))
    return run_synchronous(problem, **{"steps": STEPS, "seed": 1, **options})


@pytest.fixture(scope="module")
def result(problem: Problem) -> Result:
    return run(problem)


def dtypes(frame: pd.DataFrame) -> dict[str, str]:
    return {str(name): str(kind) for name, kind in frame.dtypes.items()}


def test_signals_are_a_row_for_each_broadcast(result: Result) -> None:
    frame = result.signals
    assert dtypes(frame) == {"time": "float64", "resource": "category", "number": "int64"}
    assert frame["resource"].cat.categories.tolist() == ["memory", "disk"]
    assert len(frame) == len(result.signals_sent.time) > 30
    assert frame["time"].is_monotonic_increasing
    assert (frame["time"] % 1.0 == 0).all()
    for _, rows in frame.groupby("resource", observed=True):
        assert rows["number"].tolist() == list(range(len(rows)))


def test_demand_is_a_row_for_each_look_and_resource(result: Result) -> None:
    frame = result.demand
    assert dtypes(frame) == {
        "time": "float64",
        "resource": "category",
        "total": "float64",
        "average": "float64",
    }
    assert len(frame) == M * 31
    assert frame["time"].tolist() == [float(time) for time in range(0, STEPS + 1, 2) for _ in range(M)]
    assert frame["resource"].tolist() == ["memory", "disk"] * 31
    last = frame.tail(M)
    np.testing.assert_allclose(last["total"], result.demand_at_end.sum(axis=0), rtol=1e-14)
    np.testing.assert_allclose(last["average"], result.average_at_end.sum(axis=0), rtol=1e-14)


def test_allocations_are_a_row_for_each_look_agent_and_resource(result: Result) -> None:
    frame = result.allocations
    assert dtypes(frame) == {
        "time": "float64",
        "agent": "category",
        "resource": "category",
        "demand": "float64",
        "average": "float64",
    }
    assert len(frame) == 4 * N * M
    assert frame["agent"].cat.categories.tolist() == ["north", "east", "south", "west"]
    assert frame["time"].unique().tolist() == [0.0, 20.0, 40.0, 60.0]
    end = frame[frame["time"] == STEPS].set_index(["agent", "resource"])
    for i, camera in enumerate(["north", "east", "south", "west"]):
        for j, name in enumerate(["memory", "disk"]):
            row = end.loc[(camera, name)]
            assert (row["demand"], row["average"]) == (
                result.demand_at_end[i, j],
                result.average_at_end[i, j],
            )


def test_frames_agree_with_one_another(result: Result) -> None:
    sums = result.allocations.groupby(["time", "resource"], observed=True)[["demand", "average"]].sum()
    seen = result.demand.set_index(["time", "resource"]).loc[sums.index]
    np.testing.assert_allclose(sums["demand"], seen["total"], rtol=1e-12)
    np.testing.assert_allclose(sums["average"], seen["average"], rtol=1e-12)


def test_nothing_is_sent_where_nothing_is_short(problem: Problem) -> None:
    silent = run(problem, steps=3, recording=Recording())
    assert silent.signals.empty
    assert dtypes(silent.signals) == {"time": "float64", "resource": "category", "number": "int64"}
    assert silent.summary()["signals"].tolist() == [0, 0]


def test_frames_survive_being_written(result: Result, tmp_path: Any) -> None:
    for name in ("signals", "demand", "allocations"):
        getattr(result, name).to_parquet(tmp_path / name, index=False)
        pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / name), getattr(result, name))


def test_the_digest_is_that_of_the_run_and_of_nothing_else(problem: Problem, result: Result) -> None:
    assert result.digest == run(problem).digest
    assert len(result.digest) == 64
    assert int(result.digest, 16) >= 0
    assert result.digest == run(problem, recording=Recording(demand="end")).digest
    others = [run(problem, seed=2), run(problem, steps=STEPS - 1, recording=Recording()), run(problem, lag=0)]
    assert len({result.digest, *(other.digest for other in others)}) == 4


@pytest.mark.parametrize(
    "change",
    [
        lambda result: result.observations.demand[-1].__setitem__((0, 1), np.nextafter(1.0, 2.0)),
        lambda result: result.observations.average[-1].__setitem__((1, 2), 0.125),
        lambda result: result.signals_sent.time.__setitem__(3, 0.5),
        lambda result: result.signals_sent.resource.__setitem__(3, 1 - result.signals_sent.resource[3]),
        lambda result: result.signals_sent.number.__setitem__(-1, 10**6),
        lambda result: result.account.responses.__setitem__((0, 0), 10**6),
        lambda result: result.account.saturated.__setitem__((1, 0), 1),
    ],
    ids=["demand", "average", "time", "resource", "number", "responses", "saturated"],
)
def test_the_digest_hangs_on_every_number(change: Any, problem: Problem, result: Result) -> None:
    changed = run(problem)
    change(changed)
    assert changed.digest != result.digest


def test_the_summary_has_a_row_for_each_resource_and_a_column_for_each_measure(result: Result) -> None:
    summary = result.summary()
    assert summary.index.tolist() == ["memory", "disk"]
    assert summary.index.name == "resource"
    assert list(summary.columns) == list(MEASURED)
    kinds = {"integer": "int64", "number": "float64"}
    for name in MEASURED:
        assert str(summary[name].dtype) == kinds[MEASURES[name].kind]
    assert summary.notna().all(axis=None)


def test_the_summary_is_what_the_formulas_say(problem: Problem, result: Result) -> None:
    summary = result.summary()
    average, costs = result.average_at_end, problem.costs
    best = solve_optimum(problem)
    used = average.sum(axis=0)
    reachable = solve_optimum(problem, capacity=used)
    for j, (_, row) in enumerate(summary.iterrows()):
        assert row["signals"] == (result.signals["resource"] == problem.resource_names[j]).sum()
        assert row["responses"] == result.account.responses[j].sum()
        assert row["utilisation"] == pytest.approx(used[j] / problem.capacity[j], rel=1e-12)
        off = sum(abs(average[i, j] - best.allocation[i, j]) for i in range(N))
        assert row["relative_error"] == pytest.approx(off / problem.capacity[j], rel=1e-8)
        off = sum(abs(average[i, j] - reachable.allocation[i, j]) for i in range(N))
        assert row["misallocation"] == pytest.approx(off / used[j], rel=1e-8)
        slopes = [costs.gradient(average)[i, j] for i in range(N)]
        assert row["consensus_spread"] == pytest.approx(np.std(slopes) / np.mean(slopes), rel=1e-12)
        ratio = sum(costs.value(average)) / sum(costs.value(best.allocation))
        assert row["cost_ratio"] == pytest.approx(ratio, rel=1e-9)
        overshoot = result.observations.overshoot
        for name in ("peak", "time", "mean"):
            assert row[f"overshoot_{name}"] == getattr(overshoot, name)[j]


def test_an_optimum_that_is_known_is_taken(problem: Problem, result: Result) -> None:
    best = solve_optimum(problem)
    pd.testing.assert_frame_equal(result.summary(best), result.summary())
    half = solve_optimum(problem, capacity=problem.capacity / 2)
    assert (result.summary(half)["cost_ratio"] > result.summary(best)["cost_ratio"]).all()


def test_a_run_in_which_nobody_holds_anything_can_be_summed_up(problem: Problem) -> None:
    from aimd_des.dynamics.clocks import Clocks

    idle = Simulation(problem, clocks=Clocks(phase=100.0), seed=0).run(10.0)
    summary = idle.summary()
    assert summary["utilisation"].tolist() == [0.0, 0.0]
    assert summary["relative_error"].tolist() == pytest.approx([1.0, 1.0])
    assert summary["misallocation"].isna().all()
    assert summary["cost_ratio"].tolist() == [0.0, 0.0]


def test_arrays_at_the_end_have_a_row_for_each_agent() -> None:
    result = quietly(run_synchronous, random_problem(3, 5, 3), steps=20, seed=0)
    assert result.demand_at_end.shape == result.average_at_end.shape == (5, 3)
    assert np.array_equal(result.demand_at_end.T, result.observations.demand[-1])
    assert result.account.responses.shape == (3, 5)


def test_every_duplicate_that_arrives_is_in_the_summary() -> None:
    problem = random_problem(3, 4, 2)
    channel = BroadcastChannel(duplication=1.0)
    summary = quietly(Simulation(problem, channel=channel, seed=2).run, 60.0).summary()
    assert (
        summary["duplicated"].tolist() == summary["delivered"].tolist() == (4 * summary["signals"]).tolist()
    )
    assert (summary["duplicated"] > 0).all()


def test_the_summary_carries_units_and_meanings(result: Result) -> None:
    summary = result.summary()
    assert list(summary.attrs["units"]) == list(summary.attrs["meanings"]) == list(summary)
    assert summary.attrs["units"]["utilisation"] == "share of the capacity"
    listed = measures()
    assert listed.index.tolist() == list(MEASURES)
    assert listed[listed["in_summary"]].index.tolist() == list(summary)
    assert listed.loc[list(summary), "meaning"].to_dict() == summary.attrs["meanings"]
    assert listed[listed["shown"]].index.tolist() == [
        "signals",
        "utilisation",
        "misallocation",
        "overshoot_peak",
        "overshoot_time",
    ]


def test_convergence_measures_each_recorded_time(problem: Problem, result: Result) -> None:
    frame = result.convergence()
    times = result.observations.allocation_times
    assert list(frame) == ["time", "resource", "misallocation", "relative_error", "cost_ratio"]
    assert frame["time"].unique().tolist() == times[times > 0.0].tolist()
    end, summary = frame[frame["time"] == STEPS].set_index("resource"), result.summary()
    for name in ("misallocation", "relative_error", "cost_ratio"):
        assert end[name].tolist() == summary[name].tolist()
    # Each row is what a run that ends there measures.
    first = run(problem, steps=20).summary()
    assert frame[frame["time"] == 20.0]["relative_error"].tolist() == first["relative_error"].tolist()


def test_convergence_takes_fewer_looks_where_fewer_are_asked_for(result: Result) -> None:
    few = result.convergence(2)["time"].unique()
    assert len(few) == 2
    assert few[-1] == STEPS
    with pytest.raises(InputError, match="looks = 0: must be"):
        result.convergence(0)
