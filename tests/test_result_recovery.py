"""How long averages take to recover from a change: cases by hand, and the measure of studies."""

from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, PolynomialCosts, Problem, Recording, Result, Study, run_synchronous
from aimd_des.results.metrics import Overshoot
from aimd_des.results.run_data import Account, Observations, Piece, Signals
from aimd_des.study.points import expand
from tests.conftest import quietly, resource

# Costs x^2 and 2 x^2: the optimum gives agent 0 two thirds of what is shared.
COSTS = PolynomialCosts([2], [[[1.0]], [[2.0]]])
PROBLEM = Problem([resource(capacity=6.0, increase=0.01, decrease=0.5, normalization=0.05)], COSTS)
BOTH, FIRST, NOBODY = np.array([True, True]), np.array([True, False]), np.array([False, False])
OLD = Piece(0.0, np.array([6.0]), BOTH, COSTS)
LESS = Piece(10.0, np.array([3.0]), BOTH, COSTS)


def made(times: list[float], averages: list[tuple[float, float]], *pieces: Piece) -> Result:
    """A run whose averages were these."""
    looks, none = np.array(averages)[:, None, :], np.zeros((1, 2), dtype=np.int64)
    missing = np.full(1, np.nan)
    total = looks.sum(axis=2)
    at = np.array(times)
    seen = Observations(at, total, total, at, looks, looks, Overshoot(missing, missing, missing), missing)
    sent = Signals(np.empty(0), np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))
    account = Account(none, none, none, none, none, none)
    return Result(PROBLEM, "continuous", 0, times[-1], sent, seen, account, pieces=(OLD, *pieces))


def times_of(result: Result, *arguments: Any, **options: Any) -> list[float]:
    return result.recovery(*arguments, **options)["recovery_time"].tolist()


# Levels of the new capacity from the change on: 2, 1.5, 1.1, 1.0, 1.0.
AT = [0.0, 10.0, 11.0, 12.0, 13.0, 14.0]
SHRINKING = [(4.0, 2.0), (4.0, 2.0), (3.0, 1.5), (2.2, 1.1), (2.0, 1.0), (2.0, 1.0)]


def test_a_level_has_recovered_when_it_stays_within() -> None:
    result = made(AT, SHRINKING, LESS)
    frame = result.recovery()
    assert list(frame.columns) == ["start", "end", "resource", "recovery_time"]
    assert (frame["start"].tolist(), frame["end"].tolist()) == ([10.0], [14.0])
    # From 10 % above at 12 to none at 13, the 5 % lie half-way.
    assert times_of(result) == pytest.approx([2.5])
    assert times_of(result, within=0.5) == pytest.approx([1.0])
    assert times_of(result, within=0.999999) == pytest.approx([0.0], abs=1e-5)
    # A fifth of the change is left between 0.5 at 11 and 0.1 at 12.
    assert times_of(result, within=0.2, of="change") == pytest.approx([1.75])


def test_what_leaves_again_has_not_recovered() -> None:
    left = [*SHRINKING[:-1], (4.0, 2.0)]
    assert times_of(made(AT, left, LESS)) == [np.inf]
    back = made([*AT, 15.0], [*left, (2.0, 1.0)], LESS)
    assert times_of(back) == pytest.approx([4.95])


def test_each_change_has_until_the_next() -> None:
    again = Piece(12.5, np.array([6.0]), BOTH, COSTS)
    assert times_of(made(AT, SHRINKING, LESS, again)) == [np.inf, np.inf]
    same = Piece(12.5, np.array([3.0]), BOTH, COSTS)
    assert times_of(made(AT, SHRINKING, LESS, same)) == [np.inf, 0.0]


def test_errors_are_held_against_the_optimum_in_force() -> None:
    # At 13 agents hold (1, 2) of the 3 that there are, and should hold (2, 1); at 14 they do.
    wrong = [*SHRINKING[:-2], (1.0, 2.0), (2.0, 1.0)]
    result = made(AT, wrong, LESS)
    assert times_of(result) == pytest.approx([2.5])
    for measure in ("relative_error", "misallocation"):
        assert times_of(result, measure) == pytest.approx([3.0 + 1.0 - 0.05 / (2.0 / 3.0)], rel=1e-6)
    # Averages in the right proportion are no misallocation, however much is used.
    assert times_of(made(AT, SHRINKING, LESS), "misallocation", 1e-6) == [0.0]
    # An agent that has left does not count.
    alone = Piece(10.0, np.array([3.0]), FIRST, COSTS)
    assert times_of(made(AT, wrong, alone)) == [np.inf]
    assert times_of(made([0.0, 10.0, 11.0], [(4.0, 2.0), (3.0, 9.0), (3.0, 9.0)], alone)) == [0.0]


def test_there_is_no_number_where_nobody_is_or_nothing_was_recorded() -> None:
    nobody = Piece(10.0, np.array([3.0]), NOBODY, COSTS)
    for measure in ("level", "relative_error", "misallocation"):
        assert np.isnan(times_of(made(AT, SHRINKING, nobody), measure)).all()
    short = Piece(10.0, np.array([5.0]), BOTH, COSTS), Piece(10.5, np.array([3.0]), BOTH, COSTS)
    assert np.isnan(times_of(made([0.0, 11.0], [(4.0, 2.0), (2.0, 1.0)], *short))).tolist() == [True, False]
    # Without a change there is nothing to recover from.
    still = quietly(run_synchronous, PROBLEM, steps=5, seed=0)
    assert still.recovery().empty
    assert np.isnan(still.measures(names=["recovery_time"])["recovery_time"]).all()


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"measure": "cost_ratio"}, "measure"),
        ({"within": 0.0}, "within"),
        ({"within": 1.0}, "within"),
        ({"of": "all"}, "of"),
    ],
)
def test_what_is_unknown_or_out_of_range_is_refused(options: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError, match=field):
        made(AT, SHRINKING, LESS).recovery(**options)


SCENARIO = {
    "until": 400.0,
    "costs": {"exponents": [2], "coefficients": [[[1.0]], [[2.0]]]},
    "averaging": {"kind": "forgetting", "time_constant": 20.0},
    "resources": [{"name": "r", "capacity": 3.0, "increase": 0.05, "decrease": 0.9, "normalization": 0.3}],
    "interventions": [{"kind": "capacity_step", "resource": "r", "at": 150.0, "capacity": 1.5}],
}


def test_studies_record_what_the_measure_needs() -> None:
    study = Study(scenario=SCENARIO, measures=["recovery_time", "utilisation"])
    assert study.columns() == ("utilisation", "recovery_time")
    scenario = expand(study)[0].scenario
    assert scenario.recording.allocations == "auto"
    result = quietly(scenario.model_copy(update={"seed": 1}).run)
    (found,) = result.measures(names=study.columns())["recovery_time"].tolist()
    assert result.recovery("level", 0.05)["recovery_time"].tolist() == [found]
    assert 20.0 < found < 200.0
    # It is measured, and recorded for, only where it is asked for.
    assert "recovery_time" not in Study(scenario=SCENARIO).columns()
    assert expand(Study(scenario=SCENARIO))[0].scenario.recording.allocations == "end"
    assert Recording().allocations == "end"
