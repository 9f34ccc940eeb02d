"""Multilevel splitting on a walk whose probabilities are known exactly."""

import math
import random
from collections.abc import Sequence
from typing import Self

import numpy as np
import pytest

from aimd_des.study.splitting import find_levels, fixed_effort, restart
from aimd_des.study.statistics.intervals import mean_interval

UP, STEPS = 0.4, 60


def exact(level: int, up: float = UP, steps: int = STEPS) -> float:
    """The probability that a walk on the integers reaches a level within some steps."""
    at = np.zeros(level + steps + 1)  # place k is the integer k - steps
    at[steps], reached = 1.0, 0.0
    for _ in range(steps):
        moved = np.zeros_like(at)
        moved[1:] += up * at[:-1]
        moved[:-1] += (1.0 - up) * at[1:]
        reached += moved[-1]
        moved[-1] = 0.0
        at = moved
    return reached


class Walk:
    """Up by 1 with probability `UP`, else down by 1."""

    def __init__(self, salts: Sequence[int], place: int = 0, taken: int = 0, reached: float = 0.0) -> None:
        self.salts, self.place, self.taken, self.reached = tuple(salts), place, taken, reached
        # A path is its salts and when each came to be: from there on it takes draws of its own.
        self._rng = random.Random(repr((self.salts, taken)))

    def fork(self, salt: int) -> Self:
        return type(self)((*self.salts, salt), self.place, self.taken, self.reached)

    def step(self) -> float | None:
        if self.taken == STEPS:
            return None
        self.place += 1 if self._rng.random() < UP else -1
        self.taken += 1
        self.reached = max(self.reached, self.place)
        return float(self.place)

    def reach(self, level: float) -> bool:
        while self.reached < level:
            if self.step() is None:
                return False
        return True


def estimates(method: str, level: int, trials: int, repetitions: int, seed: int = 0) -> list[float]:
    levels, found = find_levels(Walk([seed, 0]), [level], trials)
    assert found
    if method == "fixed_effort":
        return [
            fixed_effort(Walk([seed, r]), levels, trials, np.random.default_rng([seed, r])).probability
            for r in range(1, repetitions + 1)
        ]
    runs = [restart(Walk([seed, r]), levels, trials) for r in range(1, repetitions + 1)]
    return [run.probability for run in runs if run is not None]


@pytest.mark.parametrize(
    ("method", "level", "trials"),
    [
        ("fixed_effort", 8, 40),
        ("fixed_effort", 16, 40),
        ("fixed_effort", 28, 150),
        ("restart", 8, 20),
        ("restart", 14, 20),
    ],
)
def test_the_probability_of_a_walk(method: str, level: int, trials: int) -> None:
    """From 0.03 down to 2e-8: within 3.5 standard errors, which are a small part of it."""
    found = mean_interval(estimates(method, level, trials, 25))
    assert abs(found.mean - exact(level)) < 3.5 * found.standard_error
    assert found.standard_error < 0.25 * exact(level)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fixed_effort", "restart"])
def test_intervals_hold_the_truth_as_often_as_they_say(method: str) -> None:
    truth = exact(10)
    inside = 0
    for seed in range(50):
        # By few repetitions of few trials the distribution is too skew for Student's intervals.
        found = mean_interval(estimates(method, 10, 30, 20, seed + 1), 0.95)
        inside += found.low <= truth <= found.high
    # Of 50 intervals 47.5 are expected, with a standard deviation of 1.5.
    assert inside >= 47.5 - 3 * 1.5


def test_levels_are_passed_by_a_fifth() -> None:
    levels, found = find_levels(Walk([3]), [20.0], 200)
    assert found
    assert levels[-1] == 20.0
    assert list(levels) == sorted(set(levels))
    one = fixed_effort(Walk([4]), levels, 200, np.random.default_rng(0))
    # A fifth of 200 paths is known within 0.03; on the integers others tie with the last of them.
    assert all(0.1 < share < 0.7 for share in one.shares)
    assert one.probability == math.prod(one.shares)


def test_levels_that_are_wanted_are_among_them() -> None:
    wanted = [1.0, 7.0, 13.0]
    levels, found = find_levels(Walk([3]), wanted, 100)
    assert found
    assert levels[-1] == 13.0
    assert set(wanted) < set(levels)
    assert list(levels) == sorted(set(levels))


def test_what_cannot_be_reached_is_told() -> None:
    levels, found = find_levels(Walk([5]), [STEPS + 1.0], 50)
    assert not found
    assert levels[-1] <= STEPS


def test_levels_that_are_jumped_over_count_for_all_that_would_have_been_born() -> None:
    """With levels so near to each other that one step passes two of them, by either method."""
    levels = [0.5, 1.0, 1.5, 3.0]
    by_effort = [
        fixed_effort(Walk([6, r]), levels, 40, np.random.default_rng(r)).probability for r in range(30)
    ]
    by_restart = [run.probability for r in range(30) if (run := restart(Walk([7, r]), levels, 2)) is not None]
    for found in (mean_interval(by_effort), mean_interval(by_restart)):
        assert abs(found.mean - exact(3)) < 3.5 * found.standard_error
