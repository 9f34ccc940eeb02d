"""What the studies share: rows of single runs, and what is measured of one resource."""

from typing import NamedTuple

import pytest

from aimd_des import Recording
from scenarios.common.measure import quietly, rows_of, sensed, signal_rate, totals
from scenarios.common.systems import memory_alone


class Point(NamedTuple):
    way: str
    loss: float


def test_rows_have_the_draw_and_what_the_case_and_the_outcome_hold() -> None:
    pairs = [(Point("a", 0.2), [[{"peak": 1.0}], [{"peak": 2.0}, {"peak": 3.0}]])]
    labels = {"way": "a", "loss": 0.2}
    assert rows_of(pairs, first=5) == [
        {"draw": draw, **labels, "peak": peak} for draw, peak in ((5, 1.0), (6, 2.0), (6, 3.0))
    ]
    made = rows_of(pairs, lambda case, draw, one: {"at": case.loss + draw, **one})
    assert made[1] == {"draw": 1, "at": 1.2, "peak": 2.0}


def test_total_demand_is_over_the_capacity_and_signals_are_per_unit_of_time() -> None:
    simulation = sensed(memory_alone(), 0.5, seed=0, recording=Recording(demand=[10.0, 20.0]))
    result = quietly(simulation, 30.0)
    assert totals(result) == pytest.approx(result.observations.total_demand[:, 0] / 32.0)
    assert signal_rate(result, 20.0) == (result.signals["time"] >= 20.0).sum() / 10.0
