"""How much memory a run takes for each agent."""

from pathlib import Path

import numba
import numpy as np
import pytest

from aimd_des import PolynomialCosts
from aimd_des.utils.spare_arrays import spare_zeros


def in_use() -> int:
    """How much memory this process takes now, in bytes."""
    fields = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * next(int(line.split()[1]) for line in fields if line.startswith("VmRSS:"))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not tell")
def test_powers_that_no_agent_has_take_no_memory() -> None:
    n = 100_000
    coefficients = np.ones((n, 1, 2))
    before = in_use()
    costs = PolynomialCosts([1, 64], coefficients)
    table = costs.table()
    # Two rows of 64 are written.  Half of all rows is so far from both two and 64 that nothing else matters.
    assert in_use() - before < 8 * 32 * n
    assert np.shares_memory(table.slopes, costs.slopes)
    assert (table.slopes[0, 0] == 1.0).all()
    assert (table.slopes[0, 63] == 64.0).all()
    assert not table.slopes[0, 1:63].any()
    # What is read takes no memory either.
    assert in_use() - before < 8 * 32 * n


def test_zeros_can_be_written_wherever_they_come_from() -> None:
    for shape in ((2, 3), (3, 200_001)):
        zeros = spare_zeros(shape)
        assert not zeros.any()
        zeros[-1, 1:] = 7.0
        assert zeros.sum() == 7.0 * (shape[1] - 1)
        # The type by which compiled code knows an array.
        assert numba.typeof(zeros) == numba.typeof(np.zeros(shape))
