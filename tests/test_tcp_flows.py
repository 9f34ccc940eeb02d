"""TCP flows: proportional fairness, held against an independent solver, and the square-root law."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from aimd_des import InputError, Result, run_synchronous, solve_optimum, theory
from aimd_des.scenario.models import model_parameters, named_model
from aimd_des.utils.validation import FloatArray
from models import tcp_flows

WEIGHTS = np.array([1.0, 1.25, 1.5, 1.75, 2.0] * 4)
STEPS, REPLICATIONS = 40_000, 4


def proportionally_fair(weights: FloatArray, capacity: float) -> FloatArray:
    """Maximise sum_i w_i log x_i subject to sum_i x_i = C by SciPy, in shares of the capacity."""
    found = minimize(
        lambda shares: -(weights * np.log(shares)).sum(),
        np.full(len(weights), 1 / len(weights)),
        jac=lambda shares: -weights / shares,
        bounds=[(1e-6, 1.0)] * len(weights),
        constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1, "jac": np.ones_like},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert found.success
    return np.asarray(capacity * found.x)


def runs(law: str) -> list[Result]:
    problem = tcp_flows(law=law)  # type: ignore[arg-type]
    return [run_synchronous(problem, steps=STEPS, seed=seed, lag=0) for seed in range(REPLICATIONS)]


def test_the_fair_point_is_in_proportion_to_the_weights() -> None:
    fair = proportionally_fair(WEIGHTS, 1000.0)
    assert fair == pytest.approx(1000.0 * WEIGHTS / WEIGHTS.sum(), rel=1e-5)
    assert solve_optimum(tcp_flows()).allocation[:, 0] == pytest.approx(fair, rel=1e-5)
    reno = tcp_flows(law="reno")
    reached = theory.reweighted_optimum(reno, (1 - reno.decrease) / reno.increase)
    assert reached.allocation[:, 0] == pytest.approx(fair, rel=1e-5)
    # Negative control: without the weights its costs know nothing of round-trip times.
    assert solve_optimum(reno).allocation[:, 0] == pytest.approx(50.0)


@pytest.mark.parametrize("law", ["proportional", "reno"])
def test_averages_settle_at_the_fair_point(law: str) -> None:
    # 4 replications of 40,000 steps. Half a saw tooth is left out of the shares: 1.2 packets (reno: to 2.2)
    # of about 50. Most of that drops out, since it is missing from every share.
    average = np.mean([run.average_at_end[:, 0] for run in runs(law)], axis=0)
    fair = proportionally_fair(WEIGHTS, average.sum())
    assert np.abs(average - fair).sum() / average.sum() < 0.02
    assert np.abs(average - average.mean()).sum() / average.sum() > 0.15  # 0.2 where fair
    # No flow can gain by its share, in the sense of log utilities, more than another loses.
    utility = (WEIGHTS * np.log(average)).sum()
    assert utility <= (WEIGHTS * np.log(fair)).sum() < utility + 0.001 * WEIGHTS.sum()


@pytest.mark.parametrize("law", ["proportional", "reno"])
def test_flows_obey_the_square_root_law(law: str) -> None:
    # A flow's packet loss is its responses per packet sent. It only grows in steps without a signal. Signals
    # come at nearly even distances and a flow responds to one in ten, so this is between "poisson" and
    # "periodic": the constant is 1 / (1 - beta) - lambda / 2, its root 1.3 % less than for "poisson".
    ratios = {"poisson": [], "periodic": []}  # type: dict[str, list[float]]
    for run in runs(law):
        average = run.average_at_end[:, 0]
        lost = run.account.responses[0] / (average * STEPS)
        growth = run.problem.increase[:, 0] * (1 - len(run.signals) / STEPS)
        for losses, found in ratios.items():
            rate = theory.square_root_law(growth, 0.5, lost, losses)  # type: ignore[arg-type]
            found.append(float((average / rate).mean()))
    error = np.std(ratios["poisson"], ddof=1) / math.sqrt(REPLICATIONS)
    assert abs(np.mean(ratios["poisson"]) - math.sqrt(1 - 0.1 / 4)) < 0.01 + 4 * error
    assert np.mean(ratios["periodic"]) > 1.1


def test_reno_loses_the_same_share_of_packets_of_every_flow() -> None:
    # 4 replications; a flow responds about 1900 times in each. p = Gamma * signals per step.
    results = runs("reno")
    lost = [run.account.responses[0] / (run.average_at_end[:, 0] * STEPS) for run in results]
    signals = np.mean([len(run.signals) / STEPS for run in results])
    expected = results[0].problem.normalization[0] * signals
    error = np.std(lost, axis=0, ddof=1).mean() / math.sqrt(REPLICATIONS)
    assert (np.abs(np.mean(lost, axis=0) - expected) < 5 * error).all()
    # Negative control: flows that are hit per unit of time lose more of their packets the slower they are.
    other = [run.account.responses[0] / (run.average_at_end[:, 0] * STEPS) for run in runs("proportional")]
    assert np.mean(other, axis=0).max() > 2 * np.mean(other, axis=0).min()


@pytest.mark.parametrize("law", ["proportional", "reno"])
def test_theory_predicts_the_link(law: str) -> None:
    results = runs(law)
    expected = theory.predict(results[0].problem)
    signals = np.mean([len(run.signals) / STEPS for run in results])
    used = np.mean([run.average_at_end.sum() / 1000.0 for run in results])
    assert signals == pytest.approx(expected.signals[0], rel=0.05)
    assert used == pytest.approx(expected.utilisation[0], abs=0.02)
    assert expected.probability.sum() == pytest.approx(2.0, rel=0.1)


def test_nobody_saturates_up_to_the_most_responses() -> None:
    for law, most in (("proportional", (1 / WEIGHTS).sum()), ("reno", WEIGHTS.sum() / 2)):
        with pytest.raises(InputError, match="responses"):
            tcp_flows(law=law, responses=most * 1.001)  # type: ignore[arg-type]
        problem = tcp_flows(law=law, responses=most * 0.999)  # type: ignore[arg-type]
        fair = (1000.0 * WEIGHTS / WEIGHTS.sum())[:, None]
        chance = problem.normalization * problem.costs.gradient(fair) / fair
        assert chance.sum() == pytest.approx(most * 0.999)
        assert chance.max() <= 1.0


def test_it_is_registered_with_defaults() -> None:
    assert named_model("models.tcp_flows") is tcp_flows
    parameters = model_parameters("models.tcp_flows", {"law": "reno"}, seed=0)
    assert tcp_flows(**parameters).increase[:, 0] == pytest.approx(WEIGHTS**2)


def test_wrong_parameters_are_refused_by_name() -> None:
    for wrong, name in (
        ({"weights": [1.0, -1.0]}, r"weights\[1\]"),
        ({"law": "vegas"}, "law"),
        ({"capacity": 0.0}, "capacity"),
        ({"responses": 0.0}, "responses"),
    ):
        with pytest.raises(InputError, match=name):
            tcp_flows(**wrong)  # type: ignore[arg-type]
