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


@record
class Arrays(NamedTuple):
    line: FloatArray
    table: FloatArray
    block: npt.NDArray[np.int16]
    strided: FloatArray
    turned: FloatArray
    empty: FloatArray


@compiled  # type: ignore[untyped-decorator]
def _describe(arrays: Arrays, out: FloatArray) -> float:
    line, table, block, strided, turned = (
        arrays.line,
        arrays.table,
        arrays.block,
        arrays.strided,
        arrays.turned,
    )
    out[0], out[1], out[2] = line.size, table.size, block.size
    out[3], out[4], out[5] = line.itemsize, block.itemsize, turned.itemsize
    out[6], out[7], out[8] = line.strides[0], table.strides[0], table.strides[1]
    out[9], out[10], out[11] = block.strides[0], block.strides[1], block.strides[2]
    out[12], out[13], out[14] = strided.strides[0], turned.strides[0], turned.strides[1]
    out[15], out[16], out[17] = block.shape[0], block.shape[1], block.shape[2]
    row, column = table[1], table[:, 1]
    out[18], out[19], out[20] = row[2], column[2], block[1, 2, 3]
    out[21], out[22], out[23] = strided[1], turned[2, 1], arrays.empty.size
    return out[0]


def test_compiled_code_knows_the_form_of_arrays_in_a_record() -> None:
    numbers = np.arange(24.0)
    arrays = Arrays(
        numbers[:7],
        numbers[:12].reshape(3, 4),
        np.arange(24, dtype=np.int16).reshape(2, 3, 4),
        numbers[::3],
        numbers.reshape(4, 6).T,
        np.zeros((0, 4)),
    )
    found, expected = np.full(24, np.nan), np.full(24, np.nan)
    _describe(arrays, found)
    _describe.py_func(arrays, expected)
    assert np.array_equal(found, expected)
