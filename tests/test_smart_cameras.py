"""The paper's system, held against eq. (cost_fn) and the numbers of its section V, written out again."""

import math
import re
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, PolynomialCosts, Problem
from models import smart_cameras
from models.smart_cameras import PRICES


def draws(seed: int, n: int) -> list[tuple[int, int, int, int, int]]:
    """a, b, c, d and the kind of cost of each camera, from NumPy's Philox alone."""
    key = np.random.SeedSequence(seed, spawn_key=(0,)).generate_state(2, np.uint64)
    rows = np.random.Generator(np.random.Philox(key=key)).random((n, 5)).tolist()
    return [
        (10 + int(11 * a), 25 + int(11 * b), 22 + int(11 * c), 1 + int(5 * d), int(3 * kind))
        for a, b, c, d, kind in rows
    ]


def cost(camera: tuple[int, int, int, int, int], x: float, y: float, z: float) -> float:
    """Eq. (cost_fn) of the paper; x, y and z are memory, disk and bandwidth."""
    a, b, c, d, kind = camera
    if kind == 0:
        return a * x**2 + c * z**2 + a / 2 * x**4 + 2 * b * y**4 + b / 2 * y**6 + c / 4 * z**4 + d / 8 * z**8
    if kind == 1:
        return a * x**2 + b * y**2 + b / 2 * y**4 + 3 / 2 * c * z**4
    return b * y**2 + c * z**2 + a / 3 * x**6 + d / 6 * y**6 + d / 8 * z**4


@pytest.mark.parametrize("seed", [0, 1, 12345])
def test_costs_are_those_of_the_paper(seed: int) -> None:
    problem = smart_cameras(seed=seed)
    cameras = draws(seed, 60)
    assert {camera[4] for camera in cameras} == {0, 1, 2}
    for x in np.random.default_rng(seed).uniform(0.0, 2.0, (5, 60, 3)):
        expected = [cost(camera, *row) for camera, row in zip(cameras, x.tolist(), strict=True)]
        np.testing.assert_allclose(problem.costs.value(x), expected, rtol=1e-13)


def test_draws_are_from_the_papers_ranges_and_kinds_are_equally_likely() -> None:
    n = 30_000
    cameras = np.array(draws(3, n))
    problem = smart_cameras(seed=3, n_cameras=n)
    x = np.full((n, 3), 0.7)
    expected = [cost(tuple(camera), 0.7, 0.7, 0.7) for camera in cameras.tolist()]
    np.testing.assert_allclose(problem.costs.value(x), expected, rtol=1e-13)
    for column, (low, high) in enumerate([(10, 20), (25, 35), (22, 32), (1, 5)]):
        assert sorted(set(cameras[:, column].tolist())) == list(range(low, high + 1))
    # The number of cameras of a kind is binomial: standard deviation sqrt(n * 1/3 * 2/3).
    z = (np.bincount(cameras[:, 4], minlength=3) - n / 3) / math.sqrt(n * 2 / 9)
    assert (np.abs(z) < 4).all()


def test_resources_are_those_of_the_paper() -> None:
    problem = smart_cameras()
    assert problem.resource_names == ("memory", "disk", "bandwidth")
    assert [resource.unit for resource in problem.resources] == ["GB", "10 GB", "10 Mbps"]
    assert problem.capacity.tolist() == [32.0, 20.0, 25.0]
    assert problem.decrease[0].tolist() == [0.70, 0.85, 0.75]
    assert problem.increase[0].tolist() == [0.025, 0.020, 0.0225]  # 25 MB, 200 MB, 225 kbps
    assert problem.normalization.tolist() == [1 / 90] * 3
    assert problem.threshold.tolist() == [1.0] * 3
    assert (problem.n_agents, problem.n_resources) == (60, 3)


def test_the_printed_increase_of_disk_is_a_tenth() -> None:
    as_run, printed = smart_cameras(increase="as_run"), smart_cameras(increase="as_printed")
    assert printed.increase[0].tolist() == [0.025, 0.002, 0.0225]  # 20 MB
    assert isinstance(as_run.costs, PolynomialCosts)
    assert isinstance(printed.costs, PolynomialCosts)
    assert np.array_equal(as_run.costs.coefficients, printed.costs.coefficients)


def test_factors_follow_the_price_table() -> None:
    # Prices lie in the ranges of a, b and c: memory in thousandths of a dollar, the others in hundredths.
    assert PRICES == {"memory": 0.017784, "disk": 0.283333, "bandwidth": 0.277775}
    for name, (low, high) in {"memory": (10, 20), "disk": (25, 35), "bandwidth": (22, 32)}.items():
        scale = 1000 if name == "memory" else 100
        assert low <= scale * PRICES[name] <= high


def coefficients(problem: Problem) -> Any:
    assert isinstance(problem.costs, PolynomialCosts)
    return problem.costs.coefficients


def test_the_first_cameras_stay_when_more_are_added() -> None:
    few, many = smart_cameras(seed=7, n_cameras=10), smart_cameras(seed=7, n_cameras=61)
    assert np.array_equal(coefficients(few), coefficients(many)[:10])


def test_capacities_grow_with_the_number_of_cameras() -> None:
    np.testing.assert_allclose(smart_cameras(n_cameras=90).capacity, [48.0, 30.0, 37.5], rtol=1e-15)
    assert smart_cameras(n_cameras=1).n_agents == 1


def test_the_seed_decides_the_costs_and_nothing_else() -> None:
    one, same, other = smart_cameras(seed=1), smart_cameras(seed=1), smart_cameras(seed=2)
    assert np.array_equal(coefficients(one), coefficients(same))
    assert not np.array_equal(coefficients(one), coefficients(other))
    assert np.array_equal(one.increase, other.increase)
    assert np.array_equal(one.capacity, other.capacity)


def test_the_normalization_factor_may_be_chosen() -> None:
    assert smart_cameras(normalization=0.001).normalization.tolist() == [0.001] * 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_cameras": 0}, "n_cameras = 0: must be an integer of at least 1"),
        ({"n_cameras": 60.0}, "n_cameras = 60.0: must be an integer of at least 1"),
        ({"n_cameras": "60"}, "n_cameras = '60': must be an integer of at least 1"),
        ({"increase": "printed"}, "increase = 'printed': must be one of 'as_run', 'as_printed'"),
        ({"increase": 0.02}, "increase = 0.02: must be one of 'as_run', 'as_printed'"),
        ({"normalization": 0.0}, "normalization of memory = 0.0: must be a finite number greater than 0"),
        ({"normalization": math.nan}, "normalization of memory = nan: must be a finite number"),
        ({"seed": -1}, "seed = -1: must be an integer of at least 0"),
        ({"seed": 0.0}, "seed = 0.0: must be an integer of at least 0"),
    ],
)
def test_it_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        smart_cameras(**options)


def test_an_increase_that_cannot_be_hashed_is_refused() -> None:
    with pytest.raises(InputError, match="increase"):
        smart_cameras(increase=["as_run"])  # type: ignore[arg-type]
