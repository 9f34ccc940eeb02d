"""What the study of outages is to show, at a small size: seeds 0 to 7, 20 periods, latency 0.5."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest

from aimd_des.study import mean_and_error, replicate
from scenarios.outage.runs import ALL, FAILOVER, HALF, OTHER, PART, Found, Outage, expected, measure

# Standard errors by which a mean may be off: by Student's t with 7 degrees of freedom once in 1,000.
Z = 5.4
REPLICATIONS = 8
CASES = {fault: Outage(fault, 20.0, 0.5, 100.0) for fault in (ALL, FAILOVER, PART)}


@pytest.fixture(scope="module")
def runs() -> dict[str, list[Found]]:
    jobs = [partial(measure, case) for case in CASES.values()]
    return dict(zip(CASES, replicate(jobs, REPLICATIONS, 0, workers=1), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("fault", [ALL, FAILOVER])
def test_the_runaway_is_half_a_saw_tooth_below_its_bound(fault: str, runs: dict[str, list[Found]]) -> None:
    case, rises = CASES[fault], [run.runaway for run in runs[fault]]
    assert max(rises) <= case.bound + 1e-9
    mean, error = map(float, mean_and_error(rises))
    # A point of the capacity for what the prediction neglects: two are claimed of what is used.
    allowed = Z * error + 0.01
    assert abs(mean - expected(case)[0]) < allowed
    # Negative control: behind a latency that is twice a saw tooth longer the bound would be another.
    assert case._replace(latency=3.5).bound - mean > allowed


@pytest.mark.slow
def test_who_hears_pays(runs: dict[str, list[Found]]) -> None:
    def extra(fault: str, agents: Any) -> tuple[float, float]:
        mean, error = mean_and_error([float(run.extra[agents].mean()) for run in runs[fault]])
        return float(mean), float(error)

    deaf, hearing = extra(PART, HALF), extra(PART, OTHER)
    assert deaf[0] - Z * deaf[1] > 0.0 > hearing[0] + Z * hearing[1]
    # Nor is it the half that matters: where everybody is cut off both gain, and alike.
    even, odd = extra(ALL, HALF), extra(ALL, OTHER)
    assert abs(even[0] - odd[0]) < Z * math.hypot(even[1], odd[1])
    assert min(even[0] - Z * even[1], odd[0] - Z * odd[1]) > 0.0
    small = np.mean([run.runaway for run in runs[PART]])
    assert small < 0.2 * CASES[PART].bound
