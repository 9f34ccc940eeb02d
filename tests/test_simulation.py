"""The event-driven system: bit for bit the synchronous algorithm where it must be, and literal elsewhere."""

import math
import re
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
import simpy
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import InputError, Problem, Recording, Result, run_synchronous
from aimd_des.channel import BroadcastChannel
from aimd_des.dynamics.clocks import Clock, Clocks
from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.control_unit import Crossing, Sampled
from aimd_des.engine.environment import EventKind
from aimd_des.engine.simulation import Simulation
from aimd_des.fleet import Fleet
from aimd_des.utils.rng import Purpose
from models import smart_cameras
from tests.conftest import (
    assert_same_run,
    problems,
    quadratic_problem,
    quietly,
    random_problem,
    reference_draws,
    signals_of,
)

EVERY_STEP = Recording(demand=1.0, allocations=1.0)


def simulate(problem: Problem, until: float, seed: int = 0, **parts: Any) -> Result:
    channel = BroadcastChannel(latency=parts.pop("latency", 0.0), loss=parts.pop("loss", 0.0))
    return quietly(Simulation(problem, channel=channel, seed=seed, **parts).run, until)


# -- the same as the synchronous algorithm ---------------------------------------------------------------


# Processes take long for it, and give what a fleet gives (see test_fleet): one seed and fewer steps.
STEPS = {AgentProcess: 4_000, Fleet: 20_000}
SEEDS = [(AgentProcess, 0), *((Fleet, seed) for seed in range(3))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("latency", "agents", "seed"), [*((0.5, *who) for who in SEEDS), *((1.0, *who) for who in SEEDS[1:])]
)
def test_behind_a_latency_of_up_to_a_period_it_is_the_synchronous_algorithm(
    latency: float, agents: Any, seed: int
) -> None:
    problem, steps = smart_cameras(seed=seed), STEPS[agents]
    recording = Recording(allocations=500.0, tail=100)
    reference = run_synchronous(problem, steps=steps, seed=seed, recording=recording)
    assert len(reference.signals) > 0.8 * steps
    run = simulate(problem, steps, seed, latency=latency, agents=agents, recording=recording)
    assert_same_run(run, reference)


@pytest.mark.slow
@pytest.mark.parametrize(("agents", "seed"), SEEDS[1:])
def test_without_latency_a_signal_acts_in_the_very_step(agents: Any, seed: int) -> None:
    # Signals are broadcast at a look, copies without latency arrive at once, and agents act after that.
    problem = smart_cameras(seed=seed)
    recording = Recording(allocations=500.0, tail=100)
    at_once, printed = (
        run_synchronous(problem, steps=30_000, seed=seed, lag=lag, recording=recording) for lag in (0, 1)
    )
    run = simulate(problem, 30_000, seed, latency=0.0, agents=agents, recording=recording)
    assert_same_run(run, at_once)
    assert run.digest != printed.digest
    # The first signal is the same; already the first response is a step earlier.
    assert signals_of(run)[0] == signals_of(printed)[0]
    assert (run.observations.overshoot.peak < printed.observations.overshoot.peak).all()


@given(problems(), st.integers(1, 40), st.integers(0, 2**32), st.sampled_from([0.0, 1e-9, 0.3, 0.5, 1.0]))
def test_random_problems_run_as_the_synchronous_algorithm(
    problem: Problem, steps: int, seed: int, latency: float
) -> None:
    lag = 1 if latency else 0
    reference = quietly(run_synchronous, problem, steps=steps, seed=seed, lag=lag, recording=EVERY_STEP)
    assert_same_run(simulate(problem, steps, seed, latency=latency, recording=EVERY_STEP), reference)


@given(problems(("polynomial", "coupled")), st.integers(1, 40), st.integers(0, 2**32), st.data())
def test_agents_may_have_different_latencies_within_a_period(
    problem: Problem, steps: int, seed: int, data: st.DataObject
) -> None:
    size = problem.n_agents
    latency = data.draw(st.lists(st.floats(1e-9, 1.0), min_size=size, max_size=size))
    reference = quietly(run_synchronous, problem, steps=steps, seed=seed, recording=EVERY_STEP)
    assert_same_run(simulate(problem, steps, seed, latency=latency, recording=EVERY_STEP), reference)


_ABSORBED = pytest.mark.xfail(strict=True, reason="q * 0.1 + 0.1 is not always (q + 1) * 0.1")


@pytest.mark.parametrize(
    ("period", "latency"),
    [
        (0.1, 0.05),
        (0.3, 0.2),
        (1 / 3, 0.3),
        (7.0, 0.1),
        (7.0, 7.0),
        (0.125, 0.125),
        pytest.param(0.1, 0.1, marks=_ABSORBED),
    ],
)
def test_the_unit_of_time_does_not_matter(period: float, latency: float) -> None:
    # Ticks and looks at q * period coincide exactly, also where adding periods would drift apart.
    problem = random_problem(3, 5, 2)
    reference = run_synchronous(problem, steps=400, seed=1)
    clocks = {"clocks": Clocks(period), "control_unit": Sampled(period)}
    run = simulate(problem, 400 * period, 1, latency=latency, **clocks)
    assert len(reference.signals) > 50
    assert run.signals_sent.time.tolist() == [step * period for step in reference.signals_sent.time]
    for name in ("resource", "number"):
        assert getattr(run.signals_sent, name).tolist() == getattr(reference.signals_sent, name).tolist()
    assert np.array_equal(run.demand_at_end, reference.demand_at_end)
    assert np.array_equal(run.average_at_end, reference.average_at_end)


def test_a_latency_beyond_a_period_is_another_system() -> None:
    problem = random_problem(3, 5, 2)
    reference = run_synchronous(problem, steps=100, seed=1)
    assert simulate(problem, 100, 1, latency=1.0).digest == reference.digest
    assert simulate(problem, 100, 1, latency=1.0 + 1e-9).digest != reference.digest


# -- what is seen ----------------------------------------------------------------------------------------

CLOCKS = st.tuples(st.sampled_from([1.0, 0.5, 0.7, 2.3]), st.sampled_from([0.0, 0.25, 0.5, 1.0, 3.0]))


@given(problems(("polynomial",)), CLOCKS, st.sampled_from([0.0, 0.5, 2.0]), st.sampled_from([7.0, 43.21]))
def test_overshoot_is_what_the_totals_between_ticks_give(
    problem: Problem, ticks: tuple[float, float], latency: float, until: float
) -> None:
    clock = Clock(*ticks)
    times = sorted({clock.time(q) for q in range(clock.next_tick(until))} | {0.0, until})
    result = simulate(
        problem, until, latency=latency, clocks=Clocks(*ticks), recording=Recording(demand=times)
    )
    lengths = np.diff(times)
    overshoot, totals = result.observations.overshoot, result.observations.total_demand
    assert len(totals) == len(times)
    for j, capacity in enumerate(problem.capacity):
        # A total that is seen at a tick was held since the tick before.
        excess = np.maximum(totals[1:, j] - capacity, 0.0)
        assert overshoot.peak[j] == totals[:, j].max() / capacity
        assert overshoot.time[j] == pytest.approx(lengths[excess > 0].sum() / until, abs=1e-12)
        assert overshoot.mean[j] == pytest.approx((lengths * excess).sum() / until / capacity, abs=1e-12)


@given(problems(("polynomial",)), st.integers(2, 40), st.sampled_from([0.0, 0.5, 2.3]), st.data())
def test_a_shorter_run_is_the_beginning_of_a_longer_one(
    problem: Problem, until: int, latency: float, data: st.DataObject
) -> None:
    k = data.draw(st.integers(1, until - 1))
    watching = Recording(demand=[float(k)], allocations=[float(k)])
    long = simulate(problem, until, latency=latency, recording=watching)
    short = simulate(problem, k, latency=latency, recording=watching)
    assert signals_of(short) == [signal for signal in signals_of(long) if signal[0] < k]
    for name in ("demand", "average", "total_demand", "total_average"):
        assert np.array_equal(getattr(long.observations, name)[0], getattr(short.observations, name)[-1])


def test_an_observer_at_a_tick_sees_the_demand_before_it() -> None:
    problem = quadratic_problem([1.0, 1.0], capacity=100.0, increase=0.25)
    seen = simulate(problem, 4.0, recording=Recording(demand=[0.0, 0.5, 1.0, 1.5, 2.0])).demand
    assert seen["time"].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 4.0]
    assert seen["total"].tolist() == [0.0, 0.5, 0.5, 1.0, 1.0, 2.0]


# -- luck ------------------------------------------------------------------------------------------------


FACTORS = [1.0, 3.0, 2.0, 4.5]


@pytest.mark.parametrize("latency", [0.0, 0.5, 2.7, [0.0, 0.3, 1.0, 6.5]])
@pytest.mark.parametrize("loss", [0.0, 0.4, [0.0, 0.9, 0.1, 0.5]])
def test_a_change_of_the_channel_does_not_change_the_luck(latency: Any, loss: Any) -> None:
    # Quadratic costs: agent i responds to broadcast b if its draw is below 2 Gamma c_i, and with latencies
    # that are constant every copy that is not lost finds the latch free.
    problem = quadratic_problem(FACTORS, capacity=3.0, normalization=0.1)
    result = simulate(problem, 500, 11, latency=latency, loss=loss)
    times = result.signals_sent.time
    assert len(times) > 50
    rows = [
        [reference_draws(11, purpose, 0, b, 4) for b in range(len(times) + 1)]
        for purpose in (Purpose.RESPONSE, Purpose.LOSS)
    ]
    response_draws, loss_draws = np.array(rows)
    # The last ones are answered only if a tick before the end comes after their arrival.
    answered = np.ceil(times[:, None] + np.broadcast_to(latency, 4)) < 500
    kept = loss_draws[:-1] >= loss
    expected = (answered & kept & (response_draws[:-1] < 0.2 * np.array(FACTORS))).sum(axis=0)
    assert result.account.responses[0].tolist() == expected.tolist()
    shifted = (answered & kept & (response_draws[1:] < 0.2 * np.array(FACTORS))).sum(axis=0)
    assert shifted.tolist() != expected.tolist()  # the draws of the next broadcasts would not do


def test_of_several_signals_between_two_ticks_the_first_is_answered() -> None:
    problem = quadratic_problem(FACTORS, capacity=3.0, normalization=0.1)
    result = simulate(problem, 300, 11, control_unit=Sampled(period=0.25, phase=0.1))
    sent = result.signals
    first = sent.groupby(np.ceil(sent["time"]))["number"].min()
    first = first[first.index < 300]
    assert len(sent) > 2 * len(first) > 60
    draws = np.array([reference_draws(11, Purpose.RESPONSE, 0, b, 4) for b in first])
    expected = (draws < 0.2 * np.array(FACTORS)).sum(axis=0)
    assert result.account.responses[0].tolist() == expected.tolist()


class Late:
    """A camera that is made, and starts to live, in an order that is not that of the agents."""

    order: list[int]
    waiting: dict[int, "Late"]

    def __init__(self, index: int, system: Any) -> None:
        self.index, self.system = index, system
        self.waiting[index] = self
        if len(self.waiting) == len(self.order):
            for agent in self.order:
                self.waiting[agent].camera = AgentProcess(agent, system)
            self.waiting.clear()

    def receive(self, signal: Any) -> None:
        self.camera.receive(signal)

    def process(self) -> Generator[simpy.Event, Any, None]:
        yield self.system.env.at(0.0, EventKind.INTERVENE, self.order.index(self.index))
        yield from self.camera.process()


@given(
    problems(("polynomial", "coupled")), st.sampled_from([0.0, 0.5, 1.7]), st.randoms(use_true_random=False)
)
def test_the_order_in_which_agents_are_made_and_started_does_not_matter(
    problem: Problem, latency: float, shuffler: Any
) -> None:
    order = list(range(problem.n_agents))
    shuffler.shuffle(order)
    late = type("Late", (Late,), {"order": order, "waiting": {}})
    one, other = (
        simulate(problem, 30, 1, latency=latency, loss=0.1, agents=agents, recording=EVERY_STEP)
        for agents in (AgentProcess, late)
    )
    assert_same_run(one, other)


def test_a_second_run_of_the_same_simulation_is_the_same() -> None:
    channel = BroadcastChannel(latency=1.5, loss=0.3)
    simulation = Simulation(random_problem(1, 5, 2), channel=channel, seed=4)
    assert_same_run(quietly(simulation.run, 60.0), quietly(simulation.run, 60.0))


def test_another_seed_is_another_run() -> None:
    problem = random_problem(1, 5, 2)
    assert simulate(problem, 60, 4).digest != simulate(problem, 60, 5).digest


# -- arguments -------------------------------------------------------------------------------------------


def test_defaults_are_a_perfect_channel_and_clocks_in_phase() -> None:
    problem = random_problem(1, 4, 2)
    bare = quietly(Simulation(problem, seed=2).run, 50)
    spelled = simulate(
        problem, 50, 2, control_unit=Sampled(1.0, 0.0), clocks=Clocks(1.0, 0.0), agents=AgentProcess
    )
    assert_same_run(bare, spelled)


@pytest.mark.parametrize("until", [5e-324, 1e-322, 1e-300])
@pytest.mark.parametrize("parts", [{"dynamics": "continuous", "control_unit": Crossing(1.0)}, {}])
def test_the_shortest_of_runs_end(parts: dict[str, Any], until: float) -> None:
    """A fleet never returned where a part of the run was no time at all."""
    problem = random_problem(1, 3, 2)
    runs = [simulate(problem, until, agents=agents, **parts) for agents in (AgentProcess, Fleet)]
    assert runs[0].digest == runs[1].digest
    assert not len(runs[0].signals)


@pytest.mark.parametrize("until", [0.0, -1.0, math.nan, math.inf, "10", None, True])
def test_an_end_that_is_none_is_refused(until: Any) -> None:
    with pytest.raises(InputError, match=r"^until = .*: must be a finite number greater than 0$"):
        Simulation(quadratic_problem([1.0]), seed=0).run(until)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed = -1: must be an integer of at least 0"),
        ({"seed": 1.5}, "seed = 1.5: must be an integer of at least 0"),
        (
            {"seed": 0, "agents": "AgentProcess"},
            "agents = 'AgentProcess': must be one of process, fleet",
        ),
    ],
)
def test_it_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Simulation(quadratic_problem([1.0]), **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sampled(period=0.0), "period = 0.0: must be a finite number greater than 0"),
        (lambda: Sampled(period=math.nan), "period = nan: must be a finite number greater than 0"),
        (lambda: Sampled(phase=-1.0), "phase = -1.0: must be a finite number at least 0"),
    ],
)
def test_a_control_unit_refuses_by_name(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        make()


def test_times_beyond_the_end_are_refused() -> None:
    simulation = Simulation(quadratic_problem([1.0]), seed=0, recording=Recording(demand=[1.0, 6.0]))
    with pytest.raises(InputError, match=r"^demand = 6\.0: must be times of at most 5, the end of the run$"):
        simulation.run(5.0)


def test_a_watcher_hears_the_end() -> None:
    heard: list[tuple[float, int]] = []
    simulation = Simulation(quadratic_problem([1.0] * 4), seed=0)
    simulation.run(3000.0, lambda now, events: heard.append((now, events)))
    assert [now for now, _ in heard] == sorted(now for now, _ in heard)
    assert heard[-1][0] == 3000.0
    assert heard[-1][1] > 3000


def test_saturated_responses_are_counted_and_warned_about_once() -> None:
    simulation = Simulation(quadratic_problem([3.0], capacity=1.0, normalization=0.25), seed=0)
    with pytest.warns(
        RuntimeWarning, match=r"^(\d+) of \1 responses had a probability above 1, which was "
    ) as caught:
        result = simulation.run(300)
    assert len(caught) == 1
    assert result.account.saturated.sum() == result.account.responses.sum() == len(result.signals) > 0


def test_a_simulation_is_replaced_part_by_part() -> None:
    base = Simulation(
        random_problem(1, 4, 2), seed=3, channel=BroadcastChannel(0.25), clocks=Clocks(phase=0.5)
    )
    other = base.replace(seed=4)
    assert (other.seed, base.seed) == (4, 3)
    assert all(getattr(other, name) is getattr(base, name) for name in ("problem", "channel", "clocks"))
    assert other.run(20.0).digest == base.replace(seed=4).run(20.0).digest != base.run(20.0).digest
    # Clocks that were given stand in the way of agents without ticks; those that were not do not.
    with pytest.raises(InputError, match="clocks"):
        base.replace(dynamics="continuous")
    assert Simulation(base.problem, seed=0).replace(dynamics="continuous").clocks is None


def test_a_part_that_a_simulation_has_not_is_refused_with_the_list() -> None:
    with pytest.raises(InputError, match=r"'chanel': must be one of problem, .*did you mean 'channel'"):
        Simulation(random_problem(1, 4, 2), seed=3).replace(chanel=BroadcastChannel())
