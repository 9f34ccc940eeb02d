"""Values exactly at a boundary, and sums whose order decides their last bit."""

import math
from itertools import accumulate

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    Clocks,
    InputError,
    Result,
    Sampled,
    Simulation,
    SimulationError,
    solve_optimum,
)
from aimd_des.channel.latency.kernels import quantile_row
from aimd_des.engine.conditions import growth_of
from aimd_des.latency import Uniform
from aimd_des.utils.rng import Purpose, key
from tests.conftest import quadratic_problem, quietly, random_problem


def test_jitter_equal_to_the_period_is_refused() -> None:
    """Ticks would keep their order only as the draws fall: up to the last number below the period they do."""
    clock = key(0, Purpose.CLOCK)
    with pytest.raises(InputError, match=r"^jitter of agent 0 = 0\.5: must be less than the period, 0\.5$"):
        Clocks(0.5, jitter=0.5).start(2, clock)
    assert not Clocks(0.5, jitter=math.nextafter(0.5, 0.0)).start(2, clock).common


def test_a_uniform_latency_is_the_same_to_the_last_bit_as_its_formula() -> None:
    low, high = np.sort(np.random.default_rng(1).exponential(1.0, (2, 2000)), axis=0)
    uniform = np.random.default_rng(2).random(2000)
    uniform[::100] = 1.0 - 2.0**-53  # the largest that is drawn
    expected = low + (high - low) * uniform
    drawn = uniform.copy()
    quantile_row(Uniform(low, high).table(2000), drawn)
    assert drawn.tolist() == expected.tolist()
    assert (drawn <= high).all()
    # Another formula for the same differs in the last bit of some.
    assert (low * (1.0 - uniform) + high * uniform != expected).any()


def test_the_optimum_is_as_exact_as_it_says() -> None:
    """The last step but one leaves 9e-8 and 5e-9 here: a tolerance 1,000 times as large stops there."""
    for seed in (6, 8):
        problem = random_problem(seed, 5, 2)
        exact, asked = solve_optimum(problem), solve_optimum(problem, tolerance=1e-10)
        loose = solve_optimum(problem, tolerance=1e-7)
        assert exact.kkt_residual <= 1e-10 < loose.kkt_residual <= 1e-7
        assert exact.iterations == asked.iterations == loose.iterations + 1
        # What is not as exact as was asked for is an error, and no result.
        with pytest.raises(SimulationError, match="wanted at most 1e-10"):
            solve_optimum(problem, max_iterations=loose.iterations)


def test_growth_is_added_up_in_the_order_of_the_agents() -> None:
    """As totals are: the fleet and processes find the same instant of a crossing by it."""
    increase = np.random.default_rng(3).random((2, 1000))
    expected = [list(accumulate(row.tolist()))[-1] for row in increase]
    assert growth_of(increase).tolist() == expected
    for other in (increase.sum(axis=1), growth_of(increase[:, ::-1])):
        assert (other != expected).any()


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_a_probability_of_exactly_one_is_not_above_one(dynamics: str) -> None:
    """Gamma c_i 2 x / x is 1 whatever the average; every response is certain, and none is saturated."""

    def run(normalization: float) -> Result:
        problem = quadratic_problem([1.0, 1.0], capacity=1.0, increase=0.25, normalization=normalization)
        simulation = Simulation(
            problem, dynamics=dynamics, control_unit=Sampled(1.0, 0.5), agents=AgentProcess, seed=1
        )
        return quietly(simulation.run, 20.0)

    exactly, above = run(0.5), run(math.nextafter(0.5, 1.0))
    assert exactly.account.responses.min() == above.account.responses.min() >= 4
    assert exactly.account.saturated.tolist() == [[0, 0]]
    assert above.account.saturated.tolist() == above.account.responses.tolist()
