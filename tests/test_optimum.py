"""The optimum is held against closed forms, other solvers, and its KKT conditions, recomputed here."""

import math
import tracemalloc
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

from aimd_des.costs import ExponentialCosts, PowerCosts
from aimd_des.problem.costs import (
    Costs,
    CoupledCosts,
    CustomCosts,
    PolynomialCosts,
)
from aimd_des.problem.optimum import Optimum, solve_optimum
from aimd_des.problem.optimum.interior_point import follow_central_path
from aimd_des.problem.optimum.nearby_optima import optimal_allocations
from aimd_des.problem.optimum.newton import NEAR, newton_steps
from aimd_des.problem.optimum.scaled_costs import ScaledCosts
from aimd_des.problem.optimum.starting_point import power_law_start
from aimd_des.problem.problem import Problem, Resource
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import FloatArray


def problem_of(costs: Costs, capacity: npt.ArrayLike) -> Problem:
    """A problem whose AIMD parameters do not matter here."""
    return Problem(
        [
            Resource(f"r{j}", capacity=float(c), increase=0.01, decrease=0.5, normalization=0.01)
            for j, c in enumerate(np.asarray(capacity))
        ],
        costs,
    )


def kkt_residual(
    costs: Costs, capacity: FloatArray, allocation: FloatArray, multipliers: FloatArray
) -> float:
    """The residual of the docstring of `solve_optimum`, agent by agent and with exact sums."""
    worst = 0.0
    gradient = costs.gradient(allocation)
    for j, total in enumerate(capacity):
        worst = max(worst, abs(math.fsum([*allocation[:, j], -total])) / total)
        for x, slope in zip(allocation[:, j], gradient[:, j], strict=True):
            share, reduced = x * len(allocation) / total, slope / multipliers[j] - 1.0
            worst = max(worst, abs(min(share, reduced)), share * max(reduced, 0.0))
    return worst


def check(problem: Problem, optimum: Optimum, capacity: FloatArray | None = None) -> None:
    capacity = problem.capacity if capacity is None else capacity
    residual = kkt_residual(problem.costs, capacity, optimum.allocation, optimum.multipliers)
    assert residual <= 1e-9
    assert optimum.kkt_residual == pytest.approx(residual, abs=1e-13)
    assert optimum.cost == pytest.approx(math.fsum(problem.costs.value(optimum.allocation)), rel=1e-12)


def paper_like(n: int, seed: int) -> PolynomialCosts:
    """The three kinds of cost of eq. (cost_fn): each lacks some terms, one the quadratic one."""
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.integers([10, 25, 22, 1], [21, 36, 33, 6], size=(n, 4)).T.astype(float)
    kind = rng.integers(3, size=n)
    table = np.zeros((n, 3, 8))
    for i, k in enumerate(kind):
        if k == 0:
            table[i, 0, [1, 3]] = a[i], a[i] / 2
            table[i, 1, [3, 5]] = 2 * b[i], b[i] / 2
            table[i, 2, [1, 3, 7]] = c[i], c[i] / 4, d[i] / 8
        elif k == 1:
            table[i, 0, 1] = a[i]
            table[i, 1, [1, 3]] = b[i], b[i] / 2
            table[i, 2, 3] = 1.5 * c[i]
        else:
            table[i, 0, 5] = a[i] / 3
            table[i, 1, [1, 5]] = b[i], d[i] / 6
            table[i, 2, [1, 3]] = c[i], d[i] / 8
    return PolynomialCosts(range(1, 9), table)


def coupled(n: int, m: int, seed: int, linear: float = 0.0, spread: float = 1.0) -> CoupledCosts:
    rng = np.random.default_rng(seed)
    root = spread * rng.uniform(size=(n, m, m))
    own = np.stack(
        [np.full((n, m), linear), rng.uniform(0.1, 2, (n, m)), rng.uniform(0.1, 2, (n, m))], axis=2
    )
    return CoupledCosts(
        PolynomialCosts([1, 2, 4], own * rng.uniform(0.1, 2, (n, m, 1))),
        quadratic=root @ root.transpose(0, 2, 1),
        weights=spread * rng.uniform(size=(n, m)),
        sum_exponents=[2, 4],
        sum_coefficients=rng.uniform(size=(n, 2)),
    )


def with_active_bounds(n: int, m: int, seed: int) -> PolynomialCosts:
    return PolynomialCosts([1, 2, 4], np.random.default_rng(seed).uniform(0.1, 20, (n, m, 3)))


CASES = {
    "paper": (paper_like(60, 1), [32.0, 20.0, 25.0]),
    "paper, one agent": (paper_like(1, 1), [32.0, 20.0, 25.0]),
    "all exponents": (
        PolynomialCosts(range(1, 9), np.random.default_rng(2).uniform(0, 30, (60, 3, 8))),
        [32.0, 20.0, 25.0],
    ),
    "coupled": (coupled(60, 3, 3), [10.0, 20.0, 30.0]),
    "coupled, five resources": (coupled(60, 5, 4), [1.0, 2.0, 30.0, 4.0, 50.0]),
    "active bounds": (with_active_bounds(60, 3, 5), [5.0, 1.0, 100.0]),
    "coupled, active bounds": (coupled(60, 3, 6, linear=20.0), [3.0, 3.0, 3.0]),
    "no curvature at 0": (
        PolynomialCosts([4], np.random.default_rng(7).uniform(1, 5, (60, 2, 1))),
        [1.0, 1e4],
    ),
    "very steep": (
        PolynomialCosts([64], 10.0 ** np.random.default_rng(8).uniform(-6, 6, (60, 1, 1))),
        [60.0],
    ),
    "linear": (PolynomialCosts([1], np.random.default_rng(9).uniform(1, 5, (60, 2, 1))), [1e-3, 1e9]),
    "linear, all alike": (PolynomialCosts([1], np.ones((60, 2, 1))), [1.0, 2.0]),
    "linear but for a weighted sum": (
        CoupledCosts(
            PolynomialCosts([1], np.random.default_rng(10).uniform(1, 5, (60, 3, 1))),
            weights=np.random.default_rng(11).uniform(0.1, 2, (60, 3)),
            sum_coefficients=np.ones((60, 1)),
        ),
        [10.0, 20.0, 30.0],
    ),
    # One resource is solved to the last bit, and its steps are rounding, while the cheaper one is not yet.
    "one resource done before the other": (
        PolynomialCosts([1, 2, 7], [[[1.0, 1.0, 1.0], [1.0, 1.0, 0.0]], [[0.0, 1.0, 1.0], [1.0, 1.0, 1.0]]]),
        [7.0, 0.09175029864336519],
    ),
    # The second agent's bound is active with a multiplier of 0: 2 x_1 = 6 = its derivative at 0.
    "on the edge of an active bound": (PolynomialCosts([1, 2], [[[0.0, 1.0]], [[6.0, 1.0]]]), [3.0]),
    "negative coefficients": (
        PolynomialCosts(
            [1, 2, 3, 4], np.tile([0.1, 1.5, -2.0, 1.0], (60, 1, 1)) * np.arange(1, 61)[:, None, None]
        ),
        [40.0],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_kkt_conditions_hold(name: str) -> None:
    problem = problem_of(*CASES[name])
    optimum = solve_optimum(problem)
    check(problem, optimum)
    assert (optimum.allocation > 0).all()
    assert optimum.iterations <= 40


def test_the_residual_of_a_wrong_allocation_is_large() -> None:
    problem = problem_of(*CASES["active bounds"])
    optimum = solve_optimum(problem)
    for factor in (1 + 1e-6, 1 - 1e-6):
        wrong = optimum.allocation.copy()
        wrong[np.argmax(wrong[:, 0]), 0] *= factor
        assert kkt_residual(problem.costs, problem.capacity, wrong, optimum.multipliers) > 1e-7
        wrong_multipliers = optimum.multipliers * factor
        assert kkt_residual(problem.costs, problem.capacity, optimum.allocation, wrong_multipliers) > 1e-7


@pytest.mark.parametrize("n", [1, 60, 1000])
def test_quadratic_costs_share_in_inverse_proportion(n: int) -> None:
    a = np.random.default_rng(12).uniform(1, 10, (n, 2))
    optimum = solve_optimum(problem_of(PolynomialCosts([2], a[:, :, None]), [32.0, 5.0]))
    scale = np.array([32.0, 5.0]) / (1 / a).sum(axis=0)
    np.testing.assert_allclose(optimum.allocation, scale / a, rtol=1e-9)
    np.testing.assert_allclose(optimum.multipliers, 2 * scale, rtol=1e-9)


@pytest.mark.parametrize("n", [1, 60, 1000])
def test_quartic_costs_share_by_the_cube_root(n: int) -> None:
    a = 10.0 ** np.random.default_rng(13).uniform(-6, 6, (n, 1))
    optimum = solve_optimum(problem_of(PolynomialCosts([4], a[:, :, None]), [7.0]))
    weights = a ** (-1 / 3)
    np.testing.assert_allclose(optimum.allocation, 7.0 * weights / weights.sum(), rtol=1e-9)


def test_coupled_quadratic_costs_solve_a_linear_system() -> None:
    rng = np.random.default_rng(14)
    n, m = 6, 3
    quadratic = np.eye(m) * rng.uniform(2, 4, (n, 1, m)) + 0.3
    costs = CoupledCosts(PolynomialCosts([1], np.full((n, m, 1), 1e-12)), quadratic=quadratic)
    inverse = np.linalg.inv(quadratic)
    multipliers = np.linalg.solve(inverse.sum(axis=0), [4.0, 5.0, 6.0])
    optimum = solve_optimum(problem_of(costs, [4.0, 5.0, 6.0]))
    np.testing.assert_allclose(optimum.allocation, inverse @ multipliers, rtol=1e-9)


def test_linear_costs_go_to_the_cheapest() -> None:
    slopes = np.array([[3.0, 1e-6], [1.0, 1e6], [2.0, 1.0]])
    optimum = solve_optimum(problem_of(PolynomialCosts([1], slopes[:, :, None]), [5.0, 1e9]))
    np.testing.assert_allclose(optimum.allocation, [[0, 1e9], [5, 0], [0, 0]], atol=1e-9)
    np.testing.assert_allclose(optimum.multipliers, [1.0, 1e-6], rtol=1e-9)
    assert optimum.cost == pytest.approx(5.0 + 1e3, rel=1e-9)


def one_dimensional_dual(costs: PolynomialCosts, capacity: list[float]) -> FloatArray:
    """Separable costs, one resource at a time: find the price at which the agents' answers add up."""
    answers = np.zeros(costs.coefficients.shape[:2])
    near: Any = {"xtol": 1e-300, "rtol": 1e-14, "maxiter": 1000}  # small capacities have small prices
    for j, total in enumerate(capacity):
        slopes = [np.polynomial.Polynomial(costs.slopes[:, i, j]) for i in range(costs.n_agents)]

        def answer(price: float, slope: Any, total: float = total) -> float:
            if slope(0.0) >= price:
                return 0.0
            return float(brentq(lambda x: slope(x) - price, 0.0, 2 * total, **near))

        def excess(price: float, slopes: list[Any] = slopes, total: float = total) -> float:
            return sum(answer(price, slope) for slope in slopes) - total

        highest = min(slope(total) for slope in slopes)
        price = brentq(excess, 0.0, highest, **near)
        answers[:, j] = [answer(price, slope) for slope in slopes]
    return answers


# The last of twenty agents costs so much that it just holds nothing: plain Newton steps are tried in vain.
ONE_LEFT_OUT = PolynomialCosts([1, 2], [[[0.0, 1.0 + 0.1 * i]] for i in range(19)] + [[[1.42, 30.0]]])
ON_THEIR_OWN = {
    "paper": CASES["paper"],
    "active bounds": CASES["active bounds"],
    "one agent": (paper_like(1, 21), [32.0, 20.0, 25.0]),
    "tiny capacities": (paper_like(20, 22), [1e-6, 1e-4, 1e-5]),
    "huge capacities": (paper_like(20, 23), [1e5, 1e6, 1e4]),
    "equal costs": (PolynomialCosts([2, 4], np.ones((20, 2, 2))), [3.0, 500.0]),
    "one left out": (ONE_LEFT_OUT, [7.5]),
}


@pytest.mark.parametrize("name", ON_THEIR_OWN)
def test_agrees_with_a_one_dimensional_dual(name: str) -> None:
    costs, capacity = ON_THEIR_OWN[name]
    assert isinstance(costs, PolynomialCosts)
    expected = one_dimensional_dual(costs, capacity)
    problem = problem_of(costs, capacity)
    optimum = solve_optimum(problem)
    check(problem, optimum)
    scale = problem.capacity / problem.n_agents
    np.testing.assert_allclose(optimum.allocation / scale, expected / scale, rtol=1e-8, atol=1e-9)
    assert (expected == 0).any() == (name in ("active bounds", "one left out"))


def scaled_of(costs: Costs, capacity: npt.ArrayLike) -> ScaledCosts:
    return ScaledCosts(costs, np.asarray(capacity) / costs.n_agents)


@pytest.mark.parametrize(
    ("costs", "capacity"),
    [
        pytest.param(paper_like(60, 24), [32.0, 20.0, 25.0], id="separable"),
        pytest.param(coupled(60, 3, 25, spread=0.05), [10.0, 20.0, 30.0], id="coupled"),
        pytest.param(ExponentialCosts(np.linspace(9.0, 11.0, 60)[:, None]), [600.0], id="exponential"),
        pytest.param(
            PowerCosts([1.5, 2.5], np.linspace(1.0, 2.0, 120).reshape(60, 1, 2)), [30.0], id="powers"
        ),
    ],
)
def test_plain_steps_from_nearby_end_where_the_central_path_does(costs: Costs, capacity: list[float]) -> None:
    scaled = scaled_of(costs, capacity)
    start = power_law_start(scaled)
    assert 1e-10 < start.residual < NEAR
    plain, taken = newton_steps(scaled, start, 1e-10)
    assert plain is not None
    central, _ = follow_central_path(scaled, start, 1e-10, 50)
    assert max(plain.residual, central.residual) <= 1e-10
    np.testing.assert_allclose(plain.shares, central.shares, atol=1e-9)
    np.testing.assert_allclose(plain.multipliers, central.multipliers, rtol=1e-9)
    optimum = solve_optimum(problem_of(costs, capacity))
    np.testing.assert_array_equal(optimum.allocation, plain.shares * scaled.equal_share)
    assert optimum.iterations == taken


def test_plain_steps_that_lead_out_of_the_bounds_are_given_up_and_counted() -> None:
    costs, capacity = ON_THEIR_OWN["one left out"]
    scaled = scaled_of(costs, capacity)
    start = power_law_start(scaled)
    assert start.residual < NEAR
    assert newton_steps(scaled, start, 1e-10) == (None, 1)
    central, taken = follow_central_path(scaled, start, 1e-10, 50)
    optimum = solve_optimum(problem_of(costs, capacity))
    np.testing.assert_array_equal(optimum.allocation, central.shares * scaled.equal_share)
    assert optimum.iterations == 1 + taken


def clarabel(costs: CoupledCosts | PolynomialCosts, capacity: list[float]) -> tuple[FloatArray, float]:
    """The same problem as a cone program."""
    cvxpy = pytest.importorskip("cvxpy")
    separable = costs.separable_part if isinstance(costs, CoupledCosts) else costs
    n, m = separable.n_agents, separable.n_resources
    x = cvxpy.Variable((n, m), nonneg=True)
    terms = [
        cvxpy.sum(cvxpy.multiply(separable.coefficients[:, :, k], x if p == 1 else cvxpy.power(x, p)))
        for k, p in enumerate(separable.exponents)
    ]
    if isinstance(costs, CoupledCosts):
        terms += [
            cvxpy.sum_squares(np.linalg.cholesky(q).T @ x[i]) / 2 for i, q in enumerate(costs.quadratic)
        ]
        weighted = cvxpy.sum(cvxpy.multiply(costs.weights, x), axis=1)
        terms += [
            costs.sum_coefficients[:, k] @ cvxpy.power(weighted, p) for k, p in enumerate(costs.sum_exponents)
        ]
    program = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum(terms)), [cvxpy.sum(x, axis=0) == capacity])
    tight = {"tol_gap_abs": 1e-13, "tol_gap_rel": 1e-13, "tol_feas": 1e-13, "max_iter": 500}
    program.solve(solver=cvxpy.CLARABEL, reduced_tol_gap_abs=1e-9, reduced_tol_gap_rel=1e-9, **tight)
    return x.value, program.value


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate:UserWarning")
@pytest.mark.parametrize(
    ("costs", "capacity"),
    [
        pytest.param(paper_like(20, 15), [11.0, 7.0, 8.0], id="separable"),
        pytest.param(coupled(20, 3, 16), [10.0, 20.0, 30.0], id="coupled"),
        pytest.param(with_active_bounds(20, 3, 17), [5.0, 1.0, 100.0], id="active bounds"),
        pytest.param(coupled(20, 3, 18, linear=20.0), [3.0, 3.0, 3.0], id="coupled, active bounds"),
    ],
)
def test_agrees_with_clarabel(costs: CoupledCosts | PolynomialCosts, capacity: list[float]) -> None:
    allocation, cost = clarabel(costs, capacity)
    optimum = solve_optimum(problem_of(costs, capacity))
    assert optimum.cost == pytest.approx(cost, rel=1e-8)
    # Clarabel knows the cost to 1e-12, so the allocation to the root of that.
    np.testing.assert_allclose(optimum.allocation, allocation, atol=1e-6 * max(capacity))


def custom(n: int, *, with_hessian: bool) -> CustomCosts:
    """Costs that no polynomial is: exp(k (x + y)) + x**1.5 + 5 y, with a Hessian that is infinite at 0."""

    def value(agent: int, x: FloatArray) -> float:
        return float(np.exp(0.1 * (agent + 1) * (x[0] + x[1])) + x[0] ** 1.5 + 5 * x[1] ** 2)

    def gradient(agent: int, x: FloatArray) -> list[float]:
        k = 0.1 * (agent + 1)
        common = k * np.exp(k * (x[0] + x[1]))
        return [common + 1.5 * x[0] ** 0.5, common + 10 * x[1]]

    def hessian(agent: int, x: FloatArray) -> list[list[float]]:
        k = 0.1 * (agent + 1)
        common = k * k * np.exp(k * (x[0] + x[1]))
        return [[common + 0.75 / np.sqrt(x[0]), common], [common, common + 10]]

    return CustomCosts(n, 2, value=value, gradient=gradient, hessian=hessian if with_hessian else None)


@pytest.mark.parametrize("with_hessian", [True, False])
def test_custom_costs_agree_with_slsqp(*, with_hessian: bool) -> None:
    n, capacity = 5, np.array([2.0, 4.0])
    costs = custom(n, with_hessian=with_hessian)
    problem = problem_of(costs, capacity)
    optimum = solve_optimum(problem)
    check(problem, optimum)
    other = minimize(
        lambda x: costs.value(x.reshape(n, 2)).sum(),
        np.tile(capacity / n, n),
        jac=lambda x: costs.gradient(x.reshape(n, 2)).ravel(),
        bounds=[(0.0, None)] * (2 * n),
        constraints={"type": "eq", "fun": lambda x: x.reshape(n, 2).sum(axis=0) - capacity},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    assert optimum.cost == pytest.approx(other.fun, rel=1e-10)
    np.testing.assert_allclose(optimum.allocation, other.x.reshape(n, 2), atol=1e-6)


def test_other_capacities_make_another_problem() -> None:
    costs, capacity = CASES["paper"]
    used = np.array(capacity) * [0.9, 0.95, 1.05]
    problem = problem_of(costs, capacity)
    optimum = solve_optimum(problem, capacity=used)
    check(problem, optimum, used)
    np.testing.assert_array_equal(optimum.allocation, solve_optimum(problem_of(costs, used)).allocation)


@pytest.mark.parametrize("seed", [5, 6, 9, 81, 97])
def test_a_corrector_that_misleads_is_held_back(seed: int) -> None:
    """One bend for three resources of very different price: fully corrected steps go in circles."""
    rng = np.random.default_rng(seed)
    linear = PolynomialCosts([1], 10.0 ** rng.uniform(-1, 1, (60, 3, 1)))
    weights = rng.normal(size=(60, 3, 1)) ** 2
    problem = problem_of(
        CoupledCosts(linear, quadratic=weights @ weights.transpose(0, 2, 1)), [1e4, 1e-2, 1e5]
    )
    check(problem, solve_optimum(problem))


@pytest.mark.parametrize("seed", [0, 2, 5])
def test_resources_that_replace_each_other(seed: int) -> None:
    """Only one weighted sum of the resources matters, the same for all: each Hessian is singular alike."""
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.1, 2, 3)
    costs = CoupledCosts(
        PolynomialCosts([1], 1e-6 * 10.0 ** rng.uniform(-1, 1, (10, 3, 1))),
        weights=np.tile(weights, (10, 1)),
        sum_exponents=[2, 4],
        sum_coefficients=10.0 ** rng.uniform(-1, 1, (10, 2)),
    )
    problem = problem_of(costs, 10.0 ** rng.uniform(-3, 1, 3))
    check(problem, solve_optimum(problem))


@dataclass(frozen=True)
class Rescaled:
    """The same costs in other money and other units."""

    costs: Costs
    money: float
    unit: FloatArray
    proven = True

    @property
    def n_agents(self) -> int:
        return self.costs.n_agents

    @property
    def n_resources(self) -> int:
        return self.costs.n_resources

    @property
    def separable(self) -> bool:
        return self.costs.separable

    def value(self, allocation: FloatArray) -> FloatArray:
        return self.money * self.costs.value(allocation / self.unit)

    def gradient(self, allocation: FloatArray) -> FloatArray:
        return self.money * self.costs.gradient(allocation / self.unit) / self.unit

    def hessian(self, allocation: FloatArray) -> FloatArray:
        return self.money * self.costs.hessian(allocation / self.unit) / np.outer(self.unit, self.unit)


@pytest.mark.parametrize("name", ["paper", "coupled", "active bounds"])
def test_units_do_not_matter(name: str) -> None:
    costs, capacity = CASES[name]
    money, unit = 1e-9, np.array([1e6, 1e-3, 1e3])
    base = solve_optimum(problem_of(costs, capacity))
    moved = solve_optimum(problem_of(Rescaled(costs, money, unit), capacity * unit))
    np.testing.assert_allclose(moved.allocation / unit, base.allocation, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(moved.multipliers * unit / money, base.multipliers, rtol=1e-9)


@st.composite
def separable_problems(draw: st.DrawFn) -> Problem:
    """Coefficients from 1e-6 to 1e6 and capacities from 1e-3 to 1e9, in one problem."""
    n, m = draw(st.sampled_from([1, 2, 7, 60])), draw(st.integers(1, 3))
    exponents = draw(st.lists(st.integers(1, 8), min_size=1, max_size=4, unique=True))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    spread = draw(st.sampled_from([0.0, 1.0, 6.0]))
    coefficients = 10.0 ** rng.uniform(-spread, spread, (n, m, len(exponents)))
    coefficients[:, :, 1:] *= rng.random((n, m, len(exponents) - 1)) < 0.7
    return problem_of(PolynomialCosts(exponents, coefficients), 10.0 ** rng.uniform(-3, 9, m))


@st.composite
def coupled_problems(draw: st.DrawFn) -> Problem:
    n, m = draw(st.sampled_from([1, 2, 7, 60])), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    spread = draw(st.sampled_from([0.0, 1.0, 3.0]))
    rank = draw(st.integers(1, m))
    root = rng.uniform(size=(n, m, rank))
    own = PolynomialCosts([1, 3], 10.0 ** rng.uniform(-spread, spread, (n, m, 2)))
    return problem_of(
        CoupledCosts(
            own,
            quadratic=root @ root.transpose(0, 2, 1),
            weights=rng.uniform(size=(n, m)),
            sum_exponents=[1, 4],
            sum_coefficients=10.0 ** rng.uniform(-spread, spread, (n, 2)),
        ),
        10.0 ** rng.uniform(-2, 3, m),
    )


@settings(derandomize=True, deadline=None, max_examples=75)
@given(problem=separable_problems() | coupled_problems(), seed=st.integers(0, 2**32))
def test_no_feasible_step_lowers_the_cost(problem: Problem, seed: int) -> None:
    optimum = solve_optimum(problem)
    check(problem, optimum)
    rng = np.random.default_rng(seed)
    for step in (1.0, 1e-1, 1e-4):
        other = rng.exponential(size=optimum.allocation.shape) ** 2
        other *= problem.capacity / other.sum(axis=0)
        mixed = optimum.allocation + step * (other - optimum.allocation)
        assert problem.costs.value(mixed).sum() >= optimum.cost * (1 - 1e-9)


def test_what_is_asked_for_wrongly_is_refused() -> None:
    problem = problem_of(*CASES["paper"])
    with pytest.raises(InputError, match=r"shape of capacity = \(2,\)"):
        solve_optimum(problem, capacity=[1.0, 2.0])
    with pytest.raises(InputError, match=r"capacity\[1\] = 0.0: must be a finite number greater than 0"):
        solve_optimum(problem, capacity=[1.0, 0.0, 2.0])
    with pytest.raises(InputError, match=r"tolerance = 0\.0"):
        solve_optimum(problem, tolerance=0.0)
    with pytest.raises(InputError, match="max_iterations = 0"):
        solve_optimum(problem, max_iterations=0)


def test_what_is_not_found_is_said() -> None:
    problem = problem_of(*CASES["active bounds"])
    for other, most in ((problem, 2), (problem_of(*CASES["paper"]), 1)):
        with pytest.raises(SimulationError, match=rf"[\d.e-]+ after {most} iterations, wanted at most 1e-10"):
            solve_optimum(other, max_iterations=most)
    overflow = problem_of(PolynomialCosts([64], np.ones((2, 1, 1))), [1e9])
    with pytest.raises(SimulationError, match="KKT residual inf"):
        solve_optimum(overflow)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["separable", "coupled"])
def test_a_hundred_thousand_agents_fit_into_memory(kind: str) -> None:
    n = 100_000
    costs = with_active_bounds(n, 3, 19) if kind == "separable" else coupled(n, 3, 20, linear=1.0)
    problem = problem_of(costs, np.array([5.0, 1.0, 100.0]) * n / 60)
    tracemalloc.start()
    optimum = solve_optimum(problem)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 * 2**30
    check(problem, optimum)


def test_optima_for_several_capacities_are_those_of_each() -> None:
    own = PolynomialCosts([2], [[[1.0], [2.0]], [[2.0], [1.0]], [[1.0], [1.0]]])
    coupled = CoupledCosts(own, weights=np.ones((3, 2)), sum_exponents=[3], sum_coefficients=np.ones((3, 1)))
    # The third agent's price is so high that it holds something at the larger capacities only.
    priced = PolynomialCosts([1, 2], [[[1.0, 1.0]], [[1.0, 2.0]], [[9.0, 1.0]]])
    for costs, first in ((coupled, [3.0, 5.0]), (priced, [8.0])):
        problem = problem_of(costs, first)
        capacities = np.outer([1.0, 1.01, 0.7, 2.0, 0.4], first)
        found = optimal_allocations(problem, capacities)
        for allocation, capacity in zip(found, capacities, strict=True):
            wanted = solve_optimum(problem, capacity=capacity).allocation
            np.testing.assert_allclose(allocation, wanted, rtol=1e-7, atol=1e-7)
