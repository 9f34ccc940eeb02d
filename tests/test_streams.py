"""Random numbers with an address: NumPy's own bits, the same whatever else is drawn."""

import math
from collections.abc import Iterator
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import InputError
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray
from tests.conftest import reference_draws

SEEDS = st.one_of(st.integers(0, 2**64), st.just(10**40))


@given(
    SEEDS,
    st.sampled_from(Purpose),
    st.integers(0, 100),
    st.one_of(st.integers(0, 10**6), st.just(2**62)),
    st.one_of(st.integers(0, 70), st.just(601)),  # a row so long that vectors could be made of it
)
def test_uniforms_are_numpys_philox_to_the_bit(seed: int, purpose: Purpose, j: int, b: int, n: int) -> None:
    drawn = rng.uniforms(rng.key(seed, purpose), j, b, n)
    assert np.array_equal(drawn, reference_draws(seed, purpose, j, b, n))


@given(SEEDS, st.sampled_from(Purpose))
def test_generators_are_numpys_philox_to_the_bit(seed: int, purpose: Purpose) -> None:
    key = np.random.SeedSequence(seed, spawn_key=(int(purpose),)).generate_state(2, np.uint64)
    expected = np.random.Generator(np.random.Philox(key=key)).random(9)
    assert np.array_equal(rng.generator(seed, purpose).random(9), expected)


def test_spawn_keys_never_change() -> None:
    numbers = {purpose.name: purpose.value for purpose in Purpose}
    first = {"PROBLEM": 0, "RESPONSE": 1, "LOSS": 2, "LATENCY": 3, "CLOCK": 4}
    assert {name: numbers[name] for name in first} == first
    assert len(set(numbers.values())) == len(numbers)


@given(SEEDS, st.integers(1, 40), st.integers(0, 40))
def test_the_first_draws_stay_when_agents_are_added(seed: int, n: int, more: int) -> None:
    key = rng.key(seed, Purpose.RESPONSE)
    few, many = rng.uniforms(key, 1, 5, n), rng.uniforms(key, 1, 5, n + more)
    assert np.array_equal(few, many[:n])


def test_no_two_addresses_share_a_draw() -> None:
    addresses = product((0, 1), Purpose, range(3), range(20))
    rows = [rng.uniforms(rng.key(s, purpose), j, b, 61) for s, purpose, j, b in addresses]
    draws = np.concatenate(rows)
    # 36,600 draws of 53 bits: two of them agree by chance with probability below 1e-6.
    assert len(np.unique(draws)) == len(draws)
    assert draws.min() >= 0.0
    assert draws.max() < 1.0


# 100 agents, 3 resources, 1000 broadcasts: 300,000 draws.  For a uniform number U on [0, 1) with
# V = U - 1/2 the variances are Var(V) = 1/12, Var(V^2) = 1/80 - 1/144 = 1/180, and Var(V V') = 1/144.
SEED, AGENTS, RESOURCES, BROADCASTS = 20_240, 100, 3, 1000


def block(seed: int, purpose: Purpose) -> FloatArray:
    key = rng.key(seed, purpose)
    rows = [[rng.uniforms(key, j, b, AGENTS) for b in range(BROADCASTS)] for j in range(RESOURCES)]
    return np.array(rows)


def z_of(values: FloatArray, mean: float, variance: float) -> float:
    """How many standard errors the sample mean is away from the mean."""
    return float((values.mean() - mean) / math.sqrt(variance / values.size))


def z_of_product(u: FloatArray, v: FloatArray) -> float:
    return z_of((u - 0.5) * (v - 0.5), 0.0, 1 / 144)


def z_scores(draws: FloatArray, others: dict[str, FloatArray]) -> Iterator[tuple[str, float]]:
    """Mean, variance and every kind of correlation of draws with axes resource, broadcast, agent."""
    yield "mean", z_of(draws, 0.5, 1 / 12)
    yield "variance", z_of((draws - 0.5) ** 2, 1 / 12, 1 / 180)
    for distance in (1, 2, 4, 8):  # four agents share a block of the cipher
        yield f"agents, {distance} apart", z_of_product(draws[:, :, distance:], draws[:, :, :-distance])
    for distance in (1, 2, 256):
        yield f"broadcasts, {distance} apart", z_of_product(draws[:, distance:], draws[:, :-distance])
    for one, other in pairwise(range(RESOURCES)):
        yield f"resources {one} and {other}", z_of_product(draws[one], draws[other])
    for name, other_draws in others.items():
        yield name, z_of_product(draws, other_draws)


@pytest.fixture(scope="module")
def draws() -> FloatArray:
    return block(SEED, Purpose.RESPONSE)


def test_draws_are_uniform_and_independent(draws: FloatArray) -> None:
    others = {
        "the next seed": block(SEED + 1, Purpose.RESPONSE),
        "losses": block(SEED, Purpose.LOSS),
        "latencies": block(SEED, Purpose.LATENCY),
    }
    scores = dict(z_scores(draws, others))
    assert len(scores) == 14
    # |z| > 4 has probability 6.4e-5, so that one of the 14 is there by chance with less than 1e-3.
    assert {name: z for name, z in scores.items() if not abs(z) < 4} == {}


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("mean", lambda u: 0.99 * u),
        ("variance", lambda u: 0.5 + 0.99 * (u - 0.5)),
        ("agents, 1 apart", lambda u: np.where(np.arange(AGENTS) % 50, u, np.roll(u, 1, axis=2))),
        (
            "broadcasts, 1 apart",
            lambda u: np.where(np.arange(BROADCASTS)[:, None] % 50, u, np.roll(u, 1, axis=1)),
        ),
        ("resources 0 and 1", lambda u: np.where(np.arange(AGENTS) % 50, u, u[:1])),
    ],
)
def test_the_scores_find_draws_that_are_a_little_wrong(name: str, spoil: Any, draws: FloatArray) -> None:
    assert abs(dict(z_scores(spoil(draws), {}))[name]) > 4


@pytest.mark.parametrize("seed", [-1, 1.0, "1", None, True, math.nan, [1]])
def test_a_seed_that_is_none_is_refused(seed: Any) -> None:
    for make in (rng.key, rng.generator):
        with pytest.raises(InputError, match=r"^seed = .*: must be an integer of at least 0$"):
            make(seed, Purpose.RESPONSE)
