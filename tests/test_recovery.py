"""After a capacity drop of 40 %, each averaging's recovery time against the formula.

Recovered is what is within 5 % of the new optimum.

Sixty agents with costs c x**2, whose response probabilities do not depend on averages, so that nothing but
the averages is slow. Replications have seeds 0 to 7, and a mean recovery time is held to within Z of its
standard errors besides what is listed in `allowed`.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from aimd_des import Crossing, Fleet, InputError, Problem, Recording, Sampled, Simulation, theory
from aimd_des.dynamics.averaging import Averaging, Cumulative, Forgetting, Polynomial, Window
from aimd_des.interventions import Absence, CapacityStep, Join, UnusualActivity
from aimd_des.problem.costs import PolynomialCosts
from models import smart_cameras
from tests.conftest import resource

# By Student's t with 7 degrees of freedom beyond once in 1,000.
Z = 5.4
SEEDS = range(8)
WITHIN, LEFT, AGE = 0.05, 0.6, 120.0
MEMORIES: dict[str, tuple[Averaging, dict[str, float]]] = {
    "cumulative": (Cumulative(), {}),
    "window": (Window(100.0, parts=100), {"window": 100.0}),
    "forgetting": (Forgetting(50.0), {"time_constant": 50.0}),
    "gain": (Polynomial(3.0), {"gain": 3.0}),
}


def system(capacity: float, agents: slice = slice(None), weights: Any = 1.0) -> Problem:
    """Optimal shares from 0.25 to 0.75 of the mean of 0.5 each, probabilities of 0.08 to 0.24."""
    memory = resource(capacity=capacity, increase=0.02, decrease=0.7, normalization=0.06)
    costs, names = weights * 0.5 / SHARE, [f"agent {i}" for i in range(60)]
    return Problem([memory], PolynomialCosts([2], costs[agents][..., None]), agent_names=names[agents])


SHARE = np.linspace(0.25, 0.75, 60)[:, None]
BEFORE = system(30.0)
AFTER = system(LEFT * 30.0)


def fall(probability: Any) -> float:
    """How much later the step is in effect on the clock: one signal a step takes its share of the total."""
    cut = 0.3 * float((probability * SHARE).sum() / SHARE.sum())
    looks = np.arange(1000)
    return float(np.maximum((1.0 - cut) ** looks - LEFT, 0.0).sum() / (1.0 - LEFT))


@lru_cache
def predicted(dynamics: Any) -> tuple[theory.Prediction, ...]:
    return tuple(theory.predict(problem, dynamics) for problem in (BEFORE, AFTER))


def expected(dynamics: Any, memory: dict[str, float], more: float = 0.0) -> float:
    """The formula, between the levels that are used; near the optimum is below 105 % of its capacity.

    `more` is added to what is used after the drop, as a share of it.
    """
    start, end = predicted(dynamics)
    before = float(start.utilisation[0] * BEFORE.capacity[0])
    after = float(end.utilisation[0] * AFTER.capacity[0]) * (1.0 + more)
    late = fall(start.probability) if dynamics == "discrete" else 0.0
    # Demand begins at 0: the averages lack a triangle, as far as they remember it.
    filling = float(BEFORE.capacity[0] / BEFORE.increase.sum())
    if "time_constant" in memory:
        missing = 0.5 * filling * math.exp(-AGE / memory["time_constant"]) / memory["time_constant"]
    else:
        gain = memory.get("gain", 1.0)
        missing = 0.0 if "window" in memory else (filling / AGE) ** gain / (gain + 1.0)
    within = (1.0 + WITHIN) * float(AFTER.capacity[0]) / after - 1.0
    return late + theory.recovery_time(before * (1.0 - missing), after, AGE + late, within=within, **memory)


def recovery(dynamics: Any, averaging: Averaging, seed: int, end: float) -> float:
    """Time from the drop until averages stay within 5 % of the optimum, to within half a unit of time."""
    capacity = float(AFTER.capacity[0])
    result = Simulation(
        BEFORE,
        dynamics=dynamics,
        control_unit=Crossing(0.0) if dynamics == "continuous" else Sampled(),
        agents=Fleet,
        averaging=averaging,
        interventions=[CapacityStep("memory", AGE, capacity)],
        seed=seed,
        recording=Recording(
            demand=np.arange(AGE, AGE + end), allocations=np.arange(AGE, AGE + end), overshoot=False
        ),
    ).run(AGE + end)
    level = result.demand["average"].to_numpy()[:-1] / capacity
    outside = np.flatnonzero(np.abs(level - 1.0) > WITHIN)
    found = float(outside[-1]) + 0.5
    assert abs(result.recovery(within=WITHIN)["recovery_time"][0] - found) <= 0.5
    return found


@pytest.fixture(scope="module", params=["continuous", "discrete"])
def recoveries(request: pytest.FixtureRequest) -> tuple[str, dict[str, list[float]]]:
    """Dynamics, and the recovery times of all replications for each averaging."""
    found = {}
    for name, (averaging, memory) in MEMORIES.items():
        end = math.ceil(1.15 * expected(request.param, memory) + 10.0)
        found[name] = [recovery(request.param, averaging, seed, float(end)) for seed in SEEDS]
    return request.param, found


def allowed(dynamics: Any, name: str, times: list[float]) -> float:
    """Z standard errors; half a unit of recording; a part of the window; 0.2 % of what is used."""
    memory = MEMORIES[name][1]
    doubt = max(
        abs(expected(dynamics, memory, more) - expected(dynamics, memory)) for more in (-0.002, 0.002)
    )
    error = float(np.std(times, ddof=1)) / math.sqrt(len(times))
    return Z * error + 0.5 + (1.0 if name == "window" else 0.0) + doubt


@pytest.mark.slow
@pytest.mark.parametrize("name", MEMORIES)
def test_recovery_takes_as_long_as_the_formula_says(
    name: str, recoveries: tuple[str, dict[str, list[float]]]
) -> None:
    dynamics, found = recoveries
    times = found[name]
    assert abs(np.mean(times) - expected(dynamics, MEMORIES[name][1])) < allowed(dynamics, name, times)
    # Negative control: the formula of every other averaging is refuted by the same runs, and so is that of a
    # memory which is a quarter longer.
    others = [memory for other, (_, memory) in MEMORIES.items() if other != name]
    longer = [{key: 1.25 * value for key, value in MEMORIES[name][1].items()}] if name != "cumulative" else []
    for memory in [*others, *longer]:
        assert abs(np.mean(times) - expected(dynamics, memory)) > allowed(dynamics, name, times)
    if dynamics == "continuous" and name != "window":  # the mean dynamics say the same
        ends = [theory.convergence(one, dynamics, averaging=MEMORIES[name][0]) for one in (BEFORE, AFTER)]
        (followed,) = theory.recovery(*ends, AGE).time(within=WITHIN)
        assert abs(np.mean(times) - followed) < allowed(dynamics, name, times)
    if (dynamics, name) == ("continuous", "cumulative"):  # nor is all of the capacity used
        plain = theory.recovery_time(float(BEFORE.capacity[0]), float(AFTER.capacity[0]), AGE, within=WITHIN)
        assert abs(np.mean(times) - plain) > allowed(dynamics, name, times)


# -- other steps: costs of agents, and agents that come and go ---------------------------------------------


MOST, REST = system(30.0, slice(0, 40)), range(40, 60)
LIGHTER = system(30.0, weights=np.where(np.arange(60) < 30, 0.5, 1.0)[:, None])
STEPS: dict[str, tuple[Problem, Problem, Any]] = {
    "capacity": (BEFORE, AFTER, CapacityStep("memory", AGE, float(AFTER.capacity[0]))),
    "costs": (BEFORE, LIGHTER, UnusualActivity(range(30), AGE, weight=0.5)),
    "leaving": (BEFORE, MOST, Absence(REST, AGE)),
    "joining": (MOST, BEFORE, Join(REST, AGE)),
}
SINCE = [20.0, 60.0, 180.0]


def test_predicted_recovery_times_keep_the_rules_of_measured_ones() -> None:
    start, end = (theory.convergence(one, "continuous") for one in (BEFORE, AFTER))
    found = theory.recovery(start, end, AGE)
    away = [float(found.average([found.time(within=near)[0]]).sum()) / 18.0 - 1.0 for near in (0.05, 0.2)]
    assert away == pytest.approx([0.05, 0.2], rel=0.02)  # a line between two looks
    half = float(found.average([0.0]).sum()) / 18.0 - 1.0
    assert found.time(within=0.2 / half, of="change") == pytest.approx(found.time(within=0.2), rel=1e-6)
    # Less capacity alone makes no misallocation with quadratic costs; nothing comes nearer than its bias.
    assert found.time("misallocation", 0.2).tolist() == [0.0]
    assert found.time("misallocation", 1e-4).tolist() == [math.inf]
    window = theory.convergence(AFTER, "continuous", averaging=Window(100.0))
    clock = theory.convergence(AFTER, "discrete")
    for other in (window, clock):
        with pytest.raises(InputError, match="averaging after"):
            theory.recovery(start, other, AGE)
    with pytest.raises(InputError, match="window"):
        theory.recovery(window, window, AGE)
    with pytest.raises(InputError, match="resources after"):
        theory.recovery(start, theory.convergence(smart_cameras(seed=0), "continuous"), AGE)


@pytest.mark.slow
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("averaging", [Cumulative(), Forgetting(50.0)], ids=["cumulative", "forgetting"])
def test_averages_go_the_way_that_the_mean_dynamics_say(step: str, averaging: Averaging) -> None:
    before, after, change = STEPS[step]
    start, end = (theory.convergence(one, "continuous", averaging=averaging) for one in (before, after))
    expected = theory.recovery(start, end, AGE).average(SINCE)[..., 0]
    here = [name in after.agent_names for name in BEFORE.agent_names]
    runs = []
    for seed in SEEDS:
        result = Simulation(
            BEFORE,
            dynamics="continuous",
            control_unit=Crossing(0.0),
            agents=Fleet,
            averaging=averaging,
            interventions=[change],
            seed=seed,
            recording=Recording(allocations=AGE + np.array(SINCE), overshoot=False),
        ).run(AGE + 200.0)
        runs.append(result.observations.average[: len(SINCE), 0, here])
    # How far along the way from the one place to the other averages are: 1 at its beginning, 0 at its end.
    now = expected[0] - expected[-1]
    ways = ((np.stack(runs) - expected[-1]) * now).sum(axis=2) / (now**2).sum()
    wanted = ((expected - expected[-1]) * now).sum(axis=1) / (now**2).sum()
    error = ways.std(axis=0, ddof=1) / math.sqrt(len(runs))
    assert (np.abs(ways.mean(axis=0) - wanted) < Z * error).all()
    # Negative control: with the other way of averaging they would be elsewhere.
    other = Forgetting(50.0) if isinstance(averaging, Cumulative) else Cumulative()
    start, end = (theory.convergence(one, "continuous", averaging=other) for one in (before, after))
    wrong = ((theory.recovery(start, end, AGE).average(SINCE)[..., 0] - expected[-1]) * now).sum(axis=1)
    assert (np.abs(ways.mean(axis=0) - wrong / (now**2).sum()) > Z * error).any()
