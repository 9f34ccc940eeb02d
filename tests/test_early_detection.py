"""Random early detection: its signals are recomputed from totals and draws, and counted against theory."""

import math
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Fleet,
    InputError,
    Problem,
    Recording,
    Result,
    Simulation,
    interventions,
    theory,
)
from aimd_des.control_units import EarlyDetection
from aimd_des.lowlevel import Purpose, key, uniforms
from aimd_des.utils.validation import FloatArray
from models import smart_cameras
from tests.conftest import quadratic_problem, quietly, random_problem

SEED = 11


def run(problem: Problem, until: float, unit: EarlyDetection, **parts: Any) -> Result:
    """A run that keeps totals at the looks; behind a latency nothing changes between look and observer."""
    recording = Recording(demand=unit.period, events=True)
    channel = parts.pop("channel", BroadcastChannel(latency=0.375))
    parts = {"seed": SEED, "agents": Fleet, "channel": channel, "recording": recording, **parts}
    return quietly(Simulation(problem, control_unit=unit, **parts).run, until)


def probabilities(result: Result, low: float, high: float) -> FloatArray:
    """From the totals at the looks, shape (looks, m)."""
    totals = np.asarray(result.observations.total_demand)[:-1]
    return np.clip((totals / result.problem.limit - low) / (high - low), 0.0, 1.0)


def signals_at(result: Result, period: float) -> list[tuple[float, int]]:
    sent = result.signals_sent
    return [(time / period, j) for time, j in zip(sent.time.tolist(), sent.resource.tolist(), strict=True)]


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
def test_each_signal_is_that_of_the_total_and_the_draw(dynamics: str, agents: Any) -> None:
    problem, unit = random_problem(2, 5, 3), EarlyDetection(0.5, low=0.5, high=1.25)
    changes = [interventions.Failover(20.0, 5.0)]
    parts = {"dynamics": dynamics, "interventions": changes, "agents": agents}
    result = run(problem, 60.0, unit, **parts)
    chance, words = probabilities(result, 0.5, 1.25), key(SEED, Purpose.SENSING)
    expected = [
        (float(look), j)
        for look in range(120)
        for j in range(3)
        if not 40 <= look < 50 and uniforms(words, j, look, 1)[0] < chance[look, j]
    ]
    assert signals_at(result, 0.5) == expected
    assert len(expected) > 50
    assert ((chance > 0.05) & (chance < 0.95)).sum() > 50


def test_at_an_instant_it_looks_after_interventions_and_before_agents_tick() -> None:
    # The total is k before tick k; from 8 on, the capacity of 100 is 4: far above, so that a look signals.
    problem = quadratic_problem([1.0, 1.0], capacity=100.0, increase=0.5)
    changes = [interventions.CapacityStep(0, 8.0, 4.0)]
    channel = BroadcastChannel(loss=1.0)
    result = run(problem, 10.0, EarlyDetection(), interventions=changes, channel=channel)
    assert result.signals_sent.time.tolist() == [8.0, 9.0]
    assert result.events["value"][result.events["kind"] == "signal"].tolist() == [8.0, 9.0]


def test_signals_leave_a_sensing_delay_after_the_look() -> None:
    unit = EarlyDetection(low=0.5, high=1.0, sensing_delay=0.25)
    result = run(random_problem(2, 5, 1), 60.0, unit, dynamics="continuous")
    landed = result.events["time"][result.events["kind"] == "deliver"].unique()
    assert landed.tolist() == [time + 0.625 for time in result.signals_sent.time.tolist() if time < 59.375]


@pytest.fixture(scope="module")
def long() -> Result:
    """The paper's system for 4,000 looks behind a channel with latency and loss."""
    channel = BroadcastChannel(latency=0.375, loss=0.1)
    unit = EarlyDetection(1.0, low=0.4, high=1.4)
    return run(smart_cameras(0), 4000.0, unit, dynamics="continuous", channel=channel)


def z_of_signals(result: Result, low: float, high: float) -> FloatArray:
    """How far signals are from the sum of their probabilities, in standard errors of the martingale."""
    chance = probabilities(result, low, high)
    sent = result.signals_sent.counts(result.problem.n_resources)
    return np.asarray((sent - chance.sum(axis=0)) / np.sqrt((chance * (1.0 - chance)).sum(axis=0)))


def test_signals_are_as_frequent_as_their_probability(long: Result) -> None:
    assert (abs(z_of_signals(long, 0.4, 1.4)) < 4.0).all()
    # The negative control: a unit whose probability is higher by 0.05 at the same total.
    assert (abs(z_of_signals(long, 0.35, 1.35)) > 4.0).all()


def test_the_mean_total_is_what_theory_says_from_the_signals(long: Result) -> None:
    # docs/theory.md: E T / threshold = low + e (high - low), within the standard error of the martingale.
    after = 1000
    totals = np.asarray(long.observations.total_demand)[after:-1] / long.problem.limit
    chance = np.clip(totals - 0.4, 0.0, 1.0)
    assert ((chance > 0.0) & (chance < 1.0)).all()
    late = long.signals_sent.time >= after
    looks = len(totals)
    share = np.bincount(long.signals_sent.resource[late], minlength=3) / looks
    error = np.sqrt((chance * (1.0 - chance)).sum(axis=0)) / looks
    assert (abs(totals.mean(axis=0) - (0.4 + share)) < 4.0 * error).all()


def test_as_many_signals_are_needed_as_a_unit_with_a_threshold_needs(long: Result) -> None:
    # First order of theory at what is used, for a loss of 0.1; too high by about (1 - beta) lambda / 2.
    gradient = long.problem.costs.gradient(long.average_at_end).mean(axis=0)
    resources = long.problem.resources
    rate = [
        float(theory.signal_rate(part.increase, part.decrease, part.normalization, slope)) / 0.9
        for part, slope in zip(resources, gradient, strict=True)
    ]
    late = long.signals_sent.time >= 1000
    sent = np.bincount(long.signals_sent.resource[late], minlength=3) / 3000.0
    np.testing.assert_allclose(sent, rate, rtol=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.0}, "period = 0.0: must be a finite number greater than 0"),
        ({"low": -0.1}, "low = -0.1: must be a finite number at least 0"),
        ({"low": 1.0, "high": 1.0}, "high = 1.0: must be a finite number greater than 1"),
        ({"high": math.inf}, "high = inf: must be a finite number greater than 0.9"),
        ({"sensing_delay": -1.0}, "sensing_delay = -1.0: must be a finite number at least 0"),
    ],
)
def test_it_refuses_by_name(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        EarlyDetection(**options)
