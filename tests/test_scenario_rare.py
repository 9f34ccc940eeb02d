"""What the study of rare peaks is to show, at a small size: one estimate takes a second or so."""

import math

import pytest

from scenarios.rare import LEVELS, Setting, Size, estimate, expected

SMALL = Size(after=100.0, trials=15, repetitions=4, levels=(1.1,))


def at(found: list[dict[str, float]], level: float) -> tuple[float, float]:
    """The probability of a peak, and its standard error."""
    (row,) = [row for row in found if row["level"] == level]
    return row["mean"], row["standard_error"]


def test_loss_makes_peaks_likelier() -> None:
    lossy, lossless = (at(estimate(Setting(loss=loss), 0, SMALL), 1.1) for loss in (0.3, 0.0))
    assert lossy[0] - lossless[0] > 4.0 * math.hypot(lossy[1], lossless[1])


def test_levels_out_of_reach_are_left_out() -> None:
    found, reached = (estimate(Setting(), 0, SMALL._replace(levels=by)) for by in ((1.1, 9.0), (1.1,)))
    assert found[-1]["level"] == 1.1
    assert [row["mean"] for row in found] == [row["mean"] for row in reached]
    assert estimate(Setting(), 0, SMALL._replace(levels=(9.0,))) == []


@pytest.mark.parametrize("setting", [Setting(), Setting(latency=1.0), Setting(loss=0.45)])
def test_theory_has_a_tail_that_ends(setting: Setting) -> None:
    tail = expected(setting, (1.02, 1.05, *LEVELS, 2.0))
    known = [chance for chance in tail if not math.isnan(chance)]
    assert len(known) >= 3
    assert list(tail[: len(known)]) == known == sorted(known, reverse=True)
    assert math.isnan(tail[-1])


def test_theory_has_no_walk_where_signals_do_not_suffice() -> None:
    assert all(map(math.isnan, expected(Setting(loss=0.9), LEVELS)))
