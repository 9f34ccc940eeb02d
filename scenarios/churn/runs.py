"""Cameras that come and go, one after the other or a quarter together: runs, and what is expected of them."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from aimd_des import BroadcastChannel, Recording, Result, solve_optimum, theory
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import Absence, Crash, Intervention
from aimd_des.latency import Constant
from aimd_des.lowlevel import FloatArray
from scenarios.common.measure import distance, quietly, sensed
from scenarios.common.presence import PRESENT, schedule
from scenarios.common.systems import alike, memory_alone

# Growth and capacity are the same in all draws of the costs.
_PROBLEM = memory_alone()
N, ALPHA, CAPACITY = _PROBLEM.n_agents, float(_PROBLEM.increase[0, 0]), float(_PROBLEM.capacity[0])
LATENCY = HOLD_OFF = 0.5
#: Of those who are present on average: what they can grow to before they go is the capacity.
CRITICAL_STAY = CAPACITY / (PRESENT * N * ALPHA)
#: Who leaves together.
GROUP = tuple(range(0, N, 4))
# Looks at the total after that.
_LOOKS, _SPAN = 0.05, 30.0


class _Way(NamedTuple):
    returns: type[Absence] | type[Crash]
    averaging: Averaging


#: Cameras keep their averages, over all of the time for which they were there.
KEPT = "all of the past"
WAYS = {
    KEPT: _Way(Absence, Cumulative()),
    "window, 200": _Way(Absence, Window(200.0)),
    "forgetting, 100": _Way(Absence, Forgetting(100.0)),
    "all since a crash": _Way(Crash, Cumulative()),
}
QUADRATIC, STEEP, STAYED = (
    "returning, quadratic costs",
    "returning, costs of power 6",
    "those who stayed",
)
FORGOT: dict[str, type[Absence] | type[Crash]] = {"average kept": Absence, "average forgotten": Crash}


class Case(NamedTuple):
    """A way of averaging and returning, the mean stay of a camera, and the end, in units of time."""

    way: str
    stay: float
    until: float

    @property
    def start(self) -> float:
        """From when on the run is measured."""
        return 0.375 * self.until


class Times(NamedTuple):
    """When a quarter leaves together, when it is back, the end, and how often allocations are kept."""

    leave: float = 400.0
    back: float = 500.0
    end: float = 800.0
    every: float = 5.0

    @property
    def looks(self) -> FloatArray:
        """When allocations are kept."""
        return np.asarray(np.arange(self.leave - 50.0, self.end + 0.5 * self.every, self.every))


class Seen(NamedTuple):
    """What is seen of one run."""

    signals: float  # per unit of time, after the start
    utilisation: float  # mean total demand over the capacity, after the start
    high: float  # what total demand is below for 99 % of the time, over the capacity
    above: float  # share of the time above the capacity
    # Relative error of the averages of those present against their optimum, in the mean over time.
    tracking: float
    # Of averages at the end: from the optimum for what is used, and from that which churn makes of it.
    from_plain: float
    from_churned: float


class Together(NamedTuple):
    """What is seen of a run in which a quarter leaves together."""

    # (q, n): Of all cameras, in units of the resource.
    demand: FloatArray
    average: FloatArray
    again: float  # time until the total is where it was, or at the capacity
    # What was released over the growth of those who stay, which is the time that it should take.
    released: float


def measure(case: Case, draw: int, seed: int) -> Seen:
    """Run with a draw of the costs."""
    returns, averaging = WAYS[case.way]
    looks = np.arange(case.start, case.until + 1.0, 25.0)
    recording = Recording(demand=0.25, allocations=looks)
    changes = schedule(case.stay, case.until, returns, seed)
    result = _run(draw, averaging, changes, recording, case.until, seed)
    seen, sent, average = result.observations, result.signals_sent, result.average_at_end
    total = seen.total_demand[seen.demand_times >= case.start, 0] / CAPACITY
    share = steady(case.stay, draw).share
    return Seen(
        signals=float((sent.time >= case.start).sum() / (case.until - case.start)),
        utilisation=float(total.mean()),
        high=float(np.quantile(total, 0.99)),
        above=float(seen.overshoot.time[0]),
        tracking=float(result.tracking["relative_error"].mean()),
        from_plain=float(distance(memory_alone(draw=draw), average)[0]),
        from_churned=float(np.abs(average[:, 0] / average.sum() - share / share.sum()).sum()),
    )


def _run(
    draw: int,
    averaging: Averaging,
    interventions: Sequence[Intervention],
    recording: Recording,
    until: float,
    seed: int,
) -> Result:
    simulation = sensed(
        memory_alone(draw=draw),
        HOLD_OFF,
        channel=BroadcastChannel(latency=Constant(LATENCY)),
        averaging=averaging,
        interventions=interventions,
        seed=seed,
        recording=recording,
    )
    return quietly(simulation, until)


def leave_together(case: tuple[str, Times], draw: int, seed: int) -> Together:
    """Let a quarter of the cameras leave and come back, with or without their averages."""
    name, times = case
    before, after = times.leave - 1e-6, times.leave + np.arange(round(_SPAN / _LOOKS) + 1) * _LOOKS
    recording = Recording(demand=np.append(before, after), allocations=times.looks, overshoot=False)
    leaves = FORGOT[name](list(GROUP), times.leave, times.back)
    seen = _run(draw, Cumulative(), [leaves], recording, times.end, seed).observations
    total = seen.total_demand[: len(after) + 1, 0]
    again = np.argmax(total[1:] >= min(total[0], CAPACITY))
    released = (total[0] - total[1]) / (ALPHA * (N - len(GROUP)))
    return Together(seen.demand[:, 0], seen.average[:, 0], float(again * _LOOKS), float(released))


@lru_cache
def steady(stay: float, draw: int = 0) -> theory.Churn:
    """Predict the steady state with a mean stay."""
    return theory.churn(memory_alone(draw=draw), stay, PRESENT, LATENCY)


@lru_cache
def _level(draw: int) -> float:
    expected = theory.predict(memory_alone(draw=draw), "continuous", latency=LATENCY)
    return float(expected.utilisation[0]) * CAPACITY


@lru_cache
def optimum(draw: int = 0) -> FloatArray:
    """Compute the optimum of all cameras for what is used without churn, (n,)."""
    best = solve_optimum(memory_alone(draw=draw), capacity=np.array([_level(draw)]))
    return np.asarray(best.allocation[:, 0])


@lru_cache
def kinds(draw: int = 0) -> dict[str, list[int]]:
    """Sort cameras by who comes back, with which costs, and who has stayed."""
    problem = memory_alone(draw=draw)
    return {
        QUADRATIC: [i for i in alike(problem, 1.0) if i in GROUP],
        STEEP: [i for i in alike(problem, 5.0) if i in GROUP],
        STAYED: [i for i in range(N) if i not in GROUP],
    }


@lru_cache
def fluid(name: str, times: Times, draw: int = 0) -> tuple[FloatArray, FloatArray]:
    """Compute what the fluid does where a quarter leaves together: demand and averages, (q, n)."""
    away = theory.Spell(times.leave, times.back, GROUP, forgets=FORGOT[name] is Crash)
    path = theory.flow(memory_alone(draw=draw), _level(draw), times.end, spells=[away])
    # Observers look just after an intervention.
    at = np.minimum(np.searchsorted(path.time, times.looks) + 1, len(path.time) - 1)
    return path.demand[at], path.average[at]
