"""What the study of a capacity drop is to show, at a small size: seeds 0 to 7, quadratic costs."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from aimd_des import theory
from aimd_des.study import mean_and_error, replicate
from scenarios.capacity_drop.runs import PAPER, QUADRATIC, Drop, Found, closed_form, measure, recover, rows_of

# Standard errors by which a mean may be off: by Student's t with 7 degrees of freedom once in 1,000.
Z = 5.4
REPLICATIONS = 8
RAMP, AGE, WINDOW = 40.0, 300.0, 100.0
# Totals are recorded every unit of time; a window slides by half of one.
RESOLUTION = 1.0
# What is used is predicted to 0.2 %, of which the last 7 % of the way make 3 % of half a window.
DOUBT = 0.03 * WINDOW / 2
WAYS = ["window", "forgetting"]


@pytest.fixture(scope="module")
def runs() -> dict[tuple[str, float], tuple[Drop, list[Found]]]:
    cases = [Drop(QUADRATIC, way, ramp, AGE, WINDOW) for way in WAYS for ramp in (0.0, RAMP)]
    found = replicate([partial(measure, case) for case in cases], REPLICATIONS, 0, workers=1)
    return {(case.way, case.ramp): (case, runs) for case, runs in zip(cases, found, strict=True)}


def row(runs: Any, way: str, ramp: float, name: str) -> dict[str, Any]:
    return next(row for row in rows_of(*runs[way, ramp]) if row["measure"] == name)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_a_ramp_is_a_step_at_its_middle(way: str, runs: Any) -> None:
    times = {}
    for ramp in (0.0, RAMP):
        case, _ = runs[way, ramp]
        level = row(runs, way, ramp, "recovery of the level")
        allowed = Z * level["standard_error"] + RESOLUTION + DOUBT
        assert abs(level["mean"] - closed_form(case)) < allowed
        times[ramp] = level["mean"], level["standard_error"]
    later = times[RAMP][0] - times[0.0][0]
    allowed = Z * float(np.hypot(times[0.0][1], times[RAMP][1])) + 2 * RESOLUTION + DOUBT
    wanted = closed_form(runs[way, RAMP][0]) - closed_form(runs[way, 0.0][0])
    assert abs(later - wanted) < allowed
    # A ramp in steps of 1 is half of one later; less than 3 for the bend of forgetting and the window's edge.
    assert 0.0 <= wanted - 0.5 * (RAMP + 1.0) < 3.0
    # Negative control: it is a step neither at its beginning nor at its end.
    assert min(abs(later), abs(later - RAMP)) > allowed


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_the_price_is_the_scatter_that_theory_has(way: str, runs: Any) -> None:
    scatter = row(runs, way, 0.0, "scatter of an average")
    allowed = 4.0 * scatter["standard_error"]  # of 420 degrees of freedom
    assert abs(scatter["mean"] - scatter["theory"]) < allowed
    # Negative control: a memory of twice the length would scatter by a root of two less.
    case = runs[way, 0.0][0]
    longer = {name: 2.0 * value for name, value in case.memory.items()}
    ordinary = float(theory.averaging_spread(0.53, 0.025, 0.7, **case.memory))
    less = float(theory.averaging_spread(0.53, 0.025, 0.7, **longer)) / ordinary * scatter["theory"]
    assert abs(scatter["mean"] - less) > allowed


@pytest.mark.slow
def test_mean_dynamics_recover_as_runs_do(runs: Any) -> None:
    found = row(runs, "forgetting", 0.0, "recovery by mean dynamics")
    allowed = Z * found["standard_error"] + RESOLUTION + DOUBT
    assert abs(found["mean"] - found["theory"]) < allowed
    # Negative control: as if all of the capacity were used.
    case, _ = runs["forgetting", 0.0]
    assert abs(found["mean"] - closed_form(case, plain=True)) > allowed
    for way, ramp in (("window", 0.0), ("forgetting", RAMP)):
        assert "recovery by mean dynamics" not in [made["measure"] for made in rows_of(*runs[way, ramp])]


@pytest.mark.slow
@pytest.mark.parametrize(("left", "later"), [(0.85, "window"), (0.5, "forgetting")])
def test_which_short_memory_is_later_depends_on_the_drop(left: float, later: str) -> None:
    """With the window of the study, and the costs of draws 0 to 7."""
    times, theories = {}, {}
    for way in WAYS:
        case = Drop(PAPER, way, 0.0, 600.0, 400.0, left)
        times[way] = np.array([recover(case, draw, 1000 * draw) for draw in range(REPLICATIONS)])
        theories[way] = np.mean([closed_form(case._replace(draw=draw)) for draw in range(REPLICATIONS)])
        mean, error = mean_and_error(times[way])
        assert abs(mean - theories[way]) < Z * error + RESOLUTION + 0.03 * 400.0 / 2
    (sooner,) = set(WAYS) - {later}
    mean, error = mean_and_error(times[later] - times[sooner])
    assert mean > Z * error
    assert theories[later] > theories[sooner]
