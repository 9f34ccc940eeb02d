"""Costs of any family: what it does not say itself is made from value, gradient and hessian."""

import re
from typing import Any

import numba
import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    CustomCosts,
    Fleet,
    InputError,
    Problem,
    Recording,
    Resource,
    Simulation,
    run_synchronous,
    solve_optimum,
)
from aimd_des.costs import CostTable, weighted_costs
from aimd_des.interventions import Absence, UnusualActivity
from aimd_des.problem.costs import Costs, cost_table, marginal_cost, selected_costs
from aimd_des.utils.validation import FloatArray
from tests.conftest import assert_same_run

FACTORS = np.array([1.0, 2.0, 0.5, 1.5])


class Cubic:
    """f_i = a_i sum_j (x_j**2 + x_j**3): a family with nothing but what any must have."""

    n_agents, n_resources, separable, proven = 4, 2, True, False

    def value(self, x: FloatArray) -> FloatArray:
        return FACTORS * (x**2 + x**3).sum(axis=1)

    def gradient(self, x: FloatArray) -> FloatArray:
        return FACTORS[:, None] * (2.0 * x + 3.0 * (x * x))

    def hessian(self, x: FloatArray) -> FloatArray:
        return (FACTORS[:, None] * (2.0 + 6.0 * x))[:, :, None] * np.eye(2)


@numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
def cubic(agent: int, x: FloatArray) -> tuple[float, float]:
    factor = FACTORS[agent]
    return factor * (2.0 * x[0] + 3.0 * (x[0] * x[0])), factor * (2.0 * x[1] + 3.0 * (x[1] * x[1]))


class Compiled(Cubic):
    """The same, for fleets: its gradient once more, compiled."""

    def compiled_gradient(self) -> Any:
        return cubic


class Tabled(Cubic):
    """The same, for all compiled code: its derivatives as a table."""

    def table(self) -> CostTable:
        return CostTable.of(FACTORS[:, None, None] * np.broadcast_to([0.0, 2.0, 3.0], (4, 2, 3)))


def problem_of(costs: Costs) -> Problem:
    names = ("memory", "disk")
    return Problem(
        [Resource(n, capacity=3.0, increase=0.05, decrease=0.6, normalization=0.03) for n in names], costs
    )


def run(costs: Costs, agents: Any, **parts: Any) -> Any:
    given = {"recording": Recording(events=True), "seed": 2, **parts}
    return Simulation(problem_of(costs), agents=agents, **given).run(80.0)


@pytest.mark.parametrize("family", [Cubic, Compiled, Tabled])
def test_processes_are_the_synchronous_algorithm_with_costs_of_any_family(family: type[Cubic]) -> None:
    result = run_synchronous(problem_of(family()), steps=80, seed=2, lag=0)
    assert result.account.responses.sum() > 20
    assert run(family(), AgentProcess, recording=Recording()).digest == result.digest


@pytest.mark.parametrize("family", [Compiled, Tabled])
@pytest.mark.parametrize("weight", [None, 3.0])
def test_a_fleet_takes_a_table_or_a_compiled_gradient(family: type[Cubic], weight: float | None) -> None:
    changes = [] if weight is None else [UnusualActivity([1, 2], 20.0, 50.0, weight)]
    first, second = (run(family(), agents, interventions=changes) for agents in (AgentProcess, Fleet))
    assert_same_run(first, second)


def test_a_fleet_is_refused_where_a_family_gives_neither() -> None:
    words = (
        "agents = 'Fleet': must be AgentProcess with Cubic that have no table and no compiled gradient; give"
    )
    with pytest.raises(InputError, match=f"^{re.escape(words)}"):
        run(Cubic(), Fleet)


def test_agents_that_are_away_are_left_out_of_the_optimum_of_any_family() -> None:
    result = run(Cubic(), AgentProcess, interventions=[Absence(1, 30.0, 60.0)])
    few = np.array([0, 2, 3])
    own = CustomCosts(
        3,
        2,
        lambda i, x: FACTORS[few[i]] * (x**2 + x**3).sum(),
        lambda i, x: FACTORS[few[i]] * (2.0 * x + 3.0 * (x * x)),
        separable=True,
    )
    away = result.pieces["multiplier"].to_numpy().reshape(3, 2)[1]
    np.testing.assert_allclose(away, solve_optimum(problem_of(own)).multipliers, rtol=1e-6)


@pytest.mark.parametrize("family", [Cubic, Compiled, Tabled])
def test_weights_and_selections_are_made_of_any_family(family: type[Cubic]) -> None:
    costs, x = family(), np.random.default_rng(0).uniform(0.1, 2.0, (4, 2))
    weights, few = np.array([1.0, 2.0, 3.0, 4.0]), [False, True, False, True]
    weighted, selected = weighted_costs(costs, weights), selected_costs(costs, few)
    for name in ("value", "gradient", "hessian"):
        plain = getattr(costs, name)(x)
        spread = weights.reshape(-1, *[1] * (plain.ndim - 1))
        np.testing.assert_array_equal(getattr(weighted, name)(x), spread * plain)
        np.testing.assert_array_equal(getattr(selected, name)(x[few]), plain[few])
    slopes = [marginal_cost(costs, i)(x[i].tolist(), 1) for i in range(4)]
    assert slopes == pytest.approx(costs.gradient(x)[:, 1], rel=1e-14)
    with pytest.raises(InputError, match="differ from resource to resource"):
        weighted_costs(costs, np.array([[1.0, 2.0]] * 4))


class Broken(Cubic):
    """The same, with one method that returns something else."""

    def __init__(self, method: str, returned: Any) -> None:
        setattr(self, method, lambda *given: returned)


@pytest.mark.parametrize(
    ("method", "returned", "message"),
    [
        ("value", 1.0, "Broken.value() = 1.0: must be an array of numbers of shape (4,)"),
        ("gradient", np.full((4, 2), "a"), "Broken.gradient() = array("),
        ("gradient", np.ones((2, 4)), "shape of Broken.gradient() = (2, 4): must be (4, 2)"),
        (
            "hessian",
            np.full((4, 2, 2), np.nan),
            "Broken.hessian() of agent 0 at x = [3., 3.] = nan: must be fini",
        ),
        (
            "gradient",
            np.ones((4, 2)),
            "Broken.gradient() of agent 0 by resource 0 at x = [3., 3.] = 1.0: must be",
        ),
        ("table", 3, "Broken.table() = 3: must be a CostTable, or None"),
        (
            "table",
            CostTable.of(np.ones((3, 2, 1))),
            "resources and agents of Broken.table() = (2, 3): must be (2, 4)",
        ),
        (
            "compiled_gradient",
            abs,
            "Broken.compiled_gradient() = <built-in function abs>: must be a function dec",
        ),
    ],
)
def test_what_a_family_gives_back_is_refused_by_class_and_method(
    method: str, returned: Any, message: str
) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        run(Broken(method, returned), Fleet)


def test_what_a_family_lacks_is_named() -> None:
    class Bare:
        n_agents, n_resources, proven = 1, 1, False

    with pytest.raises(InputError, match=r"Bare has no separable, value, gradient, hessian$"):
        problem_of(Bare())  # type: ignore[arg-type]  # that is the point


def test_without_a_table_there_are_no_agents_in_it() -> None:
    assert cost_table(Cubic()).n_agents == 0
    assert cost_table(Tabled()).n_agents == 4
