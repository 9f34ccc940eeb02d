"""Whole random runs are held against a second simulator that shares no code with the framework."""

import random
import warnings
from collections.abc import Iterable
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
    averaging,
    compensation,
    interventions,
    latency,
    loss,
)
from aimd_des.problem.costs import Costs, weighted_costs
from aimd_des.utils.errors import OverloadWarning
from tests.conftest import quietly, random_problem
from tests.support import second_simulator
from tests.support.second_simulator import Outcome, Setting, simulate

# -- settings, at random -----------------------------------------------------------------------------------


def each(rng: random.Random, n: int, low: float, high: float) -> Any:
    """One number for all agents, or one for each."""
    return rng.uniform(low, high) if rng.random() < 0.5 else [rng.uniform(low, high) for _ in range(n)]


def a_channel(rng: random.Random, n: int) -> dict[str, Any]:
    """Latency, loss, duplication and order."""
    late = rng.choice(
        [
            ("constant", 0.0),
            ("constant", each(rng, n, 0.0, 2.0)),
            ("uniform", each(rng, n, 0.0, 1.0), each(rng, n, 1.0, 3.0)),
            ("exponential", each(rng, n, 0.1, 2.0)),
        ]
    )
    lost = rng.choice(
        [
            ("chance", 0.0),
            ("chance", each(rng, n, 0.0, 0.7)),
            ("bursts", each(rng, n, 0.1, 0.6), each(rng, n, 0.3, 4.0)),
        ]
    )
    return {
        "latency": late,
        "loss": lost,
        "duplication": rng.choice([0.0, each(rng, n, 0.1, 0.9)]),
        "fifo": rng.random() < 0.4,
    }


def clocks_of(rng: random.Random, n: int) -> Any:
    """Clocks in phase, or as different as may be."""
    if rng.random() < 0.3:
        return [1.0] * n, [0.0] * n, [0.0] * n, [0.0] * n
    period = rng.choice([[1.0] * n, [rng.uniform(0.4, 1.5) for _ in range(n)]])
    phase = rng.choice([None, [rng.choice([0.0, 0.25, 0.5]) for _ in range(n)]])
    drift = rng.choice([[0.0] * n, [rng.uniform(-0.1, 0.1) for _ in range(n)]])
    jitter = rng.choice([[0.0] * n, [rng.uniform(0.0, 0.3) for _ in range(n)]])
    return period, phase, drift, jitter


def redrawn(problem: Problem) -> Any:
    """The k-th costs: those of each agent times 1, 2 or 3."""
    return lambda k: weighted_costs(problem.costs, [1.0 + (k + i) % 3 for i in range(problem.n_agents)])


def changes_of(rng: random.Random, problem: Problem, until: float) -> list[tuple[Any, ...]]:
    """Interventions of all kinds; an agent has one absence at most."""
    n, m = problem.n_agents, problem.n_resources

    def time() -> float:
        return rng.choice([rng.uniform(0.0, until), float(rng.randrange(int(until)))])

    def capacity(j: int) -> float:
        return float(problem.capacity[j]) * rng.uniform(0.4, 1.5)

    def one() -> tuple[Any, ...]:
        j, i, at = rng.randrange(m), rng.randrange(n), time()
        long = rng.choice([1.0, 3.0, rng.uniform(0.1, until / 2)])
        table = [0.5, 1.5 + 2 * rng.random(), 4.0]
        kinds: list[tuple[Any, ...]] = [
            ("step", j, at, capacity(j)),
            ("ramp", j, at, at + long, capacity(j), rng.randrange(1, 6)),
            ("profile", j, table, [capacity(j) for _ in table], rng.choice([None, rng.uniform(4.5, 9.0)])),
            ("activity", i, at, rng.choice([None, at + long]), rng.choice([0.3, 2.0])),
            ("prices", rng.uniform(3.0, 12.0), redrawn(problem)),
            ("failover", at, long),
            ("partition", at, long, rng.sample(range(n), rng.randrange(1, n + 1))),
        ]
        return rng.choice(kinds)

    def gone(i: int) -> tuple[Any, ...]:
        at, long = time(), rng.uniform(0.2, until / 2)
        back = rng.choice([None, at + long, at + long])
        return rng.choice(
            [
                ("absence", i, at, back, False),
                ("absence", i, at, back, True),
                ("absence", i, 0.0, at + 1.0, True),
            ]
        )

    away = [gone(i) for i in rng.sample(range(n), rng.choice([0, 0, min(n, 2)]))]
    changes = [*away, *(one() for _ in range(rng.choice([0, 1, 2, 4])))]
    rng.shuffle(changes)
    return changes


def a_setting(seed: int, dynamics: str, until: float = 30.0) -> Setting:
    """A random run."""
    rng = random.Random(seed)
    n, m = rng.randrange(1, 7), rng.randrange(1, 4)
    family = rng.choice(["polynomial", "polynomial", "coupled"])
    problem = random_problem(seed, n, m, family, per_agent=rng.random() < 0.5, threshold=rng.random() < 0.5)
    delay = rng.choice([0.0, 0.0, rng.uniform(0.1, 1.5)])
    unit = ("sampled", rng.choice([1.0, 0.5, rng.uniform(0.3, 1.5)]), rng.choice([0.0, 0.25]), delay)
    if dynamics == "continuous" and rng.random() < 0.6:
        hold_off = rng.uniform(0.1, 1.5)
        unit = ("crossing", hold_off, hold_off * rng.choice([1.0, 1.0, 4.0]), delay)
    discrete = dynamics == "discrete"
    window = ("window", *rng.choice([(4.0, 4), (10.0, 2), (6.0, 3)]))
    known = ("known", [rng.uniform(0.0, 0.6) for _ in range(n)])
    return Setting(
        problem=problem,
        seed=seed,
        until=until,
        clocks=clocks_of(rng, n) if discrete else None,
        unit=unit,
        **a_channel(rng, n),
        average=rng.choice([("all",), ("all",), window, ("forgetting", rng.uniform(2.0, 10.0))]),
        compensation=rng.choice([None, None, known, ("estimated",)]),
        changes=changes_of(rng, problem, until) if rng.random() < 0.7 else [],
        looks=[0.0, 2.5, 10.0, until - 3.0],
    )


# -- the same in the words of the framework ------------------------------------------------------------------


def intervention(name: str, *given: Any) -> Any:
    """What the framework calls a change."""
    if name == "absence":
        agent, at, until, anew = given
        if anew and at == 0.0 and until is not None:
            return interventions.Join(agent, until)
        return (interventions.Crash if anew else interventions.Absence)(agent, at, until)
    kinds: dict[str, Any] = {
        "step": interventions.CapacityStep,
        "ramp": interventions.CapacityRamp,
        "profile": interventions.CapacityProfile,
        "activity": interventions.UnusualActivity,
        "prices": interventions.Prices,
        "failover": interventions.Failover,
        "partition": interventions.Partition,
    }
    return kinds[name](*given)


def framework(setting: Setting, **parts: Any) -> Result:
    """Run the framework, by processes unless said."""
    kind, *numbers = setting.unit
    if kind == "sampled":
        unit: Any = Sampled(*numbers)
    else:
        unit = Crossing(numbers[0], numbers[2], None if numbers[1] == numbers[0] else numbers[1])
    delays = {"constant": latency.Constant, "uniform": latency.Uniform, "exponential": latency.Exponential}
    losses = {"chance": loss.Bernoulli, "bursts": loss.GilbertElliott}
    averages: dict[str, Any] = {
        "all": averaging.Cumulative,
        "window": averaging.Window,
        "forgetting": averaging.Forgetting,
    }
    answers = {"known": compensation.KnownLoss, "estimated": compensation.EstimatedLoss}
    clocks = setting.clocks
    simulation = Simulation(
        setting.problem,
        dynamics="continuous" if clocks is None else "discrete",
        control_unit=unit,
        channel=BroadcastChannel(
            delays[setting.latency[0]](*setting.latency[1:]),
            losses[setting.loss[0]](*setting.loss[1:]),
            setting.duplication,
            setting.fifo,
        ),
        clocks=clocks and Clocks(clocks[0], "random" if clocks[1] is None else clocks[1], *clocks[2:]),
        averaging=averages[setting.average[0]](*setting.average[1:]),
        compensation=setting.compensation and answers[setting.compensation[0]](*setting.compensation[1:]),
        interventions=[intervention(*change) for change in setting.changes],
        seed=setting.seed,
        recording=Recording(demand=setting.looks, allocations=setting.looks, events=True),
        **parts,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverloadWarning)  # random runs may lose all that they send
        return quietly(simulation.run, setting.until)


# -- both are held against each other ------------------------------------------------------------------------


def close(one: Any, other: Any, what: str, scale: float = 1.0) -> None:
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * scale, err_msg=what)


def assert_same_events(result: Result, second: Outcome) -> None:
    """Signals and answers agree one by one, and so do all counts."""
    sent = result.signals_sent
    signals = list(zip(sent.resource.tolist(), sent.number.tolist(), strict=True))
    assert signals == [signal[1:] for signal in second.signals]
    close(sent.time, [signal[0] for signal in second.signals], "times of signals")
    assert result.log is not None
    time, entry, value = result.log.columns()
    ours = np.flatnonzero((entry[:, 0] == 3) | (entry[:, 0] == 4))
    answers = [tuple(row) for row in entry[ours].tolist()]
    assert answers == [(4 if fall is None else 3, j, i, b) for _, j, i, b, fall in second.answers]
    close(time[ours], [answer[0] for answer in second.answers], "times of answers")
    close(value[ours], [answer[4] or 0.0 for answer in second.answers], "falls of demand")
    for name in ("delivered", "lost", "duplicated", "responses", "saturated"):
        assert getattr(result.account, name).tolist() == getattr(second, name), name
    sent_to_each = np.bincount([signal[1] for signal in second.signals], minlength=len(second.delivered))
    in_flight = sent_to_each[:, None] - np.array(second.delivered) - np.array(second.lost)
    assert np.array_equal(result.account.in_flight, in_flight)


def assert_same_state(result: Result, second: Outcome) -> None:
    """Demands and averages agree whenever somebody looks, and what total demand did in each piece."""
    seen = result.observations
    close(seen.allocation_times, [time for time, _, _ in second.seen], "times of looks")
    close(seen.demand, [demands for _, demands, _ in second.seen], "demands")
    close(seen.average, [averages for _, _, averages in second.seen], "averages")
    close(seen.total_demand, [np.sum(demands, axis=1) for _, demands, _ in second.seen], "totals")
    close(seen.total_average, [np.sum(averages, axis=1) for _, _, averages in second.seen], "averages")
    assert len(result.history) == len(seen.stretches) == len(second.pieces)
    for ours, stretch, piece in zip(result.history, seen.stretches, second.pieces, strict=True):
        assert ours.present.tolist() == piece.present
        assert ours.start == stretch.start == piece.start
        close(ours.capacity, piece.capacity, "capacities")
        for name in ("peak", "above", "excess", "used"):
            close(getattr(stretch, name), getattr(piece, name), name)


def best(costs: Costs, present: Any, weights: Any, capacity: Any) -> Any:
    """The optimum of separable costs, by bisection: all who are here have the same derivative."""

    def allocation(multiplier: Any) -> Any:
        low, high = np.zeros((2, *present.shape, len(capacity)))
        high[present] = capacity
        for _ in range(60):
            middle = 0.5 * (low + high)
            steep = weights[:, None] * costs.gradient(middle) > multiplier
            low, high = np.where(steep, low, middle), np.where(steep, middle, high)
        return 0.5 * (low + high)

    most = np.zeros((*present.shape, len(capacity)))
    most[present] = capacity
    low, high = np.zeros(len(capacity)), (weights[:, None] * costs.gradient(most)).max(axis=0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        enough = allocation(middle).sum(axis=0) > capacity
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return allocation(0.5 * (low + high))


def measures(setting: Setting, second: Outcome) -> dict[str, Any]:
    """The figures of a summary, from the definitions."""
    piece, (_, _, average) = second.pieces[-1], second.seen[-1]
    here, weights, capacity = np.array(piece.present), np.array(piece.weights), np.array(piece.capacity)
    x = np.where(here, average, 0.0).T
    used = x.sum(axis=0)
    gradient = (weights[:, None] * piece.costs.gradient(x))[here]
    found = {
        "utilisation": used / capacity,
        "consensus_spread": gradient.std(axis=0) / gradient.mean(axis=0),
        "overshoot_peak": np.max([np.divide(part.peak, part.capacity) for part in second.pieces], axis=0),
        "overshoot_time": np.sum([part.above for part in second.pieces], axis=0) / setting.until,
        "overshoot_mean": np.sum([np.divide(part.excess, part.capacity) for part in second.pieces], axis=0)
        / setting.until,
    }
    if piece.costs.separable:
        optimum, for_used = (best(piece.costs, here, weights, limits) for limits in (capacity, used))
        found["relative_error"] = np.abs(x - optimum).sum(axis=0) / capacity
        found["misallocation"] = np.abs(x - for_used).sum(axis=0) / used
        value, least = ((weights * piece.costs.value(held))[here].sum() for held in (x, optimum))
        found["cost_ratio"] = np.full(len(capacity), value / least)
    return found


def assert_same_run(setting: Setting) -> None:
    """Hold the framework to the second simulator."""
    second, result = simulate(setting), framework(setting)
    assert_same_events(result, second)
    assert_same_state(result, second)
    if any(second.pieces[-1].present) and (result.average_at_end.sum(axis=0) > 0.0).all():
        found = measures(setting, second)
        for name, values in result.measures(names=list(found)).items():
            np.testing.assert_allclose(values, found[name], rtol=1e-6, atol=1e-6, err_msg=name)


def assert_same_runs(seeds: Iterable[int], dynamics: str) -> None:
    """Hold the framework to the second simulator, one run after the other."""
    for seed in seeds:
        assert_same_run(a_setting(seed, dynamics))


NUMBERS = ["RESPONSE", "LOSS", "LATENCY", "CLOCK", "DUPLICATION", "TICKS", "PHASES"]


@pytest.mark.parametrize("number", [*NUMBERS, "SECOND_LATENCY", "SECOND_RESPONSE"])
def test_another_address_of_random_numbers_would_be_seen(
    number: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(second_simulator, number, 7)
    with pytest.raises(AssertionError):
        assert_same_runs(range(50), "discrete")


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
@given(seed=st.integers(0, 2**32))
def test_the_framework_does_what_the_second_simulator_does(dynamics: str, seed: int) -> None:
    assert_same_run(a_setting(seed, dynamics))
