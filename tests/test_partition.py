"""After a partition, the run-away is at most n alpha times (its duration + latency).

The hold-off or the period of the looks is added where the first signal after the fault may have to wait for
it. Everything here is exact but for rounding: nothing is averaged, and processes and a fleet are held alike.
A fault that begins just as a threshold is crossed meets the bound.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    Problem,
    Recording,
    Sampled,
    Simulation,
    theory,
)
from aimd_des.interventions import CapacityStep, Failover, Partition
from aimd_des.problem.costs import PolynomialCosts
from tests.conftest import resource

# 24 agents hold 0.5 each; a signal takes about 9 % of that, and so outdoes the growth over a hold-off.
N, CAPACITY, INCREASE, HOLD_OFF = 24, 12.0, 0.025, 0.0625
GROWTH = N * INCREASE
SETTLED = 60.0
ROUNDING = 1e-9
DURATIONS, LATENCIES = [0.75, 5.0, 20.0], [0.0, 0.5, 1.25]


def system() -> Problem:
    share = np.linspace(0.3, 0.7, N)
    memory = resource(capacity=CAPACITY, increase=INCREASE, decrease=0.7, normalization=0.3)
    return Problem([memory], PolynomialCosts([2], (0.25 / share)[:, None, None]))


class Fault(NamedTuple):
    """A fault: which, of what duration, behind which latency, and when."""

    kind: type[Partition] | type[Failover]
    duration: float
    latency: float
    at: float
    dynamics: Any = "continuous"

    @property
    def wait(self) -> float:
        """The period or the hold-off; a unit that takes over knows of no hold-off."""
        if self.dynamics == "discrete":
            return 1.0
        return HOLD_OFF if self.kind is Partition else 0.0

    def bound(self, *, latency: bool = True) -> float:
        """With latencies in whole steps on the clock, rounded up."""
        late = (math.ceil(self.latency) if self.dynamics == "discrete" else self.latency) if latency else 0.0
        waits = "period" if self.dynamics == "discrete" else "hold_off"
        return float(theory.partition_runaway(system(), self.duration, late, **{waits: self.wait})[0])


def runaway(fault: Fault, agents: Any, seed: int = 0) -> float:
    """Highest total demand above the threshold from the beginning of the fault on."""
    # The capacity as it is, anew: peaks are counted from there.
    note = CapacityStep("memory", fault.at, CAPACITY)
    result = Simulation(
        system(),
        dynamics=fault.dynamics,
        control_unit=Sampled() if fault.dynamics == "discrete" else Crossing(HOLD_OFF),
        channel=BroadcastChannel(latency=fault.latency),
        agents=agents,
        interventions=[note, fault.kind(fault.at, fault.duration)],
        seed=seed,
        recording=Recording(demand="end"),
    ).run(fault.at + fault.duration + 10.0)
    return float(result.pieces["overshoot_peak"].iloc[-1] - 1.0) * CAPACITY


def crossing(dynamics: Any) -> tuple[float, float]:
    """When total demand first reaches the threshold, and how far it is below at that instant.

    On the clock: the first look after the last one below, before any signal has been sent.
    """
    if dynamics == "continuous":
        return CAPACITY / GROWTH, 0.0
    steps = math.floor(CAPACITY / GROWTH + ROUNDING)
    return float(steps + 1), CAPACITY - steps * GROWTH


KINDS: list[Any] = [Partition, Failover]
BOTH = ["continuous", "discrete"]


def whole(duration: float, dynamics: str) -> float:
    """The duration; on the clock in whole steps, rounded up."""
    return math.ceil(duration) if dynamics == "discrete" else duration


@pytest.mark.parametrize("dynamics", BOTH)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("latency", LATENCIES)
@pytest.mark.parametrize("duration", DURATIONS)
def test_the_runaway_is_at_most_the_growth_over_duration_and_latency(
    duration: float, latency: float, kind: Any, dynamics: str
) -> None:
    # Faults that begin anywhere in a cycle of a system that has settled, seeds 0 to 5.
    duration, step = whole(duration, dynamics), 1.0 if dynamics == "discrete" else 0.37
    for seed in range(6):
        fault = Fault(kind, duration, latency, SETTLED + step * seed, dynamics)
        rise = runaway(fault, Fleet, seed)
        assert rise <= fault.bound() + ROUNDING
    assert rise == runaway(fault, AgentProcess, seed)


@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
@pytest.mark.parametrize("dynamics", BOTH)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("latency", LATENCIES)
@pytest.mark.parametrize("duration", DURATIONS)
def test_a_fault_at_a_crossing_meets_the_bound(
    duration: float, latency: float, kind: Any, dynamics: str, agents: Any
) -> None:
    at, room = crossing(dynamics)
    fault = Fault(kind, whole(duration, dynamics), latency, at, dynamics)
    rise = runaway(fault, agents)
    assert rise <= fault.bound() + ROUNDING
    # The healed channel may carry a signal earlier than a hold-off after healing; that is the first order.
    early = GROWTH * HOLD_OFF if (kind, dynamics) == (Partition, "continuous") else 0.0
    assert rise >= fault.bound() - room - early - ROUNDING
    # Negative control: the bound without the latency is exceeded wherever there is one.
    if latency > 0.0:
        assert rise > fault.bound(latency=False) + ROUNDING


def looked_at(phase: float, at: float, duration: float, latency: float = 0.0) -> float:
    """Run-away of one continuous agent that always responds, with looks at phase + q."""
    memory = resource(capacity=1.0, increase=0.1, decrease=0.5, normalization=0.5)
    result = Simulation(
        Problem([memory], PolynomialCosts([2], [[[1.0]]])),
        dynamics="continuous",
        control_unit=Sampled(phase=phase),
        channel=BroadcastChannel(latency=latency),
        interventions=[CapacityStep("memory", at, 1.0), Partition(at, duration)],
        seed=0,
        recording=Recording(demand="end"),
    ).run(at + duration + 3.0)
    return float(result.pieces["overshoot_peak"].iloc[-1] - 1.0)


def test_the_runaway_of_looks_counts_in_whole_periods() -> None:
    # 60 random partitions, and one that is met: the look at 9.99 sees 0.999, the next one is not heard.
    rng = np.random.default_rng(0)
    problem = Problem([resource(capacity=1.0, increase=0.1)], PolynomialCosts([2], [[[1.0]]]))
    assert looked_at(0.99, 10.98, 0.02) == pytest.approx(0.199)
    cases = [
        (0.99, 10.98, 0.02, 0.0),
        *rng.uniform([0.0, 10.0, 0.0, 0.0], [1.0, 30.0, 3.0, 0.9], (60, 4)).tolist(),
    ]
    rooms, plain = [], []
    for phase, at, duration, latency in cases:
        rise = looked_at(phase, at, duration, latency)
        rooms.append(float(theory.partition_runaway(problem, duration, latency, period=1.0)[0]) - rise)
        plain.append(0.1 * (duration + latency + 1.0) - rise)
    assert min(rooms) >= -ROUNDING
    assert min(rooms) < 0.002
    # Negative control: the duration as it is bounds nothing.
    assert sum(room < -ROUNDING for room in plain) > 5


def test_half_of_the_agents_run_away_by_less() -> None:
    """Those who hear give way, so that the bound is far: negative control of the equality."""
    at, _ = crossing("continuous")
    looks = np.arange(at, at + 5.0, 0.25)
    result = Simulation(
        system(),
        dynamics="continuous",
        control_unit=Crossing(HOLD_OFF),
        agents=Fleet,
        interventions=[Partition(at, 5.0, list(range(0, N, 2)))],
        seed=0,
        recording=Recording(demand=looks),
    ).run(at + 5.0)
    assert result.demand["total"].max() - CAPACITY < 0.2 * Fault(Partition, 5.0, 0.0, at).bound()
