"""The limit cycle behind a latency: against mean paths followed one by one, and against simulation."""

import heapq
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, PolynomialCosts, Problem, Resource, theory
from aimd_des.channel.broadcast import BroadcastChannel
from aimd_des.study import mean_and_error
from scenarios.common.measure import distance, late, run_late
from scenarios.common.systems import memory_alone

MEMORY = memory_alone()


def squares() -> Problem:
    """Agents whose response probabilities do not depend on their averages."""
    weights = np.linspace(1.0, 3.0, 30)[:, None, None]
    return Problem([Resource("memory", 16.0, 0.025, 0.7, 1 / 30)], PolynomialCosts([2], weights))


def follow(problem: Problem, hold_off: float, latency: float, until: float) -> tuple[float, Any]:
    """Follow the means of all agents from signal to signal; signals a unit of time and averages, late."""
    alpha, limit = problem.increase[:, 0], problem.limit[0]
    kappa = 0.3 / 30 * 2.0 * np.linspace(1.0, 3.0, 30)
    demand = limit * (1 / kappa) / (1 / kappa).sum() * 0.9
    arrivals: list[float] = []
    time = free = 0.0
    signals, integral, start = 0, np.zeros(len(alpha)), 0.5 * until
    while time < until:
        broadcast = max(free, time + max(limit - demand.sum(), 0.0) / alpha.sum())
        now = min(broadcast, arrivals[0] if arrivals else until, until)
        if time >= start:
            integral += (now - time) * (demand + 0.5 * alpha * (now - time))
        demand, before, time = demand + alpha * (now - time), time, now
        if before < start <= now:
            start = now
        if arrivals and arrivals[0] <= now:
            heapq.heappop(arrivals)
            demand *= 1.0 - kappa
        elif now < until:
            free = now + hold_off
            heapq.heappush(arrivals, now + latency)
            signals += now >= start
    return signals / (until - start), integral / (until - start)


@pytest.mark.parametrize(("hold_off", "latency"), [(0.1, 5.0), (0.25, 5.0), (0.5, 15.0)])
def test_the_cycle_of_mean_paths(hold_off: float, latency: float) -> None:
    """A row is a whole number of signals there, and the formula may be one off: by 1 / row of them."""
    problem = squares()
    found = theory.limit_cycle(problem, hold_off, latency)
    signals, average = follow(problem, hold_off, latency, 200.0 * float(found.period[0]))
    off = 1.0 / float(found.row[0])
    assert signals == pytest.approx(float(found.signals[0]), rel=off)
    assert average.sum() == pytest.approx(float(found.allocation.sum()), rel=off)
    assert average / average.sum() == pytest.approx(found.allocation[:, 0] / found.allocation.sum(), rel=off)
    # Negative control: one signal for each crossing, as there is behind a hold-off as long as the latency.
    kappa = 0.3 / 30 * 2.0 * np.linspace(1.0, 3.0, 30)
    lone = 0.025 * (16.0 + 0.75 * latency) / (0.025 / kappa).sum() * (1.0 / kappa - 0.5).sum()
    assert abs(average.sum() / lone - 1.0) > 2.0 * off


def test_one_signal_a_crossing_is_the_balance_without_repeats() -> None:
    """Each signal finds y = alpha T / kappa, and averages are half of what grows in T below."""
    problem = squares()
    found = theory.limit_cycle(problem, hold_off=0.5, latency=0.5)
    kappa = 0.3 / 30 * 2.0 * np.linspace(1.0, 3.0, 30)
    period = (16.0 + 0.75 * 0.5) / (0.025 / kappa).sum()
    assert found.row[0] == 1.0
    assert found.period[0] == pytest.approx(period)
    assert found.allocation[:, 0] == pytest.approx(0.025 * period * (1.0 / kappa - 0.5))
    assert found.highest[0] == pytest.approx(1.0 + 0.75 * 0.5 / 16.0)


@pytest.mark.parametrize(
    ("hold_off", "latency", "loss"), [(0.1, 2.0, 0.0), (0.25, 10.0, 0.0), (0.25, 10.0, 0.3)]
)
def test_the_cycle_in_simulation(hold_off: float, latency: float, loss: float) -> None:
    """Memory alone, 4 runs: signals and use within 3 % of theory, shares within a point, and 4 errors more.

    That a run's noise alone puts averages 1.3 % from the optimum does not matter at this distance: it adds in
    squares.
    """
    expected = theory.limit_cycle(MEMORY, hold_off, latency, loss=loss)
    channel = BroadcastChannel(latency=latency, loss=loss)
    runs = [
        late(run_late(MEMORY, hold_off, channel, (500.0, 4000.0), seed, "end"), 500.0) for seed in range(4)
    ]
    for measured, wanted in (("signals", expected.signals), ("utilisation", expected.utilisation)):
        mean, error = mean_and_error([getattr(run, measured) for run in runs])
        assert abs(mean / wanted[0] - 1.0) < 0.03 + 4.0 * error / wanted[0]
    mean, error = mean_and_error([distance(MEMORY, run.average)[0] for run in runs])
    wanted = distance(MEMORY, expected.allocation)[0]
    assert abs(mean - wanted) < 0.01 + 4.0 * error
    # Negative controls: the prediction without latency has neither.
    assert wanted > 0.02
    assert (
        abs(expected.utilisation[0] - theory.predict(MEMORY, "continuous", loss=loss).utilisation[0]) > 0.05
    )


def test_the_bias_shrinks_with_the_latency_and_then_turns_round() -> None:
    def small(latency: float) -> float:
        """What the ten smallest cameras hold, over their optimum."""
        found = theory.limit_cycle(MEMORY, 0.25, latency).allocation
        best = theory.reweighted_optimum(MEMORY, np.ones(60), capacity=found.sum(axis=0)).allocation
        least = np.argsort(best[:, 0])[:10]
        return float(found[least].sum() / best[least].sum())

    ratios = [small(latency) for latency in (0.0, 1.0, 2.0, 5.0)]
    assert ratios == sorted(ratios)
    assert ratios[0] < 1.0 < ratios[-1]


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_bounds_of_the_hold_off(loss: float) -> None:
    shortest, longest = theory.hold_off_bounds(MEMORY, 5.0, loss=loss, taken=0.7)
    rho = theory.needed_rate(MEMORY)
    assert theory.critical_loss(rho, "continuous", hold_off=longest) == pytest.approx(loss)
    lift = theory.peak_lift(60, MEMORY.increase[0], 5.0) / MEMORY.capacity
    assert (1.0 - loss) * lift / (rho * shortest) == pytest.approx(0.7)
    # The latency is enough, since one signal is sent then; and loss leaves the ratio as it is.
    assert theory.hold_off_bounds(MEMORY, 0.1, taken=0.01)[0] == pytest.approx(0.1)
    plain = theory.hold_off_bounds(MEMORY, 5.0, taken=0.7)
    assert shortest / longest == pytest.approx(plain[0] / plain[1])
    # No hold-off will do where everybody together grows by X of the capacity over the latency.
    edge = 0.7 * 5.0 / float(lift[0])
    assert theory.hold_off_bounds(MEMORY, edge)[0] == pytest.approx(theory.hold_off_bounds(MEMORY, edge)[1])


def test_the_shortest_hold_off_keeps_the_shares() -> None:
    """Theory alone: the bias at X = 0.7 is within 0.3 points of that without latency, at 2 far beyond."""
    plain = distance(MEMORY, theory.limit_cycle(MEMORY, 1.0, 0.0).allocation)[0]
    for latency in (1.0, 2.0, 5.0, 10.0):
        kept, broken = (
            distance(MEMORY, theory.limit_cycle(MEMORY, float(hold_off[0]), latency).allocation)[0]
            for hold_off in (theory.hold_off_bounds(MEMORY, latency, taken=taken)[0] for taken in (0.7, 2.0))
        )
        assert abs(kept - plain) < 0.003
        assert broken > plain + 0.01


def test_a_hold_off_beyond_one_over_rho_has_no_cycle() -> None:
    with pytest.raises(InputError, match="demand runs away"):
        theory.limit_cycle(MEMORY, 2.0, 5.0)
