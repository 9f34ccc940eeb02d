"""Kernels that are called without asking for the types of their arguments."""

from typing import Any

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from aimd_des import BroadcastChannel
from aimd_des.dynamics.demand import CONTINUOUS
from aimd_des.dynamics.state import agent_parameters, start
from aimd_des.dynamics.totals import total_of, totals
from aimd_des.lowlevel import Broadcast, Purpose, key
from aimd_des.utils import numba_internals
from aimd_des.utils.direct_calls import Direct, direct
from aimd_des.utils.validation import FloatArray
from tests.conftest import random_problem

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")

DEMAND, INCREASE, ANCHOR = np.random.default_rng(0).uniform(0.0, 1.0, (3, 60))
NOW = np.array([2.0])


def locked(array: FloatArray) -> FloatArray:
    """The same numbers, which cannot be written."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy


def spread(array: FloatArray) -> FloatArray:
    """The same numbers, with others in between."""
    return np.stack([array, array + 100.0], axis=1)[:, 0]


@pytest.mark.parametrize("laid_out", [np.copy, locked, spread])
def test_each_layout_of_an_array_has_machine_code_of_its_own(laid_out: object) -> None:
    """Code for numbers that lie side by side would read those in between as well."""
    assert callable(laid_out)
    given = (DEMAND, laid_out(INCREASE), ANCHOR, NOW, CONTINUOUS)
    # One after the other, in the order of agents.
    expected = np.cumsum(DEMAND + INCREASE * (2.0 - ANCHOR))[-1]
    code = direct(total_of, *given)
    assert code(*given) == total_of(*given) == expected
    # Found again for other arrays of the same layout, which have other numbers.
    others = (ANCHOR, laid_out(DEMAND), INCREASE, NOW, CONTINUOUS)
    assert direct(total_of, *others) is code
    assert code(*others) == np.cumsum(ANCHOR + DEMAND * (2.0 - INCREASE))[-1]


def test_whole_numbers_and_fractions_have_machine_code_of_their_own() -> None:
    lines = (DEMAND, INCREASE, ANCHOR, NOW)
    codes = [direct(total_of, *lines, weight) for weight in (1, 1.0)]
    assert codes[0] is not codes[1]
    assert codes[0](*lines, 1) == codes[1](*lines, 1.0) == total_of(*lines, 1.0)


def test_another_order_of_bytes_is_another_type() -> None:
    """Arrays of both kinds have one letter and one layout; Numba has no type for what is not native."""
    given = (DEMAND.copy(), INCREASE, ANCHOR, NOW, CONTINUOUS)
    assert direct(total_of, *given)(*given) == total_of(*given)
    with pytest.raises(TypingError):
        direct(total_of, DEMAND.astype(DEMAND.dtype.newbyteorder()), *given[1:])


def test_a_link_takes_whole_numbers_and_fractions_as_departures() -> None:
    """A part of one's own may say 0; what leaves half a unit of time later arrives half a unit later."""
    link = BroadcastChannel(latency=1.0).open(3, {purpose: key(1, purpose) for purpose in Purpose})
    for number, departure in enumerate([0, 0.5, np.float32(0.25), 1e9 + 0.25]):
        arrival = link.transmit(Broadcast(0, number, departure), departure).arrival
        assert arrival.tolist() == [1.0 + float(departure)] * 3


@pytest.mark.parametrize("told_by", [numba_internals.fingerprint, None], ids=["fingerprint", "fields"])
def test_records_are_told_apart_by_the_layout_of_their_arrays(
    told_by: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kernel that is called again and again looks for other code where it is given another record."""
    monkeypatch.setattr(numba_internals, "fingerprint", told_by)
    problem, call, total = random_problem(0, 5, 2), Direct(totals), np.empty(2)
    parameters = agent_parameters(problem, CONTINUOUS)
    state = start(2, 5, CONTINUOUS, parameters)
    demand = np.arange(10.0).reshape(2, 5)
    for laid_out in (demand, np.asfortranarray(demand), locked(demand)):
        call((state._replace(demand=laid_out), parameters), np.zeros(1), CONTINUOUS, total)
        assert total.tolist() == [10.0, 35.0]
