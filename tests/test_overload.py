"""Demand that has run away from the capacity: when that is said, and when not."""

import tomllib
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    Problem,
    Recording,
    Sampled,
    Simulation,
    Study,
    run_study,
    run_synchronous,
)
from aimd_des.cli import main
from aimd_des.problem.costs import PolynomialCosts
from aimd_des.report import report_study
from aimd_des.results.overload import Opportunities, run_away
from aimd_des.results.run_data import Signals
from aimd_des.study import Axis
from aimd_des.utils.errors import OverloadWarning
from models import smart_cameras
from tests.conftest import INLINE, resource


def sent(times: Any) -> Signals:
    """Signals for one resource."""
    count = len(times)
    return Signals(np.asarray(times, dtype=float), np.zeros(count, dtype=int), np.arange(count))


@pytest.mark.parametrize(
    ("times", "mean", "away"),
    [
        (np.arange(0.0, 400.0), 1.06, True),
        (np.arange(0.0, 400.0), 1.05, False),
        (np.arange(0.0, 400.0), np.nan, False),
        (np.delete(np.arange(0.0, 400.0), np.arange(200, 400, 20)), 1.06, True),  # 95 %, in series of 19
        (np.delete(np.arange(0.0, 400.0), np.arange(200, 400, 19)), 1.06, False),
        (np.arange(0.0, 400.0, 2.0), 2.01, True),  # half of them, each alone
        (np.arange(0.0, 400.0, 2.0), 2.0, False),
        (np.arange(0.0, 400.0, 2.1), 2.01, False),
        (np.r_[np.arange(0.0, 200.0), 210.0 + np.arange(101)], 1.06, True),  # one series of 101
        (np.r_[np.arange(0.0, 200.0), 210.0 + np.arange(100)], 1.06, False),
        ([], 9.0, False),
    ],
)
def test_the_criterion_at_its_edges(times: Any, mean: float, away: bool) -> None:
    found = run_away(sent(times), np.array([mean]), 400.0, Opportunities(200, 1.0))
    assert found.tolist() == [away]


def test_few_opportunities_say_nothing() -> None:
    looks = np.arange(0.0, 38.0)
    assert not run_away(sent(looks), np.array([3.0]), 38.0, Opportunities(19, 1.0)).any()
    looks = np.arange(0.0, 40.0)
    assert run_away(sent(looks), np.array([3.0]), 40.0, Opportunities(20, 1.0)).all()


# Cases of the paper's cameras, and whether the first resource runs away.
CASES: list[tuple[dict[str, Any], bool]] = [
    ({"channel": {"latency": 500.0}}, True),
    ({"channel": {"latency": 4.0}}, False),
    ({"channel": {"latency": 20.0}}, False),
    ({"dynamics": "continuous", "channel": {"latency": 20.0}}, False),
    ({"dynamics": "continuous", "control_unit": Crossing(1.0), "channel": {"latency": 500.0}}, True),
    ({"dynamics": "continuous", "control_unit": Crossing(1.0), "channel": {"loss": 0.5}}, True),
    ({"dynamics": "continuous", "channel": {"loss": 0.5}}, True),
    ({"dynamics": "continuous", "control_unit": Crossing(1.0), "channel": {"loss": 0.34}}, False),
    ({"dynamics": "continuous", "control_unit": Crossing(1.0), "channel": {"loss": 0.3}}, False),
]


@pytest.mark.parametrize(("options", "away"), CASES, ids=str)
def test_runs_of_the_cameras(options: dict[str, Any], away: bool) -> None:
    given = {**options, "channel": BroadcastChannel(**options["channel"])}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = Simulation(smart_cameras(seed=0), agents=Fleet, seed=0, **given).run(3000)
    assert bool(result.run_away[0]) == away
    assert result.run_away.any() == away
    said = [str(one.message) for one in caught if one.category is OverloadWarning]
    assert len(said) == away
    assert all("run away from the capacity of memory (" in words for words in said)
    mean = result.observations.second_half[0]
    assert mean > 1.05 if away else mean < 1.2


@pytest.mark.parametrize("lag", [0, 1])
def test_the_second_half_is_measured_alike_by_all(lag: int) -> None:
    # All agents together grow by six times the capacity in a step: n alpha = 6 C.  An odd number of steps.
    costs = PolynomialCosts([2], np.ones((6, 1, 1)))
    problem = Problem([resource(capacity=1.0, increase=1.0, normalization=0.05)], costs)
    ways: list[Any] = [AgentProcess, Fleet]
    with pytest.warns(OverloadWarning, match="memory"):
        plain = run_synchronous(problem, steps=301, seed=0, lag=lag)
    assert plain.run_away.all()
    demand = run_discrete_totals(problem, lag)
    # x(k) is held over (k - 1, k]: half of x(151), and all to the end.
    assert plain.observations.second_half == pytest.approx((0.5 * demand[151] + demand[152:].sum()) / 150.5)
    for agents in ways:
        with pytest.warns(OverloadWarning):
            run = Simulation(
                problem, channel=BroadcastChannel(latency=float(lag)), agents=agents, seed=0
            ).run(301)
        assert run.observations.second_half == pytest.approx(plain.observations.second_half, rel=1e-12)


def test_a_warning_is_of_the_line_that_has_asked_for_the_run() -> None:
    costs = PolynomialCosts([2], np.ones((6, 1, 1)))
    problem = Problem([resource(capacity=1.0, increase=1.0, normalization=0.05)], costs)
    simulation = Simulation(problem, seed=0)
    ways: list[Any] = [
        lambda: simulation.run(101),
        lambda: simulation.start(101).result(),
        lambda: run_synchronous(problem, steps=101, seed=0, lag=0),
    ]
    for way in ways:
        with pytest.warns(OverloadWarning) as caught:
            way()
        assert {one.filename for one in caught} == {__file__}


def run_discrete_totals(problem: Problem, lag: int) -> Any:
    """Total demand at every step."""
    with pytest.warns(OverloadWarning):
        run = run_synchronous(problem, steps=301, seed=0, lag=lag, recording=Recording(demand=1.0))
    return run.observations.total_demand[:, 0]


@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
def test_the_second_half_of_a_line(agents: Any) -> None:
    # Nobody answers: demand is 0.2 t, its mean over [10, 20) is 3 over the capacity of 1.
    problem = Problem([resource(capacity=1.0, increase=0.1)], PolynomialCosts([2], np.ones((2, 1, 1))))
    channel = BroadcastChannel(latency=100.0)
    given: dict[str, Any] = {"dynamics": "continuous", "channel": channel, "agents": agents, "seed": 0}
    result = Simulation(problem, control_unit=Sampled(2.0), **given).run(20.0)
    assert result.observations.second_half == pytest.approx([3.0])
    assert not result.run_away.any()  # five looks say nothing
    with pytest.warns(OverloadWarning):
        Simulation(problem, control_unit=Sampled(0.5), **given).run(20.0)
    silent = Simulation(problem, control_unit=Sampled(0.5), recording=Recording(overshoot=False), **given)
    assert np.isnan(silent.run(20.0).observations.second_half).all()


def test_the_command_line_says_it_in_one_line(tmp_path: Path) -> None:
    scenario = tmp_path / "late.toml"
    scenario.write_text(
        """until = 40.0
seed = 0
dynamics = "continuous"

[control_unit]
kind = "sampled"
period = 0.5

[channel]
latency = 100.0

[[resources]]
name = "memory"
capacity = 1.0
increase = 0.1
decrease = 0.5
normalization = 0.02

[costs]
exponents = [2]
coefficients = [[[1.0]], [[1.0]]]
"""
    )
    done = CliRunner().invoke(main, ["run", str(scenario), "--out", str(tmp_path / "out"), "--no-figures"])
    assert done.exit_code == 0, done.output
    (line,) = [line for line in done.output.splitlines() if line.startswith("Warning: ")]
    assert "run away from the capacity of memory (6 of it)" in line
    page = tmp_path / "page.html"
    done = CliRunner().invoke(main, ["report", str(tmp_path / "out"), "--out", str(page)])
    assert done.exit_code == 0, done.output
    assert "Demand has run away from the capacity of " in page.read_text(encoding="utf-8")


def test_a_study_says_in_how_many_runs(tmp_path: Path) -> None:
    base = {**{key: value for key, value in tomllib.loads(INLINE).items() if key != "seed"}, "until": 300}
    axis = Axis(name="latency", key="channel.latency", values=[0.5, 150.0])
    study = Study(scenario=base, axes=[axis], replications=2)
    with ThreadPoolExecutor(1) as pool, pytest.warns(OverloadWarning) as caught:
        results = run_study(study, tmp_path / "study", pool, 1)
    assert list(results.run_away["latency"]) == [150.0, 150.0]
    names = list(results.run_away["resources"])
    assert all(name in {"memory", "disk", "memory, disk"} for name in names)
    sentence = f"in 2 of 4 runs (first: latency 150.0, replication 0, {names[0]}): signals come too late"
    assert len(caught) == 1
    assert sentence in str(caught[0].message)
    page = report_study(results)
    assert sentence in page.notes[0]
    with ThreadPoolExecutor(1) as pool, warnings.catch_warnings():
        warnings.simplefilter("error")
        held = run_study(Study(scenario=base), tmp_path / "held", pool, 1)
    assert held.run_away.empty
    assert report_study(held).notes == []
