"""What the study of a capacity drop is to show, at a small size: draws 0 to 3 of the costs, 4 runs each."""

from functools import partial

import numpy as np
import pytest

from aimd_des import theory
from aimd_des.study import mean_and_error
from scenarios.capacity_drop import (
    DYNAMICS,
    LEVEL,
    PAPER,
    QUADRATIC,
    SCATTER,
    Drop,
    closed_form,
    measure,
    recover,
)
from scenarios.common.measure import run_draws
from scenarios.common.tables import theory_of

DRAWS, EACH = 4, 4
# Standard errors by which a mean over draws may be off: by Student's t with 3 degrees of freedom once in 200.
Z = 6.0
# The same with 7 degrees of freedom, once in 1,000.
REPLICATIONS, Z_DROPS = 8, 5.4
RAMP, AGE, WINDOW = 40.0, 300.0, 100.0
# Totals are recorded every unit of time; a window slides by half of one.
RESOLUTION = 1.0
# What is used is predicted to 0.2 %, of which the last 7 % of the way make 3 % of half a window.
DOUBT = 0.03 * WINDOW / 2
WAYS = ["window", "forgetting"]

Numbers = dict[tuple[str, float], dict[str, list[float]]]


@pytest.fixture(scope="module")
def runs() -> Numbers:
    """By way and ramp: the numbers of each draw."""
    cases = [Drop(QUADRATIC, way, ramp, AGE, WINDOW) for way in WAYS for ramp in (0.0, RAMP)]
    pairs = run_draws(partial(measure, EACH), cases, DRAWS, 1, 0, quick=True)
    return {
        (case.way, case.ramp): {name: [one.numbers[name] for (one,) in found] for name in found[0][0].numbers}
        for case, found in pairs
    }


@pytest.mark.slow
def test_a_ramp_is_a_step_at_its_middle(runs: Numbers) -> None:
    for way in WAYS:
        times = {}
        for ramp in (0.0, RAMP):
            found = runs[way, ramp]
            mean, error = mean_and_error(found[LEVEL])
            assert abs(mean - np.mean(found[theory_of(LEVEL)])) < Z * error + RESOLUTION + DOUBT
            times[ramp] = mean, error
        later = times[RAMP][0] - times[0.0][0]
        allowed = Z * float(np.hypot(times[0.0][1], times[RAMP][1])) + 2 * RESOLUTION + DOUBT
        known = [closed_form(Drop(QUADRATIC, way, ramp, AGE, WINDOW)) for ramp in (0.0, RAMP)]
        wanted = known[1] - known[0]
        assert abs(later - wanted) < allowed
        # A ramp in steps of 1 is half of one later; less than 3 for the bend of forgetting and the edge of
        # the window.
        assert 0.0 <= wanted - 0.5 * (RAMP + 1.0) < 3.0
        # Negative control: it is a step neither at its beginning nor at its end.
        assert min(abs(later), abs(later - RAMP)) > allowed


@pytest.mark.slow
def test_the_price_is_the_scatter_that_theory_has(runs: Numbers) -> None:
    for way in WAYS:
        found = runs[way, 0.0]
        scatter, known = np.sqrt(np.mean(np.square(found[SCATTER]))), np.mean(found[theory_of(SCATTER)])
        # A standard deviation of 60 agents with 3 degrees of freedom in each of 4 draws, which hardly depend
        # on each other; theory is up to 4 % off in the full study.
        allowed = 4.0 * scatter / np.sqrt(2.0 * 60 * (EACH - 1) * DRAWS) + 0.04 * known
        assert abs(scatter - known) < allowed
        # Negative control: a memory of twice the length would scatter by a root of two less.
        memory = Drop(QUADRATIC, way, 0.0, AGE, WINDOW).memory
        longer = {name: 2.0 * value for name, value in memory.items()}
        ordinary = float(theory.averaging_spread(0.53, 0.025, 0.7, **memory))
        less = float(theory.averaging_spread(0.53, 0.025, 0.7, **longer)) / ordinary * known
        assert abs(scatter - less) > allowed


@pytest.mark.slow
def test_mean_dynamics_recover_as_runs_do(runs: Numbers) -> None:
    found = runs["forgetting", 0.0]
    mean, error = mean_and_error(found[DYNAMICS])
    allowed = Z * error + RESOLUTION + DOUBT
    assert abs(mean - np.mean(found[theory_of(DYNAMICS)])) < allowed
    # Negative control: as if all of the capacity were used.
    assert abs(mean - closed_form(Drop(QUADRATIC, "forgetting", 0.0, AGE, WINDOW), plain=True)) > allowed
    for case in (("window", 0.0), ("forgetting", RAMP)):
        assert DYNAMICS not in runs[case]


@pytest.mark.slow
@pytest.mark.parametrize(("left", "later"), [(0.85, "window"), (0.5, "forgetting")])
def test_which_short_memory_is_later_depends_on_the_drop(left: float, later: str) -> None:
    """With the window of the study, and the costs of draws 0 to 7."""
    times, theories = {}, {}
    for way in WAYS:
        case = Drop(PAPER, way, 0.0, 600.0, 400.0, left)
        times[way] = np.array([recover(case, draw, 1000 * draw)[LEVEL] for draw in range(REPLICATIONS)])
        theories[way] = np.mean([closed_form(case._replace(draw=draw)) for draw in range(REPLICATIONS)])
        mean, error = mean_and_error(times[way])
        assert abs(mean - theories[way]) < Z_DROPS * error + RESOLUTION + 0.03 * 400.0 / 2
    (sooner,) = set(WAYS) - {later}
    mean, error = mean_and_error(times[later] - times[sooner])
    assert mean > Z_DROPS * error
    assert theories[later] > theories[sooner]
