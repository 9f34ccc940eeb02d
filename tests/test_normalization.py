"""Normalization factors and F_delta are held against closed forms, dense grids and what they promise."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from aimd_des.problem.costs import Costs, CoupledCosts, CustomCosts, PolynomialCosts
from aimd_des.problem.optimum import in_f_delta, normalization_factors
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


def largest_probability(costs: Costs, factors: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """The largest response probability on random points of the box, its corners and its edges among them."""
    rng = np.random.default_rng(0)
    unit = rng.uniform(size=(500, *low.shape))
    unit[:250] = unit[:250].round()
    points = np.maximum(low + unit * (high - low), 1e-6 * high)
    return max(
        float((factors * costs.gradient(np.tile(point, (costs.n_agents, 1))) / point).max())
        for point in points
    )


def test_a_quadratic_cost_has_a_constant_factor() -> None:
    costs = PolynomialCosts([2], [[[1.0], [5.0]], [[4.0], [0.5]]])
    np.testing.assert_allclose(normalization_factors(costs, [1.0, 2.0]), [1 / 8, 1 / 10], rtol=1e-15)
    np.testing.assert_allclose(normalization_factors(costs, [1e9, 1e-9]), [1 / 8, 1 / 10], rtol=1e-15)


def test_a_steep_cost_has_a_factor_that_shrinks_with_the_box() -> None:
    costs = PolynomialCosts([4], [[[0.25]]])
    for upper in (0.1, 1.0, 100.0):
        np.testing.assert_allclose(normalization_factors(costs, [upper]), [upper**-2], rtol=1e-14)


def test_a_linear_term_leaves_a_factor_only_above_zero() -> None:
    costs = PolynomialCosts([1, 2], [[[3.0, 0.5]]])
    assert normalization_factors(costs, [10.0]).tolist() == [0.0]
    np.testing.assert_allclose(normalization_factors(costs, [10.0], lower=0.5), [1 / 7], rtol=1e-14)


def test_resources_that_interact_leave_a_factor_only_above_zero() -> None:
    # f = (x + 2 y)**2: the steepness 2 + 4 y / x is largest at the least x and the largest y.
    own = PolynomialCosts([1], np.full((1, 2, 1), 1e-300))
    costs = CoupledCosts(own, weights=[[1.0, 2.0]], sum_coefficients=[[1.0]])
    assert normalization_factors(costs, [3.0, 5.0]).tolist() == [0.0, 0.0]
    factors = normalization_factors(costs, [3.0, 5.0], lower=[0.5, 0.25])
    np.testing.assert_allclose(factors, [1 / (2 + 4 * 5 / 0.5), 1 / (8 + 4 * 3 / 0.25)], rtol=1e-14)


def test_a_maximum_inside_the_box_is_found() -> None:
    """Steepness that is largest inside the box: a polynomial with a negative term, and a custom cost."""
    grid = np.linspace(0.05, 3.0, 1_000_001)
    polynomial = PolynomialCosts([1, 2, 3, 4, 5], [[[0.02, 0.2, 2.0, -1.0, 0.15]]])

    def bent(x: FloatArray) -> FloatArray:
        return 2 * x + 1 / (1 + np.exp(-20 * (x - 0.5)))

    custom = CustomCosts(
        1,
        1,
        value=lambda _agent, x: float(x[0] ** 2 + np.logaddexp(0.0, 20 * (x[0] - 0.5)) / 20),
        gradient=lambda _agent, x: bent(x),
    )
    for costs, gradient in ((polynomial, polynomial.gradient(grid[:, None, None])), (custom, bent(grid))):
        steepness = gradient.ravel() / grid
        assert 0 < np.argmax(steepness) < len(grid) - 1
        factor = normalization_factors(costs, [3.0], lower=0.05)
        np.testing.assert_allclose(factor, 1 / steepness.max(), rtol=1e-10)


def test_the_search_agrees_with_the_exact_rule() -> None:
    """The same costs once as polynomials, for which corners suffice, and once as functions."""
    rng = np.random.default_rng(1)
    exact = CoupledCosts(
        PolynomialCosts([1, 2, 4], rng.uniform(0.1, 1, (4, 3, 3))),
        weights=rng.uniform(size=(4, 3)),
        sum_coefficients=rng.uniform(size=(4, 1)),
    )
    searched = CustomCosts(
        4,
        3,
        value=lambda i, x: float(exact.value(np.tile(x, (4, 1)))[i]),
        gradient=lambda i, x: exact.gradient(np.tile(x, (4, 1)))[i],
        hessian=lambda i, x: exact.hessian(np.tile(x, (4, 1)))[i],
    )
    upper, lower = [1.0, 2.0, 3.0], [0.1, 0.01, 0.5]
    np.testing.assert_allclose(
        normalization_factors(searched, upper, lower=lower),
        normalization_factors(exact, upper, lower=lower),
        rtol=1e-9,
    )


@st.composite
def boxes(draw: st.DrawFn) -> tuple[Costs, FloatArray, FloatArray]:
    n, m = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    own = PolynomialCosts([1, 2, 5], rng.uniform(0, 1, (n, m, 3)))
    root = rng.uniform(-0.2, 1, size=(n, m, m))
    high = 10.0 ** rng.uniform(-1, 1, m)
    low = high * draw(st.sampled_from([1e-3, 0.1, 0.9]))
    if draw(st.booleans()):
        return own, low, high
    # A few entries may be negative, so that corners do not suffice.
    return CoupledCosts(own, quadratic=root @ root.transpose(0, 2, 1)), low, high


@settings(derandomize=True, deadline=None, max_examples=60)
@given(box=boxes())
def test_no_probability_exceeds_one(box: tuple[Costs, FloatArray, FloatArray]) -> None:
    costs, low, high = box
    factors = normalization_factors(costs, high, lower=low)
    # A negative entry may let a cost fall somewhere, which is another reason not to be a member.
    assume(in_f_delta(costs, factors * 1e-6, high, lower=low).all())
    assert largest_probability(costs, factors, low, high) <= 1 + 1e-9
    assert in_f_delta(costs, factors * (1 - 1e-9), high, lower=low).all()
    assert not in_f_delta(costs, factors * (1 + 1e-9), high, lower=low).all()


def test_membership_is_told_agent_by_agent() -> None:
    costs = PolynomialCosts([2, 4], [[[1.0, 0.0]], [[3.0, 0.0]], [[1.0, 1.0]]])
    # Steepness 2, 6 and 2 + 4 x**2.
    assert in_f_delta(costs, [0.4], [0.5]).tolist() == [True, False, False]
    assert in_f_delta(costs, [0.3], [0.5]).tolist() == [True, False, True]
    assert in_f_delta(costs, [0.1], [0.5]).tolist() == [True, True, True]
    assert in_f_delta(costs, [0.1], [2.0]).tolist() == [True, True, False]


def test_the_inequality_of_f_delta_is_strict() -> None:
    costs = PolynomialCosts([2], [[[2.0]]])
    assert in_f_delta(costs, [0.25], [1.0]).tolist() == [False]


def test_costs_that_are_concave_or_fall_are_not_members() -> None:
    def costs(gradient: float, bend: float) -> CustomCosts:
        return CustomCosts(
            1,
            1,
            value=lambda _agent, x: float(gradient * x[0] + bend * x[0] ** 2),
            gradient=lambda _agent, x: gradient + 2 * bend * x,
            hessian=lambda _agent, _x: [[2 * bend]],
        )

    convex, concave, falling = costs(1.0, 0.1), costs(1.0, -0.1), costs(-1.0, 0.1)
    assert in_f_delta(convex, [1e-3], [2.0], lower=1.0).tolist() == [True]
    assert in_f_delta(concave, [1e-3], [2.0], lower=1.0).tolist() == [False]
    assert in_f_delta(falling, [1e-3], [2.0], lower=1.0).tolist() == [False]


def test_what_is_asked_for_wrongly_is_refused() -> None:
    costs = PolynomialCosts([2], np.ones((2, 2, 1)))
    with pytest.raises(InputError, match=r"shape of upper = \(1,\)"):
        normalization_factors(costs, [1.0])
    with pytest.raises(InputError, match=r"upper\[1\] = 0\.0"):
        normalization_factors(costs, [1.0, 0.0])
    with pytest.raises(InputError, match=r"lower\[0\] = -1\.0"):
        normalization_factors(costs, [1.0, 1.0], lower=-1.0)
    with pytest.raises(InputError, match=r"lower = \[0\.5, 2\.0\]: must be below upper"):
        normalization_factors(costs, [1.0, 1.0], lower=[0.5, 2.0])
    with pytest.raises(InputError, match=r"delta\[0\] = 0\.0"):
        in_f_delta(costs, [0.0, 1.0], [1.0, 1.0])
