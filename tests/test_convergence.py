"""What theory says of the accuracy of averages, against runs of the package and a plain loop beside it.

Predicted and measured means are held to within 4 standard errors of the runs.  What formulas neglect comes
to that: the next order in 1 / n, or in kappa, the part of a demand that a signal takes.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Simulation,
    averaging,
    latency,
    loss,
    responses,
    run_synchronous,
    solve_optimum,
    theory,
)
from aimd_des.theory import sawtooth
from aimd_des.theory.mean_dynamics import Memory
from aimd_des.theory.prediction import settle
from aimd_des.theory.second_moments import modes_of, remaining
from aimd_des.theory.setting import check_setting
from aimd_des.utils.validation import FloatArray
from benchmarks.accuracy import slopes, slow_costs
from models import random_convex, smart_cameras
from tests.conftest import resource
from tests.support.responses_on_the_clock import EVENTS, FULL, PART, Way, run_response

CURED = responses.EventNormalised()
PARTS = responses.Derandomised()
BOTH = responses.Derandomised("events")
WHOLE = responses.Derandomised(full=True)
OWN_CUTS = responses.Derandomised("events", full=True)


def misallocation(problem: Problem, averages: FloatArray) -> FloatArray:
    """Measure rows of averages, (..., n, m)."""
    flat = averages.reshape(-1, *averages.shape[-2:])
    targets = [solve_optimum(problem, capacity=row.sum(axis=0)).allocation for row in flat]
    measured = np.abs(flat - np.stack(targets)).sum(axis=1) / flat.sum(axis=1)
    return measured.reshape(*averages.shape[:-2], -1)


def synchronous(problem: Problem, at: list[float], seeds: int, **options: Any) -> FloatArray:
    """Averages of runs of the synchronous algorithm, (seeds, q, n, m)."""
    recording = Recording(allocations=at)
    runs = [
        run_synchronous(problem, steps=int(at[-1]), seed=seed, lag=0, recording=recording, **options)
        for seed in range(seeds)
    ]
    return np.stack([np.swapaxes(run.observations.average[-len(at) :], 1, 2) for run in runs])


def late(problem: Problem, at: list[float], lag: int, **options: Any) -> FloatArray:
    """Averages of a run whose signals come late, (q, n, m)."""
    channel = BroadcastChannel(latency=latency.Constant(float(lag)))
    recording = Recording(demand="end", allocations=at, overshoot=False)
    simulation = Simulation(problem, channel=channel, agents=Fleet, recording=recording, **options)
    return np.swapaxes(simulation.run(at[-1]).observations.average[-len(at) :], 1, 2)


def biased(expected: theory.Convergence, averages: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Project the mean of runs, (runs, n, m), on the predicted bias, which gives 1; with standard errors."""
    problem, bias = expected.problem, expected.bias
    off = [row - solve_optimum(problem, capacity=row.sum(axis=0)).allocation for row in averages]
    parts = (np.stack(off) * bias).sum(axis=1) / (bias**2).sum(axis=0)
    return parts.mean(axis=0), parts.std(axis=0, ddof=1) / np.sqrt(len(parts))


def spread_ratio(expected: theory.Convergence, averages: FloatArray, at: float) -> FloatArray:
    """Divide the summed variances of runs, (runs, n, m), by the predicted ones; as standard deviations."""
    predicted = np.einsum("jii->j", expected.covariance(at))
    return np.sqrt(averages.var(axis=0, ddof=1).sum(axis=0) / predicted)


def kappa(expected: theory.Convergence) -> FloatArray:
    """Return the largest part of a demand that a signal takes in the mean, (m,): the next order."""
    return (expected.steady.keep * expected.steady.hit).max(axis=0)


def deviations(problems: list[Problem], at: int, way: Way, response: responses.Response) -> FloatArray:
    """Compare runs without draws with their predictions, as logarithms, and problems one with another."""
    return np.array(
        [
            np.log(
                misallocation(problem, run_response(problem, [at], way))[0]
                / theory.convergence(problem, response=response).misallocation(float(at)).mean
            )
            for problem in problems
        ]
    ).ravel()


def spread_of_gaps(problem: Problem) -> FloatArray:
    """Return how what a signal takes of the total scatters, at most, as a part of its mean, (m,).

    Growth makes up for all that signals have taken, so that their number scatters by as much over its root.
    """
    expected = theory.predict(problem)
    square = (problem.increase / expected.signals) ** 2 * (1.0 / expected.probability)
    drop = problem.increase.sum(axis=0) / expected.signals
    return np.asarray(np.sqrt(square.sum(axis=0)) / drop)


def one_third(average: float) -> float:
    """Return a response probability that no cost has a part in."""
    return 1.0 / 3.0


class TestThePapersRule:
    def test_the_cameras_on_the_clock(self) -> None:
        problem, at = smart_cameras(seed=0), [1000.0, 10_000.0, 100_000.0]
        expected = theory.convergence(problem)
        averages = synchronous(problem, at, 12)
        # 12 runs of 60 agents, of which some 30 count.
        for q, time in enumerate(at):
            assert (abs(spread_ratio(expected, averages[:, q], time) - 1.0) < 4 / np.sqrt(720) + 1 / 60).all()
        part, error = biased(expected, averages[:, -1])
        assert (abs(part - 1.0) < 4 * error + 1 / 60).all()
        measured, predicted = misallocation(problem, averages), expected.misallocation(at)
        off = measured.mean(axis=0) - predicted.mean
        assert (abs(off) < 4 * measured.std(axis=0, ddof=1) / np.sqrt(12) + predicted.mean / 60).all()
        inside = (measured >= predicted.low) & (measured <= predicted.high)
        # Of the 108 cases the 36 runs are independent.
        assert inside.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 36)
        first_order = abs(theory.convergence(problem, exact=False).bias).sum(axis=0)
        assert (first_order > abs(expected.bias).sum(axis=0)).all()

    @pytest.mark.parametrize("lost", [0.0, 0.4])
    def test_continuous_agents_and_loss(self, lost: float) -> None:
        problem, until = smart_cameras(seed=0, n_cameras=12), 20_000.0
        channel = BroadcastChannel(loss=loss.Bernoulli(lost)) if lost else BroadcastChannel()
        options = {"dynamics": "continuous", "control_unit": Crossing(hold_off=0.0), "channel": channel}
        runs = [Simulation(problem, agents=Fleet, seed=seed, **options).run(until=until) for seed in range(8)]
        averages = np.stack([run.average_at_end for run in runs])
        expected = theory.convergence(problem, "continuous", loss=lost, exact=True)
        assert np.allclose(averages.sum(axis=1).mean(axis=0), expected.steady.average.sum(axis=0), rtol=1e-3)
        part, error = biased(expected, averages)
        assert (abs(part - 1.0) < 4 * error).all()
        assert (abs(spread_ratio(expected, averages, until) - 1.0) < 4 / np.sqrt(2 * 8 * 6)).all()

    def test_few_agents_need_the_exact_moments(self) -> None:
        problem = random_convex(seed=0, n_agents=5, n_resources=2, coupled=False)
        averages = synchronous(problem, [20_000.0], 60)[:, 0]
        expected, rough = theory.convergence(problem), theory.convergence(problem, exact=False)
        part, error = biased(expected, averages)
        assert (abs(part - 1.0) < 4 * error + 1 / 25).all()
        wrong, its_error = biased(rough, averages)
        assert (
            wrong < -4 * its_error
        ).all()  # the order 1 / n is larger than the first, and has the other sign
        assert (abs(spread_ratio(expected, averages, 20_000.0) - 1.0) < 4 / np.sqrt(2 * 60 * 3)).all()

    def test_coupled_costs(self) -> None:
        problem = random_convex(seed=7, n_agents=20, n_resources=3)
        at = [2000.0, 20_000.0]
        expected = theory.convergence(problem)
        assert len(expected.exponents) == 1
        assert expected.exponents[0].shape == (19 * 3,)
        averages = synchronous(problem, at, 12)
        measured, predicted = misallocation(problem, averages), expected.misallocation(at)
        off = measured.mean(axis=0) - predicted.mean
        assert (abs(off) < 4 * measured.std(axis=0, ddof=1) / np.sqrt(12) + predicted.mean / 20).all()

    def test_a_lag_turns_the_bias_round(self) -> None:
        problem = smart_cameras(seed=0)
        none, some, much = (theory.convergence(problem, lag=lag) for lag in (0, 3, 10))
        average = run_response(problem, [15_000], Way(lag=10), seed=3)[0]
        off = average - solve_optimum(problem, capacity=average.sum(axis=0)).allocation
        part = (off * much.bias).sum(axis=0) / (much.bias**2).sum(axis=0)
        noise = np.einsum("ij,jik,kj->j", much.bias, much.covariance(15_000), much.bias)
        assert (abs(part - 1.0) < 4 * np.sqrt(noise) / (much.bias**2).sum(axis=0) + kappa(much)).all()
        assert ((none.bias * much.bias).sum(axis=0) < 0.0).all()
        assert (abs(some.bias).sum(axis=0) < abs(none.bias).sum(axis=0)).all()

    @pytest.mark.slow
    def test_a_sway_damps_noise(self) -> None:
        problem, at, runs = smart_cameras(seed=0), 3000.0, 40
        averages = np.concatenate([late(problem, [at], lag=20, seed=seed) for seed in range(runs)])
        expected = theory.convergence(problem, lag=20)
        covariance = expected.covariance(at)
        # The summed variances of Gaussian averages have the variance 2 tr V^2 / (runs - 1).
        error = np.sqrt(0.5 * np.einsum("jik,jki->j", covariance, covariance) / (runs - 1))
        error /= np.einsum("jii->j", covariance)
        assert (abs(spread_ratio(expected, averages, at) - 1.0) < 4 * error + 1 / 60).all()
        still = expected.setting._replace(following=None)
        blocks = tuple(modes_of(still, expected.steady, slice(j, j + 1), together=True) for j in range(3))
        wrong = spread_ratio(replace(expected, blocks=blocks), averages, at)
        assert (abs(wrong - 1.0) > 4 * error + 1 / 60).any()

    def test_a_sway_slows_cures_down(self) -> None:
        problem, at = smart_cameras(seed=0), [10_000.0, 30_000.0]
        expected = theory.convergence(problem, lag=10, response=BOTH)
        measured = misallocation(problem, late(problem, at, lag=10, seed=0, response=BOTH))
        slopes = np.diff(np.log(measured), axis=0)[0] / np.log(3.0)
        smallest = np.array([values[0] for values in expected.exponents])
        assert (abs(slopes + smallest) < kappa(expected)).all()
        assert abs(slopes[2] + 1.0) > kappa(expected)[2]  # the exponent without a delay

    def test_first_swings_are_those_of_a_run_without_draws(self, monkeypatch: pytest.MonkeyPatch) -> None:
        problem, at = smart_cameras(seed=0, n_cameras=12), [5.0, 30.0, 100.0, 400.0]
        run = late(problem, at, lag=10, seed=0, response=BOTH)
        monkeypatch.setattr("aimd_des.theory.first_swings._ANEW", 10**9)  # at every step
        expected = theory.convergence(problem, lag=10, response=BOTH)
        assert expected.average(at) == pytest.approx(run, rel=1e-9)
        # Without overshoot of the first signals it would not be.
        monkeypatch.setattr("aimd_des.theory.mean_dynamics._AT_ONCE", 10)
        smooth = theory.convergence(problem, lag=10, response=BOTH)
        assert (abs(smooth.average(at[1:]) / run[1:] - 1.0).max(axis=(1, 2)) > 0.01).all()

    def test_first_swings_decide_how_large_slow_modes_are(self, monkeypatch: pytest.MonkeyPatch) -> None:
        problem, at = smart_cameras(seed=0), 3000.0
        measured = misallocation(problem, late(problem, [at], lag=10, seed=0, response=BOTH))[0]
        off = {}
        for at_once in (1, 10):
            monkeypatch.setattr("aimd_des.theory.mean_dynamics._AT_ONCE", at_once)
            expected = theory.convergence(problem, lag=10, response=BOTH).misallocation(at).mean
            off[at_once] = abs(np.log(expected / measured))
        assert (off[1] < 0.5 * off[10]).all()

    @pytest.mark.parametrize(
        "memory",
        [averaging.Polynomial(3.0), averaging.Forgetting(200.0), averaging.Cumulative()],
        ids=["gain", "forgetting", "all"],
    )
    def test_first_swings_go_over_into_the_mean_dynamics(self, memory: averaging.Averaging) -> None:
        problem = smart_cameras(seed=0, n_cameras=12)
        expected = theory.convergence(problem, lag=5, response=BOTH, averaging=memory)
        (_, swings), (end, later) = expected._path._stages
        pair = [way(float(expected.memory.turns(end)))[0] for way in (swings, later)]
        # What is averaged over a last swing is within what averages do in one.
        last = swings.averages[-round(2.0 * (end - swings.middle)) :]
        assert (pair[1] >= last.min(axis=0) - 1e-3 * last[-1]).all()
        assert (pair[1] <= last.max(axis=0) + 1e-3 * last[-1]).all()
        assert expected.average(end + 1e5) == pytest.approx(expected.steady.average, rel=1e-3)

    def test_losses_that_differ_on_the_clock(self) -> None:
        problem = smart_cameras(seed=0)
        lost = np.resize([0.0, 0.3], 60)
        expected = theory.convergence(problem, loss=lost)
        averages = np.concatenate([run_response(problem, [10_000], seed=s, loss=lost) for s in range(3)])
        part, error = biased(expected, averages)
        assert (abs(part - 1.0) < 4 * error + 1 / 60).all()
        assert (abs(expected.bias).sum(axis=0) > 0.1 * expected.steady.average.sum(axis=0)).all()


class TestOtherResponses:
    def test_a_part_for_certain_leaves_the_bias_of_the_paper(self) -> None:
        problem, at = smart_cameras(seed=0), [1000, 10_000]
        measured = misallocation(problem, run_response(problem, at, Way(cut=PART)))
        expected = theory.convergence(problem, response=PARTS)
        predicted = expected.misallocation(at)
        assert predicted.low == pytest.approx(predicted.mean, rel=0.005)  # but for the sawtooth
        assert (abs(measured / predicted.mean - 1.0) < kappa(expected)).all()

    @pytest.mark.parametrize(
        ("response", "way"), [(BOTH, Way(EVENTS, PART)), (OWN_CUTS, Way(EVENTS, FULL))], ids=["part", "full"]
    )
    def test_without_draws_and_bias_errors_are_right_in_the_mean_of_problems(
        self, response: responses.Response, way: Way
    ) -> None:
        # How regular cuts fall in with the saw of the total is neglected, and is another in each problem.
        problems = [smart_cameras(seed=seed) for seed in range(4)]
        found = deviations(problems, 1000, way, response)
        error = found.std(ddof=1) / np.sqrt(len(found))
        assert abs(found.mean()) < 4 * error
        assert abs(deviations(problems[:1], 1000, way, PARTS).mean()) > 4 * error

    def test_full_cuts_at_regular_numbers_of_signals(self) -> None:
        problem, at = smart_cameras(seed=0), [1000, 10_000]
        measured = misallocation(problem, run_response(problem, at, Way(cut=FULL)))
        expected = theory.convergence(problem, response=WHOLE)
        # Between two cuts are as many signals as the whole number below 1 / lambda or that above.  Their
        # variance, at most 1 / 4, adds at most c lambda / 8 to an average, with c = alpha / rho.
        growth = (1.0 - expected.signals) / expected.signals * problem.increase
        neglected = (growth * expected.steady.part / 8.0).sum(axis=0) / expected.steady.average.sum(axis=0)
        assert (abs(measured - expected.misallocation(at).mean) < neglected).all()
        wrong = theory.convergence(problem).misallocation(1000.0).mean
        assert (abs(measured[0] - wrong) > neglected).all()

    def test_what_signals_find_as_the_divisor_leaves_no_bias(self) -> None:
        problem = smart_cameras(seed=0)
        for response in (CURED, BOTH, WHOLE, OWN_CUTS):
            expected = theory.convergence(problem, response=response)
            assert (abs(expected.bias).sum(axis=0) < 1e-7 * problem.capacity).all()
        averages = np.stack([run_response(problem, [10_000], Way(EVENTS), seed=seed)[0] for seed in range(3)])
        measured = misallocation(problem, averages).mean(axis=0)
        predicted = theory.convergence(problem, response=CURED).misallocation(10_000.0)
        assert ((measured > predicted.low) & (measured < predicted.high)).all()

    def test_coupled_costs_are_cured(self) -> None:
        problems = [random_convex(seed=seed, n_agents=20, n_resources=3) for seed in range(4)]
        found = deviations(problems, 2000, Way(EVENTS, PART), BOTH)
        assert abs(found.mean()) < 4 * found.std(ddof=1) / np.sqrt(len(found))


class TestAverages:
    @pytest.mark.parametrize("elasticities", [(0.2, 1.0), (0.3, 0.6)])
    def test_slow_costs_and_a_gain(self, elasticities: tuple[float, float]) -> None:
        problem, at = slow_costs(elasticities), [3000, 10_000, 20_000]
        expected = theory.convergence(problem, response=BOTH)
        assert expected.slowest == pytest.approx(min(elasticities), abs=0.01)
        measured = misallocation(problem, run_response(problem, at, Way(EVENTS, PART)))[:, 0]
        predicted = expected.misallocation(at).mean[:, 0]
        assert (abs(measured / predicted - 1.0) < kappa(expected)).all()
        slopes = [np.polyfit(np.log(at), np.log(values), 1)[0] for values in (measured, predicted)]
        assert slopes[0] == pytest.approx(slopes[1], abs=0.03)

    @pytest.mark.parametrize("elasticities", [(0.2, 1.0), (0.3, 1.0), (0.6, 1.0)])
    def test_no_error_falls_faster_than_the_sum_of_a_period(
        self, elasticities: tuple[float, float], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        problem, at = slow_costs(elasticities), np.round(np.geomspace(3000.0, 300_000.0, 9)).tolist()
        rule: dict[str, Any] = {"response": BOTH, "averaging": averaging.Polynomial(5.0)}
        found = slopes(problem, at, 1, **rule)
        assert found.measured == pytest.approx(found.predicted, abs=0.03)
        # Negative control: theory without it, where modes die away as fast as k**-3.
        monkeypatch.setattr(sawtooth, "sums_of_deviations", lambda _, steady: 0.0 * steady.found[None])
        smooth = np.polyfit(
            np.log(at), np.log(theory.convergence(problem, **rule).misallocation(at).mean[:, 0]), 1
        )
        assert (abs(found.measured - smooth[0]) > 0.5) == (elasticities[0] == 0.6)

    @pytest.mark.parametrize(("gain", "other"), [(1.0, 5.0), (5.0, 1.0)])
    def test_slopes_of_runs_that_draw_are_those_of_all_modes_together(
        self, gain: float, other: float
    ) -> None:
        rules: list[dict[str, Any]] = [
            {"response": CURED, "averaging": averaging.Polynomial(each)} for each in (gain, other)
        ]
        problem, at = slow_costs((0.3, 1.0)), (3000.0, 10_000.0, 30_000.0)
        found, wrong = (slopes(problem, at, runs, **rule) for runs, rule in zip((16, 1), rules, strict=True))
        assert (abs(found.measured - found.predicted) < 4 * found.error).all()
        assert (abs(found.measured - wrong.predicted) > 4 * found.error).all()

    def test_a_gain_damps_slow_costs_and_adds_noise(self) -> None:
        problem, at = slow_costs((0.3, 0.6)), [3000, 10_000]
        runs = [run_response(problem, at, Way(EVENTS, gain=5.0), seed=seed) for seed in range(4)]
        measured = misallocation(problem, np.stack(runs))[:, :, 0]
        options: dict[str, Any] = {"response": CURED, "averaging": averaging.Polynomial(5.0)}
        expected = theory.convergence(problem, **options)
        off = measured.mean(axis=0) / expected.misallocation(at).mean[:, 0] - 1.0
        error = measured.std(axis=0, ddof=1) / measured.mean(axis=0) / 2.0
        assert (abs(off) < 4 * error + kappa(expected)).all()
        noise = theory.convergence(problem, response=CURED)
        assert np.trace(expected.covariance(1e4)[0]) > np.trace(noise.covariance(1e4)[0])

    @pytest.mark.parametrize("averages", [averaging.Window(1000.0), averaging.Forgetting(500.0)])
    def test_a_finite_memory_keeps_noise(self, averages: averaging.Averaging) -> None:
        problem = smart_cameras(seed=0)
        expected = theory.convergence(problem, averaging=averages)
        at = list(np.arange(5000.0, 30_001.0, 2500.0))
        measured = synchronous(problem, at, 4, averaging=averages).reshape(-1, 60, 3)
        # 44 averages, of memories that do not overlap.  The next order is the time in which agents find new
        # shares, over that of the memory.
        later = np.array([block.settling for block in expected.blocks]) / 500.0
        assert (
            abs(spread_ratio(expected, measured, 30_000.0) - 1.0) < 4 / np.sqrt(2 * 44 * 30) + later
        ).all()
        assert np.isinf(expected.needed(0.001).length).all()

    def test_long_memories_of_both_kinds_are_all_of_the_past(self) -> None:
        exponents = np.array([0.3, 0.5, 1.0, 4.0])
        pair = exponents[None, :, None], exponents[None, None, :]
        all_of_it = remaining(Memory(), *pair, 10.0, 0.0, 1000.0)
        for memory in (Memory(window=1e4), Memory(time_constant=1e9)):
            assert np.allclose(remaining(memory, *pair, 10.0, 0.0, 1000.0), all_of_it, rtol=1e-4)

    def test_a_window_of_quadratic_costs_averages_as_it_should(self) -> None:
        ones = np.ones((1, 1, 1))
        assert remaining(Memory(window=100.0), ones, ones, 1.0, 0.0, 1e4) == pytest.approx(0.01, rel=2e-3)


def looked_at(problem: Problem, response: responses.Response, steps: int) -> tuple[FloatArray, ...]:
    """Run without lag: signals a step, use, and how far above the threshold signals find the total, (m,)."""
    recording = Recording(demand=list(range(steps)))
    run = run_synchronous(problem, steps=steps, seed=1, lag=0, response=response, recording=recording)
    above = run.observations.total_demand[:steps] - problem.limit
    acts = above > 0.0
    beyond = (above * acts).sum(axis=0) / acts.sum(axis=0) / problem.increase.sum(axis=0)
    table = run.summary()
    return table["signals"].to_numpy() / steps, table["utilisation"].to_numpy(), beyond


def on_the_way(problem: Problem, response: responses.Response, steps: int) -> FloatArray:
    """Compute by how much the start may change signals and use, relatively, (m,).

    Until total demand reaches the capacity there is no signal; after that cuts are off by what averages are,
    in the mean over the run.
    """
    until = problem.limit / problem.increase.sum(axis=0)
    at = np.geomspace(1.5 * until.max(), steps, 20)
    rows = theory.convergence(problem, response=response).misallocation(at).mean
    weighted = rows * at[:, None]
    return (until + np.diff(np.log(at)) @ (0.5 * (weighted[1:] + weighted[:-1]))) / steps


@pytest.mark.parametrize("response", [PARTS, BOTH], ids=["average", "events"])
def test_runs_without_draws_have_the_signals_and_the_use_of_their_pattern(
    response: responses.Response,
) -> None:
    problem, steps = smart_cameras(seed=0), 30_000
    signals, used, beyond = looked_at(problem, response, steps)
    setting = check_setting(
        problem, "discrete", latency=0.0, period=0.0, loss=0.0, hold_off=None, response=response
    )._replace(sway=problem.increase**2 / 12.0)
    allowed = on_the_way(problem, response, steps)
    known = settle(setting._replace(found=beyond))
    assert (abs(signals / known.signals - 1.0) < allowed).all()
    assert (abs(used - known.average.sum(axis=0) / problem.capacity) < allowed).all()
    # Where signals find one more step of growth, both are off.
    other = settle(setting._replace(found=beyond + 1.0))
    assert (abs(signals / other.signals - 1.0) > allowed).all()
    assert (abs(used - other.average.sum(axis=0) / problem.capacity) > allowed).all()


def test_the_step_that_crosses_ends_evenly_spread_in_the_mean_over_patterns() -> None:
    # A pattern has a few places above the threshold: 8 draws of the costs, two responses, 3 resources.
    places = np.concatenate(
        [looked_at(smart_cameras(seed=draw), way, 10_000)[2] for draw in range(8) for way in (PARTS, BOTH)]
    )
    error = places.std(ddof=1) / np.sqrt(len(places))
    assert abs(places.mean() - 0.5) < 4.0 * error
    assert abs(places.mean() - 0.25) > 4.0 * error


@pytest.mark.parametrize("response", [CURED, WHOLE], ids=["drawn", "full"])
def test_signals_and_use_are_predicted_for_responses_that_keep_saws_apart(
    response: responses.Response,
) -> None:
    problem, steps = smart_cameras(seed=0), 30_000
    expected = theory.predict(problem, response=response)
    signals, used, _ = looked_at(problem, response, steps)
    allowed = 2.0 * problem.limit / problem.increase.sum(axis=0) / steps
    if response is CURED:
        allowed += 4.0 / np.sqrt(steps * expected.signals) * spread_of_gaps(problem)
    else:
        # The number of signals from one cut to the next varies by less than one: its variance is at most
        # 1/4, which theory leaves out, and changes the mean over an interval by this part.
        beta = problem.decrease
        allowed += (0.25 * expected.probability**2 * (1.0 - beta) / (1.0 + beta)).max(axis=0)
    assert (abs(signals / expected.signals - 1.0) < allowed).all()
    assert (abs(used - expected.utilisation) < allowed).all()
    assert (abs(signals / theory.predict(problem).signals - 1.0) > allowed).all()


class TestTheInterface:
    def test_idle_capacity_makes_up_the_error_of_long_runs(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # Of 36 cases, each inside with 0.95, less than 31 are inside at odds of one in a hundred.
        problem, at = smart_cameras(seed=1), 30_000.0
        optimum = solve_optimum(problem).allocation
        averages = synchronous(problem, [at], 12)[:, 0]
        measured = np.abs(averages - optimum).sum(axis=1) / problem.capacity
        inside = {}
        for off in (5e-4, 0.0):
            monkeypatch.setattr("aimd_des.theory.accuracy._TOTALS", off)
            _, low, high = theory.convergence(problem).relative_error(at)
            inside[off] = ((low <= measured) & (measured <= high)).sum(axis=0)
        assert inside[5e-4].sum() >= 31
        assert inside[0.0].min() < 6  # without the error of the predicted totals

    def test_what_an_accuracy_takes(self) -> None:
        problem = smart_cameras(seed=0)
        expected = theory.convergence(problem)
        needed = expected.needed(0.01)
        for j, length in enumerate(needed.length.tolist()):
            assert expected.misallocation(length).mean[j] == pytest.approx(0.01, rel=0.01)
        assert np.allclose(needed.signals, needed.length * expected.signals)
        assert np.isinf(expected.needed(0.001).length).all()

    def test_times_in_any_order(self) -> None:
        expected = theory.convergence(smart_cameras(seed=0, n_cameras=6))
        row = expected.misallocation([1e5, 5.0, 1e3])
        assert row.mean.shape == row.low.shape == row.high.shape == (3, 3)
        assert np.allclose(row.mean[2], expected.misallocation(1e3).mean)
        assert np.allclose(expected.average(5.0), 2.5 * expected.problem.increase)  # nobody has cut yet
        assert (expected.relative_error(1e3).mean > expected.misallocation(1e3).mean).all()

    def test_many_agents_are_taken_one_by_one(self, monkeypatch: pytest.MonkeyPatch) -> None:
        problem = smart_cameras(seed=0)
        together = theory.convergence(problem)
        monkeypatch.setattr("aimd_des.theory.accuracy._TOGETHER", 59)
        alone = theory.convergence(problem)
        assert [len(values) for values in (*together.exponents, *alone.exponents)] == [59] * 3 + [60] * 3
        variances = [np.einsum("jii->j", kind.covariance(1e4)) for kind in (together, alone)]
        assert (abs(variances[1] / variances[0] - 1.0) < 0.1).all()

    def test_a_few_kinds_of_agents_sway_for_all(self, monkeypatch: pytest.MonkeyPatch) -> None:
        problem, lost = smart_cameras(seed=0), np.linspace(0.0, 0.4, 60)
        found = {}
        for kinds in (3, 8, 12):
            monkeypatch.setattr("aimd_des.theory.sways._KAPPAS", kinds)
            found[kinds] = theory.convergence(problem, lag=5, loss=lost)
        average = {kinds: one.steady.average for kinds, one in found.items()}
        assert np.allclose(average[8], average[12], rtol=1e-6)
        assert not np.allclose(average[3], average[12], rtol=1e-4)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"lag": 1, "latency": 1.0}, "lag"),
            ({"lag": 1, "dynamics": "continuous"}, "lag"),
            ({"exact": True, "response": WHOLE}, "exact"),
            ({"response": "paper"}, "response"),
            ({"response": responses.CustomResponse(one_third)}, "theory cannot look into"),
            ({"averaging": object()}, "averaging"),
            ({"loss": 1.0}, "loss"),
        ],
    )
    def test_what_is_not_covered_is_refused(self, arguments: dict[str, Any], message: str) -> None:
        with pytest.raises(InputError, match=message):
            theory.convergence(smart_cameras(seed=0, n_cameras=6), **arguments)

    def test_cut_off_probabilities_are_refused(self) -> None:
        problem = Problem([resource(capacity=10.0, normalization=0.6)], PolynomialCosts([2], [[[1.0]]] * 10))
        with pytest.raises(InputError, match="response probability of agent 0"):
            theory.convergence(problem)
        assert theory.convergence(problem, response=PARTS).slowest == pytest.approx(1.0)

    @pytest.mark.parametrize("at", [0.0, [1.0, -1.0], float("nan")])
    def test_times_are_positive(self, at: Any) -> None:
        with pytest.raises(InputError, match="at"):
            theory.convergence(smart_cameras(seed=0, n_cameras=6)).misallocation(at)

    def test_an_accuracy_is_positive(self) -> None:
        with pytest.raises(InputError, match="accuracy"):
            theory.convergence(smart_cameras(seed=0, n_cameras=6)).needed(0.0)


def test_the_interval_of_many_agents_is_that_of_independent_draws() -> None:
    n = 1_200
    costs = PolynomialCosts([2], np.random.default_rng(0).uniform(1.0, 2.0, (n, 1, 1)))
    found = theory.convergence(Problem([Resource("memory", n, 0.02, 0.5, 0.1)], costs))
    expected = found.misallocation(1e4)
    spread = np.sqrt(np.diag(found.covariance(1e4)[0]))
    average = found.average(1e4)[:, 0]
    bias = average - solve_optimum(found.problem, capacity=average.sum(keepdims=True)).allocation[:, 0]
    draws = np.abs(bias + np.random.default_rng(1).standard_normal((4_000, n)) * spread).sum(axis=1)
    draws /= average.sum()
    # The standard error of a 2.5 % quantile of normal draws: 2.7 standard deviations over the root of their
    # number.
    error = 2.7 * draws.std() / np.sqrt(len(draws))
    low, high = np.percentile(draws, [2.5, 97.5])
    assert abs(expected.low[0] - low) < 4.0 * error
    assert abs(expected.high[0] - high) < 4.0 * error
    assert abs(expected.mean[0] - draws.mean()) < 4.0 * error
