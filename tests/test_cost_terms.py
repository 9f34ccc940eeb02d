"""Exponential, power, utility and tracking costs: on paper, in all three ways of running, their optima."""

import re
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from aimd_des import (
    AgentProcess,
    CoupledCosts,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Resource,
    Simulation,
    normalization_factors,
    run_synchronous,
    solve_optimum,
)
from aimd_des.costs import (
    Costs,
    ExponentialCosts,
    PowerCosts,
    TermCosts,
    TrackingCosts,
    UtilityCosts,
    weighted_costs,
)
from aimd_des.problem.costs import cost_table, marginal_cost, selected_costs
from aimd_des.problem.costs.kernels import gradient_row
from aimd_des.problem.optimum.normalization import _search
from aimd_des.scenario import Scenario
from aimd_des.utils.validation import FloatArray
from tests.conftest import assert_same_run, quietly
from tests.test_costs import derivative, rounding

RNG = np.random.default_rng(3)
N, M = 5, 2
FIRST, SECOND = RNG.uniform(0.5, 2.0, (2, N, M))
PAIR = RNG.uniform(0.1, 1.0, (N, M, 2))

# Parameters are those of the file, too.
PARAMETERS: dict[str, dict[str, Any]] = {
    "exponential": {"scales": FIRST, "rates": SECOND},
    "power": {"exponents": [1.5, 2.7], "coefficients": PAIR},
    "utility": {"weights": FIRST, "shifts": 0.5, "fairness": 1.5},
    "tracking": {"targets": FIRST, "weights": SECOND, "price": [5.0, 6.0]},
    "terms": {
        "slopes": np.broadcast_to([0.5, 1.0], (N, M, 2)),
        "exponentials": np.stack([FIRST, SECOND], axis=-1)[:, :, None],
        "powers": np.stack(np.broadcast_arrays(PAIR, [1.5, -0.5], [0.0, 2.0]), axis=-1),
        "constant": FIRST,
    },
}
KINDS: dict[str, Callable[..., TermCosts]] = {
    "exponential": ExponentialCosts,
    "power": PowerCosts,
    "utility": UtilityCosts,
    "tracking": TrackingCosts,
    "terms": TermCosts,
}


def costs_of(name: str) -> TermCosts:
    return KINDS[name](**PARAMETERS[name])


NAMES = list(KINDS)


def problem_of(costs: Costs, capacity: float = 4.0) -> Problem:
    gamma = normalization_factors(costs, [2.5 * capacity / N] * M, lower=0.1 * capacity / N)
    return Problem(
        [Resource(f"r{j}", capacity, increase=0.02, decrease=0.6, normalization=gamma[j]) for j in range(M)],
        costs,
    )


# -- on paper --------------------------------------------------------------------------------------------


def test_values_are_those_on_paper() -> None:
    x = RNG.uniform(0.0, 3.0, (N, M))
    a, b = FIRST, SECOND
    price = (a * 0.5**-1.5).max(axis=0)
    utility = a * ((x + 0.5) ** -0.5 - 0.5**-0.5) / -0.5
    paper = {
        "exponential": a * (np.exp(b * x) - 1.0),
        "power": PAIR[:, :, 0] * x**1.5 + PAIR[:, :, 1] * x**2.7,
        "utility": price * x - utility,
        "tracking": np.array([5.0, 6.0]) * x + b * (x - a) ** 2 / 2,
    }
    for name, values in paper.items():
        np.testing.assert_allclose(costs_of(name).value(x), values.sum(axis=1), rtol=1e-12)
    logarithmic = UtilityCosts(a, shifts=0.5)
    np.testing.assert_allclose(logarithmic.utility(x), (a * np.log(1 + x / 0.5)).sum(axis=1), rtol=1e-12)
    np.testing.assert_allclose(UtilityCosts(a, 0.5, 1.5).utility(x), utility.sum(axis=1), rtol=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from(NAMES))
def test_derivatives_are_those_of_the_values(seed: int, name: str) -> None:
    costs, x = costs_of(name), np.random.default_rng(seed).uniform(0.1, 3.0, (N, M))
    gradient, hessian = costs.gradient(x), costs.hessian(x)
    for j in range(M):
        error = np.abs(derivative(costs.value, x, j) - gradient[:, j])
        assert (error <= 1e-8 * np.abs(gradient[:, j]) + rounding(costs.value(x), x, j)).all()
        error = np.abs(derivative(costs.gradient, x, j) - hessian[:, :, j])
        assert (error <= 1e-8 * np.abs(hessian[:, :, j]) + rounding(gradient, x, j)).all()


def test_utilities_with_a_fairness_near_one_are_near_the_logarithm() -> None:
    x = np.array([[0.0, 1e-9], [1.0, 1e6]])
    near, one = (UtilityCosts(np.ones((2, 2)), 2.0, fairness) for fairness in (1.0 + 1e-9, 1.0))
    np.testing.assert_allclose(near.utility(x), one.utility(x), rtol=1e-7)


def test_powers_with_whole_exponents_are_polynomials() -> None:
    x = RNG.uniform(0.0, 3.0, (N, M))
    one, other = PowerCosts([2.0, 3.0], PAIR), PolynomialCosts([2, 3], PAIR)
    for name in ("value", "gradient", "hessian"):
        np.testing.assert_allclose(getattr(one, name)(x), getattr(other, name)(x), rtol=1e-13)


def test_a_term_that_an_agent_lacks_is_nothing_where_it_holds_nothing() -> None:
    costs = PowerCosts([1.5, 3.0], [[[0.0, 1.0]]])
    assert costs.hessian(np.zeros((1, 1))).tolist() == [[[0.0]]]


@pytest.mark.parametrize("name", NAMES)
def test_weights_and_selections_stay_in_the_family(name: str) -> None:
    costs, x = costs_of(name), RNG.uniform(0.1, 3.0, (N, M))
    weights, few = RNG.uniform(0.5, 2.0, N), np.array([True, False, True, True, False])
    weighted, selected = weighted_costs(costs, weights), selected_costs(costs, few)
    assert type(weighted) is type(selected) is type(costs)
    for method in ("value", "gradient", "hessian"):
        plain = getattr(costs, method)(x)
        spread = weights.reshape(-1, *[1] * (plain.ndim - 1))
        np.testing.assert_allclose(getattr(weighted, method)(x), spread * plain, rtol=1e-13)
        np.testing.assert_array_equal(getattr(selected, method)(x[few]), plain[few])
    table = RNG.uniform(0.5, 2.0, (N, M))
    np.testing.assert_allclose(
        weighted_costs(costs, table).gradient(x), table * costs.gradient(x), rtol=1e-13
    )


# -- runs ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_one_agents_derivative_has_the_bits_of_the_kernel(name: str) -> None:
    costs, averages = costs_of(name), RNG.uniform(0.0, 3.0, (M, N))
    averages[0, 0] = 0.0
    out, spare = np.empty((M, N)), np.empty((2, N))
    for j in range(M):
        gradient_row(cost_table(costs), averages, j, out[j], spare)
    singles = [[marginal_cost(costs, i)(averages[:, i].tolist(), j) for i in range(N)] for j in range(M)]
    assert out.tolist() == singles
    np.testing.assert_allclose(out, costs.gradient(averages.T).T, rtol=1e-13)


def test_all_tables_have_one_type() -> None:
    """Or the fleet would be compiled once more."""
    tables = [
        cost_table(costs) for name in NAMES for costs in (costs_of(name), selected_costs(costs_of(name), [0]))
    ]
    assert len({numba.typeof(table) for table in [cost_table(PolynomialCosts([2], [[[1.0]]])), *tables]}) == 1


@pytest.mark.parametrize("name", NAMES)
def test_processes_fleet_and_synchronous_are_one_run(name: str) -> None:
    problem = problem_of(costs_of(name))
    once = quietly(run_synchronous, problem, steps=150, seed=1, lag=0)
    runs = [
        quietly(Simulation(problem, agents=agents, seed=1).run, 150.0) for agents in (AgentProcess, Fleet)
    ]
    assert once.account.responses.sum() > 20
    assert once.digest == runs[0].digest
    assert_same_run(*runs)


#: Costs that couple the resources, which have no part in the tests of terms.
COUPLED: dict[str, Any] = {
    "exponents": [2, 3],
    "coefficients": PAIR,
    "quadratic": [[[2.0, 0.5], [0.5, 1.0]]] * N,
    "weights": FIRST,
    "sum_exponents": [2, 4],
    "sum_coefficients": [[0.5, 0.01]] * N,
}


@pytest.mark.parametrize("name", [*KINDS, "coupled"])
def test_the_same_in_a_file(name: str) -> None:
    given = COUPLED if name == "coupled" else PARAMETERS[name]
    made = CoupledCosts.from_coefficients(**COUPLED) if name == "coupled" else costs_of(name)
    problem = problem_of(made)
    resources = [
        {
            "name": one.name,
            "capacity": one.capacity,
            "increase": one.increase,
            "decrease": one.decrease,
            "normalization": one.normalization,
        }
        for one in problem.resources
    ]
    scenario = Scenario(until=40.0, seed=1, costs={"kind": name, **given}, resources=resources)
    assert Scenario.model_validate(scenario.spoken()) == scenario
    result = quietly(scenario.run)
    assert result.digest == quietly(Simulation(problem, seed=1).run, 40.0).digest


# -- optima ----------------------------------------------------------------------------------------------

A, B = FIRST[:, 0], SECOND[:, 0]
#: What agents hold where their derivatives are mu, solved on paper; with one power only.
AT: dict[str, tuple[Callable[[], Costs], Callable[[float], FloatArray], float, float]] = {
    "exponential": (
        lambda: ExponentialCosts(A[:, None], B[:, None]),
        lambda mu: np.log(mu / (A * B)) / B,
        1e-3,
        1e6,
    ),
    "power": (
        lambda: PowerCosts([2.6], A[:, None, None]),
        lambda mu: (mu / (2.6 * A)) ** (1 / 1.6),
        1e-9,
        1e6,
    ),
    "utility": (
        lambda: UtilityCosts(A[:, None], 0.5, 1.5, price=7.0),
        lambda mu: (A / (7.0 - mu)) ** (1 / 1.5) - 0.5,
        -1e3,
        7.0 - 1e-9,
    ),
    "tracking": (
        lambda: TrackingCosts(A[:, None], B[:, None], price=4.0),
        lambda mu: A + (mu - 4.0) / B,
        -1e3,
        1e3,
    ),
}


@pytest.mark.parametrize("name", AT)
@pytest.mark.parametrize("capacity", [0.7, 3.0, 20.0])
def test_the_optimum_is_that_of_the_inverse_derivatives(name: str, capacity: float) -> None:
    make, at, low, high = AT[name]
    resource = Resource("r", capacity, increase=0.01, decrease=0.5, normalization=0.01)
    best = solve_optimum(Problem([resource], make()))
    multiplier = brentq(
        lambda mu: np.maximum(at(mu), 0.0).sum() - capacity, low, high, xtol=1e-14, rtol=1e-14
    )
    np.testing.assert_allclose(
        best.allocation[:, 0], np.maximum(at(multiplier), 0.0), rtol=1e-6, atol=1e-8 * capacity
    )
    assert best.kkt_residual < 1e-8


def test_the_price_does_not_move_the_optimum() -> None:
    resource = Resource("r", 3.0, increase=0.01, decrease=0.5, normalization=0.01)
    for make in (
        lambda price: UtilityCosts(A[:, None], 0.5, price=price),
        lambda price: TrackingCosts(A[:, None], B[:, None], price=price),
    ):
        low, high = (solve_optimum(Problem([resource], make(price))).allocation for price in (None, 30.0))
        np.testing.assert_allclose(low, high, rtol=1e-6)


@pytest.mark.parametrize("name", KINDS)
def test_gamma_is_found_at_a_corner(name: str) -> None:
    costs, low, high = costs_of(name), np.array([0.2, 0.1]), np.array([3.0, 2.0])
    factors = normalization_factors(costs, high, lower=low)
    searched = [1.0 / _search(costs, j, low, high).max() for j in range(M)]
    np.testing.assert_allclose(factors, searched, rtol=1e-9)


def test_utilities_from_functions_are_those_of_the_family() -> None:
    def utility(i: int, x: FloatArray) -> float:
        return float((FIRST[i] * np.log(1.0 + x / 0.5)).sum())

    @numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
    def slopes(i: int, x: FloatArray) -> tuple[float, float]:
        return FIRST[i, 0] / (x[0] + 0.5), FIRST[i, 1] / (x[1] + 0.5)

    own = UtilityCosts.from_functions(N, M, utility, slopes, price=5.0, separable=True)
    family, x = UtilityCosts(FIRST, 0.5, price=5.0), RNG.uniform(0.0, 3.0, (N, M))
    for name, tolerance in (("value", 1e-12), ("gradient", 1e-12), ("hessian", 1e-6)):
        np.testing.assert_allclose(
            getattr(own, name)(x), getattr(family, name)(x), rtol=tolerance, atol=tolerance
        )
    problem = problem_of(own)
    runs = [Simulation(problem, agents=agents, seed=1).run(60.0) for agents in (AgentProcess, Fleet)]
    assert_same_run(*runs)


# -- refusals --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ExponentialCosts([[0.0]]), "scales[0, 0] = 0.0: must be a finite number greater than 0"),
        (lambda: ExponentialCosts([1.0]), "shape of scales = (1,): must be (n_agents, n_resources)"),
        (lambda: ExponentialCosts([[1.0]], [[1.0, 2.0]]), "shape of rates = (1, 2): must be (1, 1)"),
        (lambda: PowerCosts([1.0], [[[1.0]]]), "exponents[0] = 1.0: must be a finite number greater than 1"),
        (
            lambda: PowerCosts([2.0], [[[0.0]]]),
            "coefficients[0, 0] = [0.0]: must be greater than 0 in one place",
        ),
        (lambda: UtilityCosts([[1.0]], 0.0), "shifts = 0.0: must be a finite number greater than 0"),
        (lambda: UtilityCosts([[1.0]], 1.0, 0.0), "fairness = 0.0: must be a finite number greater than 0"),
        (
            lambda: UtilityCosts([[2.0]], 1.0, price=1.0),
            "price = [1.0]: must be at least [2.0], so th",
        ),
        (lambda: TrackingCosts([[-1.0]]), "targets[0, 0] = -1.0: must be a finite number at least 0"),
        (lambda: TrackingCosts([[1.0]], price=[1.0, 2.0]), "shape of price = (2,): must be (1,)"),
        (lambda: TermCosts([[[1.0]]], [[[[1.0, 0.0]]]]), "rate in exponentials = 0.0: must be other than 0"),
        (
            lambda: TermCosts([[[1.0]]], None, [[[[1.0, 2.0, -1.0]]]]),
            "shift in powers = -1.0: must be at le",
        ),
        (
            lambda: TermCosts([[[1.0]]], None, [[[[1.0, -1.0, 0.0]]]]),
            "exponent in powers = -1.0: must be gr",
        ),
        (lambda: TermCosts([[[1.0]]], constant=[1.0, 2.0]), "shape of constant = (2,): must be (1, 1)"),
        (
            lambda: UtilityCosts.from_functions(1, 1, 3, abs, 1.0),  # type: ignore[arg-type]  # that is the point
            "utility = 3: must be a function of (agent, allocation)",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        make()


def test_terms_that_prove_nothing_are_refused_where_they_are_more_than_a_number_can_be() -> None:
    with pytest.raises(
        InputError, match=r"^TermCosts\.value\(\) of agent 0 at x = \[1000\.\] = inf: must be finite"
    ):
        Problem([Resource("r", 1000.0, 0.1, 0.5, 0.1)], TermCosts([[[0.0]]], [[[[1.0, 1.0]]]]))


def test_many_agents_share_more_than_an_exponential_of_one_can_be() -> None:
    scales = np.random.default_rng(0).uniform(0.5, 2.0, (2000, 1))
    best = solve_optimum(Problem([Resource("r", 2000.0, 0.02, 0.7, 0.1)], ExponentialCosts(scales)))
    multiplier = np.exp((2000.0 + np.log(scales).sum()) / 2000.0)
    np.testing.assert_allclose(best.allocation, np.log(multiplier / scales), rtol=1e-6)
