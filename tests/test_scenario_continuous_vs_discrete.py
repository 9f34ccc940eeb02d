"""What the study of clock and continuous time is to show, at a small size: draws 0 to 3 of the costs."""

import numpy as np
import pytest

from aimd_des.study import mean_and_error
from scenarios.common.measure import run_draws
from scenarios.continuous_vs_discrete import Case, measured

# Standard errors by which a mean may be off: by Student's t with 3 degrees of freedom once in 200.
Z = 6.0


@pytest.fixture(scope="module")
def used() -> dict[str, np.ndarray]:
    """Utilisation of each way, shape (draws, resources)."""
    names = ["clock", "clock, acts a step later", "continuous, sampled", "continuous, crossing"]
    cases = [Case(name, 900.0) for name in names]
    found = run_draws(measured, cases, 4, 1, 0, quick=True)
    return {case.way: np.array([one.utilisation for (one,) in runs]) for case, runs in found}


@pytest.mark.slow
def test_the_clock_uses_more_because_it_samples(used: dict[str, np.ndarray]) -> None:
    """Differences draw by draw; what the clock adds to sampling is less than half a point."""
    sampling, error = mean_and_error((used["continuous, sampled"] - used["continuous, crossing"]).tolist())
    assert (sampling - Z * error > 0.01).all()
    clock, error = mean_and_error((used["clock"] - used["continuous, sampled"]).tolist())
    assert (np.abs(clock) < 0.005 + Z * error).all()
    # Negative control: with that allowance sampling would be seen.
    assert (sampling > 0.005 + Z * error).all()


@pytest.mark.slow
def test_a_step_later_costs_the_clock_use(used: dict[str, np.ndarray]) -> None:
    later, error = mean_and_error((used["clock, acts a step later"] - used["clock"]).tolist())
    assert (later < Z * error).all()
    assert later[2] + Z * error[2] < 0.0
