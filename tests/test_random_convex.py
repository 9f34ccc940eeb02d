"""Random convex problems: their optimum is known, and is what solvers and runs come to."""

import math
import re
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from aimd_des import (
    CoupledCosts,
    InputError,
    PolynomialCosts,
    Problem,
    run_synchronous,
    solve_optimum,
    theory,
)
from aimd_des.scenario.models import model_parameters, named_model
from models import random_convex
from models.random_convex import random_optimum

STEPS, REPLICATIONS = 20_000, 16


def drawn_optimum(seed: int, n: int, m: int) -> Any:
    """The optimum from NumPy's Philox alone: the first m numbers of an agent, in multiples of a scale."""
    key = np.random.SeedSequence(seed, spawn_key=(0,)).generate_state(2, np.uint64)
    generator = np.random.Generator(np.random.Philox(key=key))
    scale = 10 ** (2 * generator.random((3, m))[0] - 1)
    return (0.4 + 1.2 * generator.random((n, 5 * m + 3 + m * m))[:, :m]) * scale


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("n", [1, 2, 7, 60, 2000])
@pytest.mark.parametrize("coupled", [True, False])
def test_the_optimum_is_where_it_was_put(n: int, m: int, coupled: bool) -> None:
    for seed in range(5 if n < 100 else 1):
        optimum = solve_optimum(random_convex(seed, n, m, coupled))
        assert optimum.kkt_residual <= 1e-10
        # A derivative that is off by 1e-10 moves y by 1e-10 over the least curvature: of a derivative of 1 at
        # least 0.2 is an agent's own and 0.1 / 2.1 of that its square, so 0.2 * 0.1 / 2.1 / 1.6 and y >= 0.4.
        least = 0.2 * 0.1 / 2.1 / 1.6
        np.testing.assert_allclose(optimum.allocation, drawn_optimum(seed, n, m), rtol=1e-10 / least / 0.4)
        np.testing.assert_array_equal(random_optimum(seed, n, m).shape, (n, m))


def test_the_known_optimum_is_the_one_that_was_drawn() -> None:
    for seed in (0, 1, 12345):
        np.testing.assert_allclose(random_optimum(seed, 9, 3), drawn_optimum(seed, 9, 3), rtol=1e-14)


@pytest.mark.parametrize("coupled", [True, False])
def test_no_allocation_costs_less(coupled: bool) -> None:
    # SciPy, in shares, with values only.
    problem, known = random_convex(4, 4, 2, coupled), random_optimum(4, 4, 2)
    share = problem.capacity / 4
    found = minimize(
        lambda y: problem.costs.value(y.reshape(4, 2) * share).sum(),
        np.ones(8),
        bounds=[(0.0, 4.0)] * 8,
        constraints={"type": "eq", "fun": lambda y: y.reshape(4, 2).mean(axis=0) - 1},
        method="SLSQP",
        options={"ftol": 1e-13, "maxiter": 500},
    )
    assert found.success
    assert float(problem.costs.value(known).sum()) == pytest.approx(found.fun, rel=1e-9)
    np.testing.assert_allclose(found.x.reshape(4, 2) * share, known, rtol=1e-3)


def test_agents_differ_and_resources_interact() -> None:
    problem, known = random_convex(1, 100, 3), random_optimum(1, 100, 3)
    assert isinstance(problem.costs, CoupledCosts)
    hessian = problem.costs.hessian(known)
    assert (hessian[:, 0, 1] > 0).all()
    shares = known / known.mean(axis=0)
    assert shares.min() < 0.5
    assert shares.max() > 1.5
    # Who solves without the interaction gives a tenth of every resource to the wrong agents.
    alone = solve_optimum(Problem(problem.resources, problem.costs.separable_part)).allocation
    assert (np.abs(alone - known).sum(axis=0) / problem.capacity > 0.05).all()


def test_without_interaction_the_optimum_is_the_same() -> None:
    alone = random_convex(2, 30, 3, coupled=False)
    assert isinstance(alone.costs, PolynomialCosts)
    gradient = alone.costs.gradient(random_optimum(2, 30, 3))
    np.testing.assert_allclose(gradient, np.broadcast_to(gradient[0], gradient.shape), rtol=1e-13)
    np.testing.assert_array_equal(alone.capacity, random_convex(2, 30, 3).capacity)


@pytest.mark.parametrize("coupled", [True, False])
def test_the_first_agents_stay_when_more_are_added(coupled: bool) -> None:
    few, many = random_convex(7, 10, 3, coupled), random_convex(7, 61, 3, coupled)
    x = np.random.default_rng(7).uniform(0.1, 9.0, (61, 3))
    np.testing.assert_allclose(few.costs.gradient(x[:10]), many.costs.gradient(x)[:10], rtol=1e-14)
    np.testing.assert_array_equal(random_optimum(7, 10, 3), random_optimum(7, 61, 3)[:10])
    for name in ("increase", "decrease"):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[:10])
    np.testing.assert_array_equal(few.normalization, many.normalization)


def test_the_seed_decides_everything() -> None:
    one, same, other = random_convex(1), random_convex(1), random_convex(2)
    x = random_optimum(1)
    np.testing.assert_array_equal(one.costs.gradient(x), same.costs.gradient(x))
    for name in ("capacity", "increase", "decrease", "normalization"):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
        assert (getattr(one, name) != getattr(other, name)).all()
    assert (one.costs.gradient(x) != other.costs.gradient(x)).all()


@pytest.mark.parametrize("probability", [0.05, 0.25, 1.0])
def test_response_probabilities_at_the_optimum_are_moderate(probability: float) -> None:
    for seed in range(5):
        problem = random_convex(seed, 400, 3, probability=probability)
        known = random_optimum(seed, 400, 3)
        chance = problem.normalization * problem.costs.gradient(known) / known
        assert (chance <= probability * (1 + 1e-12)).all()
        assert (chance >= probability / 4 * (1 - 1e-12)).all()
        assert (chance.max(axis=0) > 0.95 * probability).all()  # of 400 agents some are near the end


@pytest.mark.parametrize("steps", [20.0, 60.0])
def test_capacities_are_reached_after_so_many_steps(steps: float) -> None:
    for seed in range(5):
        problem = random_convex(seed, 400, 3, steps=steps)
        time = problem.capacity / problem.increase.sum(axis=0)
        # The mean of 400 uniform numbers on 0.4 to 1.6 has standard deviation 0.35 / 20.
        assert (np.abs(time / steps - 1) < 0.25 * (1 + 4 * 0.0175) + 4 * 0.0175).all()
        assert (problem.capacity != problem.capacity.round(2)).all()


def test_with_the_defaults_there_is_room_for_a_signal_per_unit_of_time() -> None:
    for seed in range(50):
        problem = random_convex(seed, 30, 3)
        gradient = problem.costs.gradient(random_optimum(seed, 30, 3))
        cuts = ((1 - problem.decrease) * problem.normalization * gradient).sum(axis=0)
        assert (problem.increase.sum(axis=0) / cuts < 1 / (0.4 * 0.25 * 0.3 * 45)).all()
    # What a run needs is near that: it grows a little less, and has smaller derivatives where less is used.
    expected = theory.predict(random_convex(0, 60, 3), "continuous")
    assert (expected.signals < 1.0).all()


@pytest.mark.parametrize(("coupled", "m"), [(True, 2), (False, 1)])
def test_averages_settle_at_the_optimum(coupled: bool, m: int) -> None:
    # 16 replications of 20,000 steps.  A signal finds an agent half a saw tooth h above its average, so what
    # settles to a common value is the derivative times 1 + h / x.  These factors lie between 1 and
    # 1 + h / min x, and the inverse of the elasticities takes their logarithms to those of the averages.
    problem = random_convex(5, 20, m, coupled)
    results = [run_synchronous(problem, steps=STEPS, seed=seed) for seed in range(REPLICATIONS)]
    assert sum(int(result.account.saturated.sum()) for result in results) == 0
    averages = np.array([result.average_at_end for result in results])
    mean = averages.mean(axis=0)
    error = (averages.std(axis=0, ddof=1) / mean).mean() / math.sqrt(REPLICATIONS)
    optimum = solve_optimum(problem, capacity=mean.sum(axis=0)).allocation
    signals = np.mean([len(result.signals) for result in results]) / STEPS / m
    tooth = problem.increase * (1 - signals) / (2 * signals)
    gradient = problem.costs.gradient(optimum)
    elasticity = problem.costs.hessian(optimum) * optimum[:, None, :] / gradient[:, :, None]
    stretch = np.abs(np.linalg.inv(elasticity)).sum(axis=2).max()
    tolerance = stretch * (tooth / optimum).max() + 4 * error
    assert tolerance < 0.12
    assert np.abs(mean / optimum - 1).max() < tolerance
    # Negative control: equal shares, and the optimum of somebody who forgets the interaction.
    assert np.abs(mean / mean.mean(axis=0) - 1).max() > 2 * tolerance
    if isinstance(problem.costs, CoupledCosts):
        forgetful = Problem(problem.resources, problem.costs.separable_part)
        wrong = solve_optimum(forgetful, capacity=mean.sum(axis=0)).allocation
        assert np.abs(mean / wrong - 1).max() > 2 * tolerance


def test_it_is_registered_with_defaults() -> None:
    assert named_model("models.random_convex") is random_convex
    parameters = model_parameters("models.random_convex", {"n_resources": 3}, seed=4)
    assert parameters["seed"] == 4
    assert random_convex(**parameters).resource_names == ("resource 0", "resource 1", "resource 2")
    assert random_convex(**parameters).n_agents == 20


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_agents": 0}, "n_agents = 0: must be an integer of at least 1"),
        ({"n_resources": 2.0}, "n_resources = 2.0: must be an integer of at least 1"),
        ({"coupled": "no"}, "coupled = 'no': must be True or False"),
        ({"probability": 0.0}, "probability = 0.0: must be a finite number greater than 0 and at most 1"),
        ({"probability": 1.5}, "probability = 1.5: must be a finite number greater than 0 and at most 1"),
        ({"steps": 0.5}, "steps = 0.5: must be a finite number at least 1"),
        ({"seed": -1}, "seed = -1: must be an integer of at least 0"),
    ],
)
def test_it_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        random_convex(**options)


def test_the_known_optimum_refuses_by_name() -> None:
    with pytest.raises(InputError, match="n_agents = 0"):
        random_optimum(0, 0)
    with pytest.raises(InputError, match="n_resources = 0"):
        random_optimum(0, 5, 0)
