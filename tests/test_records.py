"""Records reach compiled code as one pointer, and hold there what they hold in Python."""

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt
import pytest

from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


@record
class Inner(NamedTuple):
    values: FloatArray
    key: tuple[int, float]
    weight: float


@record
class Outer(NamedTuple):
    inner: Inner
    negative: bool
    counts: npt.NDArray[np.int64]
    table: FloatArray


compiled = numba.njit(error_model="numpy", _nrt=False)


@compiled  # type: ignore[untyped-decorator]
def _weighted(inner: Inner, place: int) -> float:
    inner.values[place] *= inner.weight
    return float(inner.values[place])


@compiled  # type: ignore[untyped-decorator]
def _work(outer: Outer) -> float:
    total, first, second = 0.0, *outer.inner.key
    for i in range(outer.inner.values.shape[0]):
        # A store that might be to the record itself, for all that a compiler knows.
        outer.counts[0] += 1
        total += _weighted(outer.inner, i) + outer.table[1, i]
    return -total * first + second if outer.negative else total


def _record(negative: bool) -> Outer:
    inner = Inner(np.arange(5.0), (3, 0.5), 1.5)
    return Outer(inner, negative, np.zeros(1, dtype=np.int64), np.arange(10.0).reshape(2, 5))


@pytest.mark.parametrize("negative", [False, True])
def test_compiled_code_reads_and_writes_what_a_record_holds(negative: bool) -> None:
    outer, plain = _record(negative), _record(negative)
    assert _work(outer) == _work.py_func(plain)
    assert outer.counts[0] == 5
    assert np.array_equal(outer.inner.values, 1.5 * np.arange(5.0))


def test_a_record_is_handed_over_as_one_pointer() -> None:
    _work(_record(False))
    kind = numba.typeof(_record(False))
    context = _work.targetctx
    assert context.get_argument_type(kind).is_pointer
    # The kind of every field belongs to the type, so other fields are compiled anew.
    assert numba.typeof(_record(True)) == kind
    assert numba.typeof(_record(False)._replace(table=np.zeros((2, 5), dtype=np.float32))) != kind


def test_an_unknown_field_is_refused_when_it_is_compiled() -> None:
    @compiled  # type: ignore[untyped-decorator]
    def ask(outer: Outer) -> float:
        return outer.missing  # type: ignore[attr-defined,no-any-return]

    with pytest.raises(numba.core.errors.TypingError, match="missing"):
        ask(_record(False))
