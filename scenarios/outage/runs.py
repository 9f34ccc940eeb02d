"""One outage of the paper's memory, what is measured of it, and what the means alone would do."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from aimd_des import BroadcastChannel, Recording, Result, solve_optimum, theory
from aimd_des.interventions import CapacityStep, Failover, Intervention, Partition
from aimd_des.lowlevel import FloatArray
from scenarios.common.measure import quietly, sensed
from scenarios.common.systems import memory_alone

# Growth and capacity are the same in all draws of the costs.
_PROBLEM = memory_alone()
N, CAPACITY = _PROBLEM.n_agents, float(_PROBLEM.capacity[0])
GROWTH = float(_PROBLEM.increase.sum())
# Every other camera: both halves have all kinds of costs.
HALF, OTHER = list(range(0, N, 2)), list(range(1, N, 2))
ALL, FAILOVER, PART = "everybody is cut off", "the control unit fails over", "half are cut off"
FAULTS = (ALL, FAILOVER, PART)
# What is watched before and after the fault, and how often totals and, so many times rarer, agents are kept.
BEFORE, AFTER, GRAIN, COARSE = 10.0, 100.0, 0.125, 8
# A capacity's worth of growth, which is also the time x / alpha in which agents find a new share.
PACE = CAPACITY / GROWTH


class Outage(NamedTuple):
    """An outage: which, for how long, behind which latency and with which hold-off, and when it begins."""

    fault: str
    duration: float
    latency: float
    hold_off: float
    at: float

    @property
    def interventions(self) -> list[Intervention]:
        """The fault, and a note of the capacity as it is, from which peaks count anew."""
        note = CapacityStep("memory", self.at, CAPACITY)
        if self.fault == FAILOVER:
            return [note, Failover(self.at, self.duration)]
        agents = HALF if self.fault == PART else None
        return [note, Partition(self.at, self.duration, agents)]

    @property
    def until(self) -> float:
        """The end, when everything has been watched."""
        return self.at + self.duration + AFTER

    @property
    def wait(self) -> float:
        """The longest wait for a signal after the fault: a unit that takes over knows of no hold-off."""
        return 0.0 if self.fault == FAILOVER else self.hold_off

    @property
    def bound(self) -> float:
        """The run-away over the capacity at most."""
        silent = theory.partition_runaway(_PROBLEM, self.duration, self.latency, hold_off=self.wait)
        return float(silent[0]) / CAPACITY


class Found(NamedTuple):
    """One run: peak above the capacity and its excess, beyond the ordinary, integrated; when it is back.

    `holdings` (q, 2) is what the even and the odd agents hold over their optimum, and `extra` (n,) what each
    agent got more than without the fault, in periods of its own optimum.
    """

    runaway: float
    excess: float
    back: float
    total: FloatArray
    holdings: FloatArray
    extra: FloatArray


@lru_cache
def _share(draw: int) -> FloatArray:
    """Compute the optimum of one draw of the costs, (n,)."""
    return np.asarray(solve_optimum(memory_alone(draw=draw)).allocation[:, 0])


def _run(case: Outage, draw: int, seed: int, interventions: list[Intervention]) -> Result:
    looks = np.arange(case.at - BEFORE, case.until, GRAIN)
    simulation = sensed(
        memory_alone(draw=draw),
        case.hold_off,
        channel=BroadcastChannel(latency=case.latency),
        interventions=interventions,
        seed=seed,
        recording=Recording(demand=looks, allocations=looks[::COARSE]),
    )
    return quietly(simulation, case.until)


def measure(settled: Outage, draw: int, seed: int) -> Found:
    """Run with the fault and without it, and measure what differs."""
    # Instants that fall evenly over the cycles from one signal to the next, which start alike.
    case = settled._replace(at=settled.at + GRAIN * round(5.0 * (0.618 * (draw + seed) % 1.0) / GRAIN))
    result, without = (
        _run(case, draw, seed, changes) for changes in (case.interventions, case.interventions[:1])
    )
    seen, share = result.observations, _share(draw)
    last, ordinary = (one.pieces.iloc[-1] for one in (result, without))
    total = seen.total_demand[:-1, 0] / CAPACITY
    healed = round((BEFORE + case.duration) / GRAIN)
    held = total[healed:] <= 1.0
    back = float(GRAIN * (held.argmax() - 0.5)) if held.any() and not held[0] else 0.0
    extra = (result.average_at_end - without.average_at_end)[:, 0] * case.until / share
    demand = seen.demand[:-1, 0]
    sides = [demand[:, agents].sum(axis=1) / share[agents].sum() for agents in (HALF, OTHER)]
    return Found(
        float(last["overshoot_peak"]) - 1.0,
        float(last["overshoot_mean"] - ordinary["overshoot_mean"]) * (case.until - case.at),
        back,
        total,
        np.stack(sides, axis=1),
        extra,
    )


@lru_cache
def _ordinary(latency: float, hold_off: float) -> tuple[float, FloatArray]:
    """Predict the mean total over the capacity without a fault, and response probabilities, for draw 0."""
    expected = theory.predict(_PROBLEM, "continuous", latency=latency, hold_off=hold_off)
    return float(expected.utilisation[0]), expected.probability[:, 0]


@lru_cache
def expected(case: Outage) -> tuple[float, float]:
    """Predict the mean run-away, and the time from healing until the total is back, from the means alone.

    Signals on their way keep the total at its mean until the latency is over; from then on everybody who is
    cut off grows. Agents that hear are cut at every hold-off while the total is above the capacity.
    """
    used, probability = _ordinary(case.latency, case.hold_off)
    cut = (1.0 - _PROBLEM.decrease[:, 0]) * probability
    demand, alpha = used * _share(0) * CAPACITY / _share(0).sum(), _PROBLEM.increase[:, 0]
    hears = np.isin(np.arange(N), OTHER) if case.fault == PART else np.zeros(N, dtype=bool)
    time, peak, heal = 0.0, -np.inf, case.duration + 0.5 * case.wait
    while time < heal:
        step = min(case.hold_off, heal - time)
        demand = demand + alpha * step
        time, peak = time + step, max(peak, float(demand.sum()))
        if demand.sum() > CAPACITY and time < heal:
            demand = np.where(hears, demand * (1.0 - cut), demand)
    back = case.latency + 0.5 * case.wait
    # Where it is more, what a latency costs without a fault.
    runaway = max(peak / CAPACITY - 1.0, case.latency / PACE)
    if demand.sum() <= CAPACITY:
        return runaway, np.nan
    demand = demand * (1.0 - cut)
    while demand.sum() > CAPACITY:
        demand = (demand + alpha * case.hold_off) * (1.0 - cut)
        back += case.hold_off
    return runaway, back
