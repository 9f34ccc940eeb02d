"""Costs against what is written on paper: values term by term, derivatives by differences."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import CoupledCosts, CustomCosts, InputError, PolynomialCosts, Problem
from aimd_des.problem.costs import Costs, check_costs, sample_box
from aimd_des.problem.costs.checks import check_on_box
from aimd_des.utils.validation import FloatArray
from tests.conftest import FAMILIES, as_custom, random_costs, reference_derivative, resource

CASES = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 3), st.sampled_from(FAMILIES))


def costs_and_point(seed: int, n: int, m: int, family: str) -> tuple[Costs, FloatArray]:
    rng = np.random.default_rng([seed, n, m])
    share = 10.0 ** rng.uniform(-2, 2, m)
    return random_costs(rng, family, share, n), share * rng.uniform(0.1, 3.0, (n, m))


def derivative(function: Callable[[FloatArray], FloatArray], x: FloatArray, j: int) -> FloatArray:
    """The derivative by coordinate j with five points, whose error is of the fourth order in the step."""
    step = 1e-3 * x[:, j]

    def at(steps: int) -> FloatArray:
        moved = x.copy()
        moved[:, j] += steps * step
        return function(moved)

    width = step.reshape(-1, *[1] * (at(0).ndim - 1))
    return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * width)


def rounding(values: FloatArray, x: FloatArray, j: int) -> FloatArray:
    """What rounding of the values leaves in such a derivative: a few ulps over a step of 1e-3 x."""
    return 1e-11 * np.abs(values) / x[:, j].reshape(-1, *[1] * (values.ndim - 1))


@given(CASES)
def test_gradient_is_the_derivative_of_the_value(case: tuple[int, int, int, str]) -> None:
    costs, x = costs_and_point(*case)
    gradient = costs.gradient(x)
    assert gradient.shape == x.shape
    for j in range(costs.n_resources):
        error = np.abs(derivative(costs.value, x, j) - gradient[:, j])
        assert (error <= 1e-8 * gradient[:, j] + rounding(costs.value(x), x, j)).all()


@given(CASES)
def test_hessian_is_the_derivative_of_the_gradient(case: tuple[int, int, int, str]) -> None:
    costs, x = costs_and_point(*case)
    gradient, hessian = costs.gradient(x), costs.hessian(x)
    assert hessian.shape == (*x.shape, costs.n_resources)
    for j in range(costs.n_resources):
        error = np.abs(derivative(costs.gradient, x, j) - hessian[:, :, j])
        assert (error <= 1e-8 * np.abs(hessian[:, :, j]) + rounding(gradient, x, j)).all()


@given(CASES)
def test_gradient_is_what_is_written_on_paper(case: tuple[int, int, int, str]) -> None:
    costs, x = costs_and_point(*case)
    paper = [
        [reference_derivative(costs, agent, row.tolist(), j) for j in range(costs.n_resources)]
        for agent, row in enumerate(x)
    ]
    np.testing.assert_allclose(costs.gradient(x), paper, rtol=1e-12)


@given(
    st.lists(st.integers(1, 8), min_size=1, max_size=4, unique=True),
    st.integers(0, 2**32 - 1),
    st.integers(1, 4),
    st.integers(1, 3),
)
def test_polynomials_are_the_sum_of_their_terms(exponents: list[int], seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    c, x = rng.normal(size=(n, m, len(exponents))), rng.uniform(0.0, 2.0, (n, m))
    costs = PolynomialCosts(exponents, c)
    for i in range(n):
        terms = [c[i, j, p] * x[i, j] ** power for j in range(m) for p, power in enumerate(exponents)]
        assert costs.value(x)[i] == pytest.approx(math.fsum(terms), abs=1e-13 * sum(map(abs, terms)))
    assert (costs.n_agents, costs.n_resources, costs.exponents) == (n, m, tuple(exponents))


def test_coupled_costs_are_the_sum_of_their_three_parts() -> None:
    own = PolynomialCosts([2, 4], [[[1.0, 2.0], [3.0, 0.5]], [[0.0, 1.0], [1.0, 0.0]]])
    quadratic = [[[2.0, -0.5], [-0.5, 3.0]], [[0.0, 0.0], [0.0, 1.0]]]
    weights, factors = [[1.0, 2.0], [0.5, 0.0]], [[3.0, 0.25], [1.0, 2.0]]
    costs = CoupledCosts(own, quadratic, weights, (1, 3), factors)
    for a, b in [(0.5, 2.0), (1.5, 0.0), (0.0, 0.0), (3.0, 1.0)]:
        first = (a**2 + 2 * a**4) + (3 * b**2 + 0.5 * b**4)
        first += 0.5 * (2 * a * a - 2 * 0.5 * a * b + 3 * b * b)
        first += 3 * (a + 2 * b) + 0.25 * (a + 2 * b) ** 3
        second = (a**4 + b**2) + 0.5 * b * b + (0.5 * a) + 2 * (0.5 * a) ** 3
        np.testing.assert_allclose(costs.value(np.array([[a, b], [a, b]])), [first, second], rtol=1e-14)


def test_coupled_costs_without_coupling_are_their_separable_part() -> None:
    own = PolynomialCosts([2, 3], np.random.default_rng(1).uniform(size=(4, 2, 2)))
    x = np.random.default_rng(2).uniform(size=(4, 2))
    bare = CoupledCosts(own)
    for name in ("value", "gradient", "hessian"):
        assert np.array_equal(getattr(bare, name)(x), getattr(own, name)(x))


def test_only_costs_without_cross_terms_are_separable() -> None:
    own = PolynomialCosts([2], [[[1.0], [1.0]]])
    coupled = CoupledCosts(own, weights=[[1.0, 1.0]], sum_coefficients=[[1.0]])
    assert own.separable
    assert not coupled.separable
    assert not CustomCosts(1, 1, lambda i, x: x[0], lambda i, x: [1.0]).separable
    assert as_custom(own).separable
    x = np.array([[1.0, 2.0]])
    assert own.hessian(x)[0, 0, 1] == 0.0
    assert coupled.hessian(x)[0, 0, 1] == 2.0


def test_what_parameters_prove_need_not_be_sampled() -> None:
    own = PolynomialCosts([2, 3], [[[1.0, 0.0]]])
    assert own.proven
    assert not PolynomialCosts([2, 3], [[[1.0, -0.1]]]).proven
    assert not PolynomialCosts([2, 3], [[[0.0, 0.0]]]).proven
    pair = PolynomialCosts([2], [[[1.0], [1.0]]])
    assert CoupledCosts(pair, quadratic=[[[1.0, 0.5], [0.5, 1.0]]]).proven
    assert not CoupledCosts(pair, quadratic=[[[1.0, -0.5], [-0.5, 1.0]]]).proven
    assert not as_custom(own).proven


@pytest.mark.parametrize(
    ("exponents", "coefficients", "message"),
    [
        ([2.0], [[[1.0]]], "exponents[0] = 2.0: must be an integer of at least 1 and at most 64"),
        ([2, True], [[[1.0, 1.0]]], "exponents[1] = True: must be an integer"),
        ([0], [[[1.0]]], "exponents[0] = 0: must be an integer of at least 1"),
        ([65], [[[1.0]]], "exponents[0] = 65: must be an integer of at least 1 and at most 64"),
        ([2, 2], [[[1.0, 1.0]]], "exponents = [2, 2]: must be one or more different integers"),
        ([], [[[]]], "exponents = []: must be one or more different integers"),
        ([2], [[1.0]], "shape of coefficients = (1, 1): must be (n_agents, n_resources, 1); give one"),
        ([2], [[[1.0, 2.0]]], "shape of coefficients = (1, 1, 2): must be (n_agents, n_resources, 1)"),
        ([2], np.ones((0, 1, 1)), "shape of coefficients = (0, 1, 1): must be at least 1 in each direction"),
        ([2], [[[1.0], [math.nan]]], "coefficients[0, 1, 0] = nan: must be a finite number; give one"),
        ([2], [[[math.inf]]], "coefficients[0, 0, 0] = inf: must be a finite number"),
        ([2], [[["a"]]], "coefficients = [[['a']]]: must be an array of numbers"),
    ],
)
def test_polynomials_refuse_by_name(exponents: Any, coefficients: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        PolynomialCosts(exponents, coefficients)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"quadratic": [[[1.0, 0.2], [0.0, 1.0]]] * 2},
            "quadratic[0] = [[1.0, 0.2], [0.0, 1.0]]: must be symmetric",
        ),
        (
            {"quadratic": [np.eye(2), [[1.0, 2.0], [2.0, 1.0]]]},
            "quadratic[1] = [[1.0, 2.0], [2.0, 1.0]]: must be positive semidefinite; its smallest eigenv",
        ),
        ({"quadratic": np.eye(2)}, "shape of quadratic = (2, 2): must be (2, 2, 2)"),
        ({"quadratic": np.full((2, 2, 2), math.nan)}, "quadratic[0, 0, 0] = nan: must be a finite number"),
        ({"weights": [[1.0, 1.0], [1.0, -1.0]]}, "weights[1, 1] = -1.0: must be a finite number at least 0"),
        ({"weights": [1.0, 1.0]}, "shape of weights = (2,): must be (2, 2)"),
        (
            {"sum_coefficients": [[-1.0], [1.0]]},
            "sum_coefficients[0, 0] = -1.0: must be a finite number at least",
        ),
        ({"sum_coefficients": [[1.0, 1.0]] * 2}, "shape of sum_coefficients = (2, 2): must be (2, 1)"),
        ({"sum_exponents": (0,)}, "sum_exponents[0] = 0: must be an integer of at least 1 and at most 64"),
        ({"sum_exponents": (1.5,)}, "sum_exponents[0] = 1.5: must be an integer"),
        ({"sum_exponents": ()}, "sum_exponents = (): must be one or more different integers"),
    ],
)
def test_coupled_costs_refuse_by_name(options: dict[str, Any], message: str) -> None:
    own = PolynomialCosts([2], [[[1.0], [1.0]]] * 2)
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        CoupledCosts(own, **options)


def test_a_matrix_that_is_singular_up_to_rounding_is_semidefinite() -> None:
    own = PolynomialCosts([2], [[[1.0], [1.0], [1.0]]])
    vector = np.array([0.1, 0.7, 1e-3])
    matrix = np.outer(vector, vector)
    assert CoupledCosts(own, quadratic=[matrix]).quadratic[0].tolist() == matrix.tolist()


def problem_with(costs: Costs, capacity: float = 4.0) -> Problem:
    return Problem([resource(f"r{j}", capacity=capacity) for j in range(costs.n_resources)], costs)


def point_in(message: str) -> FloatArray:
    """The point that an error names."""
    found = re.search(r"x = \[([^\]]*)\]", message)
    assert found, message
    return np.array([float(number) for number in found[1].split(",")])


def refusal(costs: Costs, capacity: float = 4.0) -> str:
    with pytest.raises(InputError) as caught:
        problem_with(costs, capacity)
    return str(caught.value)


def test_a_concave_cost_is_refused_at_a_point_where_it_is_concave() -> None:
    # Agent 2 is increasing on the whole box and concave where 6 x < 2 * 5: near zero only.
    good = [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    bad = [[0.0, 1.0, 0.0], [9.0, -5.0, 1.0]]
    message = refusal(PolynomialCosts([1, 2, 3], [good, good, bad]))
    assert message.startswith("smallest eigenvalue of the Hessian of the cost of agent 2 at x = ")
    assert message.endswith("must be at least 0; costs must be convex")
    assert 6 * point_in(message)[1] - 10 < 0


def test_a_cost_that_is_concave_across_resources_only_is_refused() -> None:
    costs = CustomCosts(
        2,
        2,
        value=lambda i, x: 9 * (x[0] + x[1]) + x[0] ** 2 + x[1] ** 2 - 3 * i * x[0] * x[1] / 1.2,
        gradient=lambda i, x: [9 + 2 * x[0] - 2.5 * i * x[1], 9 + 2 * x[1] - 2.5 * i * x[0]],
    )
    message = refusal(costs)
    assert message.startswith("smallest eigenvalue of the Hessian of the cost of agent 1 at x = ")
    eigenvalue = float(message.split(" = ")[2].split(":")[0])
    assert eigenvalue == pytest.approx(-0.5 * 4.0 * 4.0, abs=1e-3)  # in shares of x


def test_a_decreasing_cost_is_refused_at_a_point_where_it_decreases() -> None:
    message = refusal(PolynomialCosts([1, 2], [[[0.0, 1.0]], [[-1.0, 1.0]]]))
    assert message.startswith("derivative of the cost of agent 1 by resource 0 at x = ")
    assert message.endswith("must be positive; costs must increase with every resource")
    assert 2 * point_in(message)[0] - 1 <= 0


def test_a_cost_that_ignores_a_resource_is_refused() -> None:
    message = refusal(PolynomialCosts([2], [[[1.0], [0.0]]]))
    assert message.startswith("derivative of the cost of agent 0 by resource 1 at x = ")
    assert " = 0.0: must be positive" in message


def test_convex_costs_with_negative_coefficients_are_accepted() -> None:
    # The second derivative of x**4 - x**3 + x**2 is 12 x**2 - 6 x + 2 > 0.
    costs = PolynomialCosts([2, 3, 4], [[[1.0, -1.0, 1.0]]])
    assert problem_with(costs).costs is costs


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_refused_naming_agent_and_point(bad: float) -> None:
    def value(agent: int, x: FloatArray) -> float:
        return bad if agent == 1 and x[0] > 2 else float(x[0])

    costs = CustomCosts(2, 1, value, lambda i, x: [1.0])
    with pytest.raises(InputError, match=r"^cost of agent 1 at x = \[4\.\] = (nan|inf): must be finite"):
        check_on_box(costs, np.array([4.0]))
    with np.errstate(invalid="ignore"):
        message = refusal(costs)
    assert message.startswith(f"CustomCosts.value() of agent 1 at x = [4.] = {bad}: must be finite where")


def test_a_derivative_that_is_nan_is_refused_naming_agent_and_point() -> None:
    costs = CustomCosts(3, 1, lambda i, x: x[0], lambda i, x: [math.nan if i == 2 else 1.0])
    with pytest.raises(
        InputError, match=r"^cost of agent 2 at x = \[4\.\] = 4\.0: must be finite, with finite der"
    ):
        check_on_box(costs, np.array([4.0]))
    assert refusal(costs).startswith(
        "CustomCosts.gradient() of agent 2 at x = [4.] = nan: must be finite where"
    )


def test_a_wrong_gradient_is_refused_naming_agent_resource_and_point() -> None:
    costs = CustomCosts(
        3,
        2,
        value=lambda i, x: x[0] ** 2 + x[1] ** 3,
        gradient=lambda i, x: [2 * x[0], 3 * x[1] ** 2 * (1 + 1e-5 * (i == 1))],
    )
    message = refusal(costs)
    start = "CustomCosts.gradient() of agent 1 by resource 1 at x = [4., 4.] = 48.00048: must be the deri"
    start += "vative of value, "
    assert message.startswith(start)
    assert message.endswith(" by central differences; correct the gradient")
    assert float(message.removeprefix(start).split()[0]) == pytest.approx(48.0, rel=1e-8)


@given(CASES)
def test_a_right_gradient_is_accepted_whatever_the_units(case: tuple[int, int, int, str]) -> None:
    rng = np.random.default_rng(case[0])
    share = 10.0 ** rng.uniform(0, 4, case[2])
    own = random_costs(rng, case[3], share, case[1])
    costs = own if isinstance(own, CustomCosts) else as_custom(own)
    check_costs(costs, share * 3)


@pytest.mark.parametrize("capacity", [1e-3, 1e-6, 1e-9])
def test_a_right_gradient_is_accepted_where_capacities_are_small(capacity: float) -> None:
    costs = CustomCosts(
        1, 1, lambda i, x: (x[0] / capacity) ** 4, lambda i, x: [4 * (x[0] / capacity) ** 3 / capacity]
    )
    assert problem_with(costs, capacity).costs is costs


def test_a_concave_cost_is_refused_where_units_are_small() -> None:
    # 10 % of the marginal cost are gone at a capacity of 1e9 bytes.
    refusal(PolynomialCosts([1, 2], [[[1.0, -5e-11]]]), capacity=1e9)


def test_a_convex_cost_without_a_hessian_is_accepted_where_its_hessian_is_singular() -> None:
    for seed in range(20):
        weights = np.random.default_rng(seed).uniform(0.1, 1.0, 2)
        costs = CustomCosts(
            1,
            2,
            value=lambda i, x, w=weights: w @ x + (w @ x) ** 2,  # type: ignore[misc]
            gradient=lambda i, x, w=weights: (1 + 2 * w @ x) * w,  # type: ignore[misc]
        )
        assert problem_with(costs).costs is costs


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_a_hessian_by_differences_is_near_the_one_that_is_given(seed: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    share = 10.0 ** rng.uniform(-1, 2, m)
    costs = random_costs(rng, "coupled", share, 3)
    x = share * rng.uniform(0.5, 2.0, (3, m))
    given_hessian, by_differences = as_custom(costs).hessian(x), as_custom(costs, hessian=False).hessian(x)
    assert np.array_equal(by_differences, by_differences.transpose(0, 2, 1))
    scale = np.sqrt(np.einsum("ijj->ij", given_hessian))
    np.testing.assert_allclose(
        by_differences / (scale[:, :, None] * scale[:, None, :]),
        given_hessian / (scale[:, :, None] * scale[:, None, :]),
        atol=1e-7,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 1, abs, abs), "n_agents = 0: must be an integer of at least 1"),
        ((1, 1.0, abs, abs), "n_resources = 1.0: must be an integer of at least 1"),
        ((1, 1, 3, abs), "value = 3: must be a function of (agent, allocation)"),
        ((1, 1, abs, None), "gradient = None: must be a function of (agent, allocation)"),
        ((1, 1, abs, abs, "f"), "hessian = 'f': must be a function of (agent, allocation)"),
    ],
)
def test_custom_costs_refuse_by_name(arguments: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        CustomCosts(*arguments)


def test_a_gradient_of_the_wrong_length_is_refused_naming_the_agent() -> None:
    costs = CustomCosts(2, 2, lambda i, x: x.sum(), lambda i, x: [1.0] * (2 - i))
    with pytest.raises(InputError, match=r"^shape of gradient\(agent=1\) = \(1,\): must be \(2,\)"):
        problem_with(costs)


def test_a_box_is_sampled_at_its_corner_inside_and_near_zero() -> None:
    upper = np.array([4.0, 100.0])
    points = sample_box(upper, 32)
    assert points.shape == (32, 2)
    assert points[0].tolist() == upper.tolist()
    assert (points > 0).all()
    assert (points <= upper).all()
    assert (points / upper < 0.01).any(axis=0).all()
    assert np.array_equal(points, sample_box(upper, 32))
