"""Responses and averages beyond the paper's: by their definitions, by theory, and in every way of running."""

import math
import re
from fractions import Fraction
from typing import Any

import numba
import numpy as np
import pytest
from scipy.integrate import quad

from aimd_des import (
    AgentProcess,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Simulation,
    averaging,
    interventions,
    latency,
    responses,
    run_synchronous,
    solve_optimum,
)
from aimd_des.channel import BroadcastChannel
from aimd_des.dynamics.averaging import folded_at
from aimd_des.dynamics.responses import Response, memory_columns, probability_of
from aimd_des.engine.environment import EventKind
from aimd_des.utils.returned_values import raised_in
from models import smart_cameras
from tests.conftest import quietly, random_problem

EVENTS = Recording(events=True)
MEMORIES = [responses.EventNormalised(), responses.Derandomised("events", full=True)]


# -- an average with a gain ------------------------------------------------------------------------------


def lines(seed: int, ticking: bool, count: int = 12) -> list[tuple[float, float, float]]:
    """Some lines of demand: where each begins, how it grows and how long it is."""
    rng = np.random.default_rng(seed)
    spans = rng.integers(1, 9, count).astype(float) if ticking else rng.exponential(3.0, count)
    return list(zip(*rng.random((2, count)).tolist(), spans.tolist(), strict=True))


@pytest.mark.parametrize("gain", [1.5, 2.0, 3.75, 12.0])
def test_on_ticks_the_newest_weighs_the_gain_over_their_number(gain: float) -> None:
    """Against exact arithmetic, sample by sample; what is folded in line by line is rounded a dozen times."""
    how = averaging.Polynomial(gain).parameters(1.0)
    average, exact, age = 0.0, Fraction(0), 0
    for demand, increase, span in lines(7, ticking=True):
        average = folded_at(how, average, demand, increase, span, float(age), 1.0)
        for tick in range(int(span)):
            age += 1
            weight = min(Fraction(1), Fraction(gain) / age)
            exact += weight * (Fraction(demand) + Fraction(increase) * tick - exact)
        assert average == pytest.approx(float(exact), rel=1e-13)


@pytest.mark.parametrize("gain", [1.5, 2.0, 3.75, 12.0])
def test_in_continuous_time_demand_weighs_as_a_power_of_the_age(gain: float) -> None:
    how, average, age, integral = averaging.Polynomial(gain).parameters(0.0), 0.0, 0.0, 0.0
    for demand, increase, span in lines(8, ticking=False):
        average = folded_at(how, average, demand, increase, span, age, 0.0)

        def weighted(s: float, x: float = demand, alpha: float = increase, start: float = age) -> float:
            return float(s ** (gain - 1.0) * (x + alpha * (s - start)))

        integral += quad(weighted, age, age + span, epsabs=0.0)[0]
        age += span
        assert average == pytest.approx(gain * integral / age**gain, rel=1e-10)


@pytest.mark.parametrize("gain", [1.5, 5.0, 31.0])
@pytest.mark.parametrize("before", [0, 3, 5_000])
def test_a_long_line_on_ticks_is_as_exact_as_many_short_ones(gain: float, before: int) -> None:
    """A series takes the place of the ticks; 3000 foldings are rounded 3000 times."""
    how = averaging.Polynomial(gain).parameters(1.0)
    whole = folded_at(how, 0.7, 0.4, 0.001, 3000.0, float(before), 1.0)
    average = 0.7
    for tick in range(3000):
        average = folded_at(how, average, 0.4 + 0.001 * tick, 0.001, 1.0, float(before + tick), 1.0)
    assert whole == pytest.approx(average, rel=1e-12)


def test_with_gain_1_all_of_the_past_counts_alike() -> None:
    plain, problem = averaging.Cumulative(), smart_cameras(0)
    assert averaging.Polynomial(1).parameters(1.0) == plain.parameters(1.0)
    runs = [
        quietly(run_synchronous, problem, steps=200, seed=1, averaging=way).digest
        for way in (plain, averaging.Polynomial(1.0))
    ]
    assert runs[0] == runs[1]


# -- one agent, by hand ----------------------------------------------------------------------------------


def alone(normalization: float, decrease: float = 0.5) -> Problem:
    """One agent and one resource with f' = 1; it signals at every tick from the fourth on."""
    resource = Resource("r", capacity=3.5, increase=1.0, decrease=decrease, normalization=normalization)
    return Problem([resource], PolynomialCosts([1], [[[1.0]]]))


def answers(response: Response, problem: Problem, until: float) -> list[tuple[float, str, float]]:
    """Time, kind and size of each answer of one agent."""
    run = Simulation(problem, seed=0, response=response, recording=EVENTS).run(until)
    kept = run.events.query("kind in ('respond', 'hold')")
    return list(zip(kept["time"], kept["kind"].astype(str), kept["value"], strict=True))


def test_a_fractional_cut_takes_its_share_at_every_signal() -> None:
    """Demand 0, 1, 2, 3, 4: at tick 4 the average is 2, lambda 0.2 and the cut 0.1 of 4."""
    found = answers(responses.Derandomised(), alone(0.4), 6.0)
    assert found[0] == (4.0, "respond", pytest.approx(0.4))
    # 3.6 is cut at tick 5, at an average of 13.6 / 6 of what was held before.
    assert found[1] == (5.0, "respond", pytest.approx(3.6 * 0.5 * 0.4 / (13.6 / 6)))


def test_the_divisor_at_events_is_the_average_of_demands_found() -> None:
    found = answers(responses.Derandomised("events"), alone(0.4), 6.0)
    assert found[0] == (4.0, "respond", pytest.approx(4.0 * 0.5 * 0.4 / 4.0))
    assert found[1] == (5.0, "respond", pytest.approx(3.8 * 0.5 * 0.4 / 3.9))


def test_next_to_no_demand_is_divided_by_without_a_warning() -> None:
    how = averaging.Cumulative().parameters(0.0)
    response = responses.EventNormalised().parameters(0.0)
    memory = np.zeros((1, 1, memory_columns(response, how)))
    found = {"normalization": 38.9, "slope": 0.2, "average": 1.0, "demand": 1.7e-322}
    parameters = {"increase": 0.1, "decrease": 0.5, "age": 1.0}
    assert probability_of(response, how, memory, 0, 0, **found, **parameters) == math.inf


def test_full_cuts_come_when_lambda_adds_up_to_one() -> None:
    """A constant lambda of 0.4 would cut at the third signal; here averages move little between them."""
    found = answers(responses.Derandomised(full=True), alone(1.0), 9.0)
    total, expected = 0.0, []
    demands = [0.0, 1.0, 2.0, 3.0]
    held = 4.0
    for tick in range(4, 9):
        demands.append(held)
        if held <= 3.5:
            held += 1.0
            continue
        total += 1.0 / np.mean(demands)
        cuts = total >= 1.0
        expected.append((float(tick), "respond" if cuts else "hold", pytest.approx(0.5 * held * cuts)))
        total, held = (total - 1.0, 0.5 * held) if cuts else (total, held)
    assert found == expected
    assert {kind for _, kind, _ in found} == {"respond", "hold"}


def test_full_cuts_with_their_own_divisor() -> None:
    """Before the first cut the average over time divides; after it, 0.75 times the demand found there."""
    found = answers(responses.Derandomised("events", full=True), alone(1.9), 12.0)
    cuts = [(time, value) for time, kind, value in found if kind == "respond"]
    assert cuts[0] == (5.0, pytest.approx(2.0))  # 1.9 / 2 and 1.9 / (14 / 6) of an average of 2 and 14 / 6
    left = 1.9 / 2.0 + 1.9 / (14.0 / 6.0) - 1.0
    signals = [time for time, _, _ in found]
    rest = iter(signals[2:])
    while left < 1.0:
        time = next(rest)
        left += 1.9 / (0.75 * 4.0)
    assert cuts[1][0] == time


def test_saturated_answers_are_counted_where_the_cut_is_cut_off() -> None:
    """lambda of 1.5 is above 1 and below 1 / (1 - beta) = 2; one of 2.5 is above both."""
    for normalization, drawn, fractional in ((3.0, 1, 0), (5.0, 1, 1)):
        problem = alone(normalization)
        for response, expected in ((responses.Randomised(), drawn), (responses.Derandomised(), fractional)):
            run = quietly(Simulation(problem, seed=0, response=response).run, 5.0)
            assert run.account.responses.sum() == 1
            assert run.account.saturated.sum() == expected


def test_the_papers_rule_is_the_default() -> None:
    problem = smart_cameras(0)
    ways = (None, responses.Randomised())
    runs = [run_synchronous(problem, steps=500, seed=1, response=way).digest for way in ways]
    assert runs[0] == runs[1]


# -- interventions ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("response", MEMORIES)
@pytest.mark.parametrize("anew", [False, True])
def test_what_a_response_keeps_is_kept_or_forgotten_with_the_average(response: Response, anew: bool) -> None:
    """An agent that begins anew has no demand found by signals; one that comes back has."""
    problem, seen = smart_cameras(0), {}

    def look(system: Any) -> Any:
        for name, time in (("before", 399.5), ("after", 450.0)):
            yield system.env.at(time, EventKind.INTERVENE)
            system.settle()
            seen[name] = system.state.memory[:, 0].copy()

    away = (interventions.Crash if anew else interventions.Absence)([0], 400.0, 450.0)
    parts: dict[str, Any] = {"seed": 1, "response": response, "interventions": [away], "recording": EVENTS}
    runs = [
        quietly(Simulation(problem, processes=[look], **more, **parts).run, 600.0)
        for more in ({}, {"agents": Fleet})
    ]
    assert runs[0].digest == runs[1].digest
    assert seen["before"].any()
    assert np.array_equal(seen["after"], np.zeros_like(seen["before"]) if anew else seen["before"])


# -- theory ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("response", "bound"),
    [
        (responses.Derandomised("events"), [0.0006, 0.0004, 0.0003]),
        (responses.Derandomised("events", full=True), [0.0006, 0.0003, 0.0003]),
    ],
)
def test_without_draws_and_bias_the_optimum_is_met(response: Response, bound: list[float]) -> None:
    """No noise and no bias: the error falls like 1 / k.  The paper's rule is at 1.0, 0.6 and 0.9 %."""
    problem = smart_cameras(0)
    result = run_synchronous(problem, steps=30_000, seed=0, lag=0, response=response)
    assert (result.summary(solve_optimum(problem))["misallocation"] < bound).all()


def test_a_fractional_cut_by_the_average_has_the_bias_that_theory_predicts() -> None:
    """Averages settle where f'(1 + c / 2x) agree, c = (1 - beta) Gamma mu: 0.633, 0.481 and 0.811 % away."""
    problem = smart_cameras(0)
    result = run_synchronous(problem, steps=30_000, seed=0, lag=0, response=responses.Derandomised())
    found = result.summary(solve_optimum(problem))["misallocation"]
    assert found.to_numpy() == pytest.approx([0.00633, 0.00481, 0.00811], rel=0.01)


def mean_of_runs(problem: Problem, runs: int, **parts: Any) -> tuple[Any, Any]:
    """The mean of the averages over runs with seeds of their own, and its standard error, (n, m)."""
    seeds = range(runs)
    results = [run_synchronous(problem, seed=seed, lag=0, **parts) for seed in seeds]
    ends = np.stack([result.observations.average[-1].T for result in results])
    return ends.mean(axis=0), ends.std(axis=0, ddof=1) / np.sqrt(runs)


def distance(problem: Problem, used: Any) -> Any:
    """The sum of what averages are away from the optimum for what is used, over what is used, (m,)."""
    at = solve_optimum(problem, capacity=used.sum(axis=0)).allocation
    return np.abs(used - at).sum(axis=0) / used.sum(axis=0)


@pytest.mark.slow
def test_demand_at_signals_as_divisor_takes_the_bias_away() -> None:
    """The mean of 16 runs is as far from the optimum as its noise, E|z| = sqrt(2 / pi) standard errors.

    The paper's rule, the negative control, is 0.57, 0.46 and 0.76 % away, which 4 runs are enough to tell.
    """
    problem = smart_cameras(0)
    for response, runs in ((responses.EventNormalised(), 16), (responses.Randomised(), 4)):
        mean, error = mean_of_runs(problem, runs, steps=100_000, response=response)
        noise = np.sqrt(2.0 / np.pi) * error.sum(axis=0) / mean.sum(axis=0)
        assert (distance(problem, mean) < 1.5 * noise).all() == (runs == 16)


def test_a_gain_forgets_the_start_of_slow_costs() -> None:
    """Elasticities of 0.2: the error falls like k^-0.2, with gain 5 like k^-1 (derandomised, no bias)."""
    mu, n = 1.0, 12
    share = np.linspace(0.5, 1.5, n)
    slope = 0.2 * mu / share  # f' = b + slope * x = mu at the share, x f'' / f' = 0.2 there
    coefficients = np.stack([mu - slope * share, 0.5 * slope], axis=1)[:, None, :]
    resource = Resource("r", capacity=share.sum(), increase=0.01, decrease=0.7, normalization=0.3)
    problem = Problem([resource], PolynomialCosts([1, 2], coefficients))
    errors = {}
    for gain in (1.0, 5.0):
        result = run_synchronous(
            problem,
            steps=30_000,
            seed=0,
            lag=0,
            response=responses.Derandomised("events"),
            averaging=averaging.Polynomial(gain),
        )
        errors[gain] = distance(problem, result.observations.average[-1].T)[0]
    assert errors[5.0] < 0.1 * errors[1.0]


# -- one event log ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("response", MEMORIES)
def test_every_way_of_averaging_gives_processes_and_a_fleet_one_log(response: Response) -> None:
    parts: dict[str, Any] = {
        "dynamics": "continuous",
        "control_unit": Crossing(1.0),
        "channel": BroadcastChannel(latency.Exponential(0.5), loss=0.1),
        "recording": EVENTS,
        "response": response,
        "seed": 3,
    }
    ways = (averaging.Window(60.0, 4), averaging.Forgetting(40.0), averaging.Polynomial(3.0))
    digests = {
        quietly(Simulation(smart_cameras(1), averaging=way, **parts, **more).run, 200.0).digest
        for way in ways
        for more in ({}, {"agents": Fleet})
    }
    assert len(digests) == len(ways)


# -- a response of one's own -----------------------------------------------------------------------------


@numba.njit
def papers(normalization: float, slope: float, average: float) -> float:
    return normalization * slope / average


@numba.njit
def counting(
    slope: float, average: float, demand: float, normalization: float, age: float, memory: Any
) -> float:
    """Divides by the average demand found, and answers less at the beginning."""
    memory[0] += 1.0
    memory[1] += demand
    return normalization * slope / (memory[1] / memory[0]) * (1.0 - 1.0 / (age + 2.0)) + 0.0 * average


def plain_counting(
    slope: float, average: float, demand: float, normalization: float, age: float, memory: Any
) -> float:
    return counting.py_func(slope, average, demand, normalization, age, memory)  # type: ignore[no-any-return]


def test_the_papers_rule_as_ones_own_is_the_papers_rule() -> None:
    problem, own = smart_cameras(2), responses.CustomResponse(papers)
    expected = run_synchronous(problem, steps=500, seed=1, lag=0).digest
    assert run_synchronous(problem, steps=500, seed=1, lag=0, response=own).digest == expected
    for agents in ({}, {"agents": Fleet}):
        assert Simulation(problem, seed=1, response=own, **agents).run(500.0).digest == expected


@pytest.mark.parametrize("cut", ["drawn", "fractional", "full"])
@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_a_response_of_ones_own_gives_one_log_in_every_way(cut: Any, dynamics: Any) -> None:
    channel = BroadcastChannel(latency.Exponential(0.5), loss=0.1)
    parts: dict[str, Any] = {"dynamics": dynamics, "channel": channel, "recording": EVENTS, "seed": 3}
    parts["interventions"] = [interventions.Crash([1], 40.0, 60.0), interventions.Absence([2], 40.0, 60.0)]
    ways = [(counting, Fleet), (counting, AgentProcess), (plain_counting, AgentProcess)]
    digests = {
        quietly(
            Simulation(
                random_problem(3, 8, 2, "coupled"),
                agents=agents,
                response=responses.CustomResponse(function, cut, memory=2),
                **parts,
            ).run,
            150.0,
        ).digest
        for function, agents in ways
    }
    assert len(digests) == 1


def test_synchronous_runs_call_it_too() -> None:
    problem, own = smart_cameras(2), responses.CustomResponse(counting, "fractional", memory=2)
    at_once = Simulation(problem, agents=Fleet, seed=1, response=own).run(300.0)
    assert run_synchronous(problem, steps=300, seed=1, lag=0, response=own).digest == at_once.digest


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: responses.CustomResponse(3.0), "CustomResponse.probability = 3.0: must be a function"),
        (lambda: responses.CustomResponse(lambda mean: mean), "probability = 'mean': must be names of"),
        (lambda: responses.CustomResponse(lambda memory, age: age, memory=1), "with 'memory' last"),
        (lambda: responses.CustomResponse(lambda memory: 0.0), "with 'memory' last"),
        (lambda: responses.CustomResponse(papers, "half"), "CustomResponse.cut = 'half'"),
        (lambda: responses.CustomResponse(papers, memory=-1), "CustomResponse.memory = -1"),
        (lambda: responses.CustomResponse(lambda age: None), "CustomResponse.probability() = None: must be"),
        (lambda: responses.CustomResponse(lambda age: -age), "CustomResponse.probability() = -1.0: must be"),
        (lambda: responses.CustomResponse(lambda age: math.nan), "CustomResponse.probability() = nan"),
    ],
)
def test_a_broken_response_is_refused_by_name(make: Any, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        make()


@numba.njit
def breaking(age: float, decrease: float) -> float:
    """Good where it is asked when the response is made, at the ages 1 and 1000 with beta = 0.7."""
    if decrease == 0.7 or age < 20.0:
        return 0.1
    if decrease == 0.0:
        return 1.0 / (age - age)
    return -1.0 if decrease == 0.5 else math.inf


@pytest.mark.parametrize(("decrease", "said"), [(0.5, "-1.0"), (0.25, "inf"), (0.0, "nan")])
def test_what_a_compiled_function_returns_is_checked(decrease: float, said: str) -> None:
    problem, own = alone(0.4, decrease), responses.CustomResponse(breaking)
    for run in (
        lambda: Simulation(problem, agents=Fleet, seed=1, response=own).run(90.0),
        lambda: run_synchronous(problem, steps=90, seed=1, response=own),
    ):
        with pytest.raises(InputError, match=rf"^CustomResponse\.probability\(\) = {said}: must be a finite"):
            run()
    with pytest.raises(ZeroDivisionError if decrease == 0.0 else InputError) as caught:
        Simulation(problem, seed=1, response=own).run(90.0)
    assert raised_in(caught.value) == (
        "CustomResponse.probability() raises ZeroDivisionError: division by zero" if decrease == 0.0 else None
    )


def test_compiled_code_needs_a_compiled_function() -> None:
    own = responses.CustomResponse(plain_counting, memory=2)
    for run in (
        lambda: Simulation(smart_cameras(0), agents=Fleet, seed=1, response=own).run(2.0),
        lambda: run_synchronous(smart_cameras(0), steps=2, seed=1, response=own),
    ):
        with pytest.raises(InputError, match=r"CustomResponse\.probability = .*compiled by numba\.njit"):
            run()
