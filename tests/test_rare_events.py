"""Rare events of runs: against plain runs, by either method, and for every measure."""

from typing import Any

import numpy as np
import pytest

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Sampled,
    Simulation,
    SimulationError,
    interventions,
    latency,
)
from aimd_des.study import mean_interval, rare_event
from aimd_des.study.rare_events import _DemandPath, _Sight, _Work
from aimd_des.study.splitting import Estimate
from models import smart_cameras
from tests.conftest import refusal

AFTER, WITHIN = 20.0, 10.0


def late_cameras(seed: int = 0, **changes: Any) -> Simulation:
    parts: dict[str, Any] = {
        "dynamics": "continuous",
        "control_unit": Crossing(1.0),
        "channel": BroadcastChannel(latency.Exponential(0.3), 0.2),
        "agents": Fleet,
    }
    return Simulation(smart_cameras(0, 10), seed=seed, **{**parts, **changes})


def sight() -> _Sight:
    return _Sight(AFTER, 0.25, _Work())


def plain_peaks(simulation: Simulation, count: int) -> Any:
    """Peaks of total demand over the capacity, of runs with draws of their own: (count, m)."""
    start = simulation.start(AFTER + WITHIN)
    peaks = []
    for salt in range(count):
        run = start.fork(10_000 + salt)
        run.advance(to=AFTER)
        overshoot: Any = run.system.parts["overshoot"]
        overshoot.forget_peaks()
        run.advance()
        peaks.append(overshoot.peak_load())
    return np.array(peaks)


@pytest.mark.parametrize("method", ["fixed_effort", "restart"])
@pytest.mark.parametrize(
    "changes", [{}, {"dynamics": "discrete", "control_unit": Sampled(1.0)}], ids=["continuous", "discrete"]
)
def test_it_is_the_share_of_plain_runs_that_reach_the_level(changes: dict[str, Any], method: Any) -> None:
    simulation = late_cameras(**changes)
    peaks = plain_peaks(simulation, 150)[:, 1]
    level = float(np.quantile(peaks, 0.9))
    found = rare_event(
        simulation,
        level=level,
        within=WITHIN,
        after=AFTER,
        resource="disk",
        method=method,
        trials=20,
        repetitions=6,
        step=0.5,
    )
    plain = mean_interval((peaks >= level).astype(float))
    error = np.hypot(found.standard_error, plain.standard_error)
    assert abs(found.probability - plain.mean) < 3.5 * error
    assert error < 0.5 * plain.mean
    assert 0.0 < found.low < found.probability < found.high
    assert found.run_length == AFTER + WITHIN
    assert found.levels[-1] == level
    assert [each.mean for each in found.reached[-1:]] == [found.probability] * (method == "fixed_effort")


def test_the_same_arguments_give_the_same_estimate_and_other_seeds_another() -> None:
    asked: dict[str, Any] = {"level": 1.01, "within": 5.0, "after": 20.0, "trials": 10, "repetitions": 2}
    one = rare_event(late_cameras(), **asked)
    assert rare_event(late_cameras(), **asked) == one
    assert rare_event(late_cameras(seed=1), **asked) != one


def test_what_is_rarer_pays_more() -> None:
    """Far out in the tail plain runs would have to simulate many times as much for the same error."""
    asked: dict[str, Any] = {"within": WITHIN, "after": AFTER, "resource": "disk", "trials": 40}
    found = rare_event(late_cameras(), level=1.2, repetitions=3, **asked)
    assert 0.0 < found.probability < 5e-3
    assert found.gain > 2.0
    runs = (1.0 - found.probability) / (found.probability * found.relative_error**2)
    assert found.gain == pytest.approx(runs * 30.0 / (found.work + found.pilot_work))


def test_lower_levels_are_estimated_on_the_way() -> None:
    simulation = late_cameras()
    peaks = plain_peaks(simulation, 150)[:, 1]
    wanted = [float(np.quantile(peaks, share)) for share in (0.5, 0.8, 0.9)]
    found = rare_event(
        simulation,
        level=wanted[-1],
        via=wanted[:-1],
        within=WITHIN,
        after=AFTER,
        resource="disk",
        trials=20,
        repetitions=6,
    )
    assert len(found.reached) == len(found.levels)
    for level in wanted:
        one, plain = found.reached[found.levels.index(level)], mean_interval((peaks >= level).astype(float))
        assert abs(one.mean - plain.mean) < 3.5 * np.hypot(one.standard_error, plain.standard_error)
        assert 0.0 <= one.low <= one.mean <= one.high <= 1.0
    assert [one.mean for one in found.reached] == sorted((one.mean for one in found.reached), reverse=True)


@pytest.mark.parametrize("salt", range(3))
def test_a_path_is_split_where_it_passes_a_level_and_before_it_is_cut(salt: int) -> None:
    """All paths that are split from it would share the cut."""
    run = late_cameras().start(AFTER + WITHIN).fork(salt)
    path = _DemandPath(run, sight(), 1)
    assert path.reach(1.01)
    total = run.system.total("disk") / run.simulation.problem.capacity[1]
    assert total == pytest.approx(1.01, rel=1e-12)
    # Where it stands above the level already, as at the start of the time that counts, it goes no further.
    before = run.time
    assert path.reach(1.005)
    assert run.time == before


def test_paths_are_split_in_time_where_agents_are_away_and_return() -> None:
    """Nothing grows where the time that counts begins: what is to come must not be missed."""
    away = interventions.Absence(list(range(10)), AFTER - 1.0, AFTER + 3.0)
    run = late_cameras(interventions=[away]).start(AFTER + WITHIN).fork(0)
    path = _DemandPath(run, sight(), 1)
    assert path.reach(0.2)
    total = run.system.total("disk") / run.simulation.problem.capacity[1]
    assert total == pytest.approx(0.2, rel=1e-12)
    assert AFTER + 3.0 < run.time < AFTER + WITHIN


def test_an_event_that_only_the_pilot_has_seen_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interval from 0 to 0 would say that it is impossible."""
    none = Estimate(0.0, (0.0,))
    monkeypatch.setattr("aimd_des.study.rare_events.fixed_effort", lambda *_: none)
    asked: dict[str, Any] = {"within": 5.0, "after": AFTER, "trials": 10, "repetitions": 2}
    with pytest.raises(
        SimulationError, match=r"no path of 2 repetitions came to level = 1\.01, but the pilot"
    ):
        rare_event(late_cameras(), level=1.01, **asked)


def test_capacities_that_change_are_those_in_force() -> None:
    """A peak is held against the capacity at its time, not against that at the end."""
    asked: dict[str, Any] = {"level": 1.5, "within": 8.0, "after": AFTER, "resource": "disk"}
    half = 0.5 * smart_cameras(0, 10).capacity[1]
    dropped = late_cameras(interventions=[interventions.CapacityStep("disk", 25.0, half)])
    assert rare_event(dropped, trials=10, repetitions=2, **asked).probability == 1.0
    with pytest.raises(SimulationError, match="the level is out of reach"):
        rare_event(late_cameras(), trials=10, repetitions=2, **asked)


def test_misallocation_and_functions_are_looked_at_after_every_step() -> None:
    asked: dict[str, Any] = {"within": 5.0, "after": 20.0, "trials": 10, "repetitions": 2, "step": 1.0}
    off = rare_event(late_cameras(), level=0.05, measure="misallocation", **asked)
    assert off.probability == 1.0  # after twenty units no averages are that near

    def signals(run: Any) -> float:
        return float(run.totals()["signals"]["memory"])

    few = rare_event(late_cameras(), level=1.0, measure=signals, **asked)
    assert few.probability == 1.0
    with pytest.raises(SimulationError, match=r"came to .* and not to level = 1000"):
        rare_event(late_cameras(), level=1000.0, measure=signals, **asked)
    with pytest.raises(InputError, match="what measure gives back"):
        rare_event(late_cameras(), level=1.0, measure=lambda run: float("nan"), **asked)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"within": 0.0}, "within"),
        ({"level": float("nan")}, "level"),
        ({"trials": 9}, "trials"),
        ({"repetitions": 1}, "repetitions"),
        ({"step": 11.0}, "step"),
        ({"via": [1.1, 1.05]}, "via"),
        ({"via": [1.2]}, "via"),
        ({"after": -1.0}, "after"),
        ({"method": "luck"}, "method"),
        ({"measure": "cost"}, "measure"),
        ({"resource": "cpu"}, "cpu"),
        ({"confidence": 1.0}, "confidence"),
    ],
)
def test_bad_input_is_refused_by_name(changes: dict[str, Any], words: str) -> None:
    asked: dict[str, Any] = {"level": 1.2, "within": 10.0} | changes
    assert words in refusal(lambda: rare_event(late_cameras(), **asked))


def test_processes_are_refused() -> None:
    from aimd_des import AgentProcess

    processes = late_cameras(agents=AgentProcess)
    assert "Fleet" in refusal(lambda: rare_event(processes, level=1.2, within=10.0))
