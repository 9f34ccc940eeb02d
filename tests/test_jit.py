"""Numba is imported when a kernel is first called, and knows formulas wherever it compiles."""

import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import numba
import numpy as np
import pytest

from aimd_des.fleet import radix_heap
from aimd_des.utils import instructions, jit, portable_math, rng
from aimd_des.utils.jit import kernel
from aimd_des.utils.lanes import four_lanes, lanes_of
from aimd_des.utils.opaque import opaque
from tests.conftest import python


@kernel
def doubled(x: float) -> float:
    """Return twice a number."""
    return 2.0 * x


@kernel
def halved(x: float) -> float:
    """Return half of a number."""
    return 0.5 * x


OWN = """
import math, sys
from aimd_des.lowlevel import exp
from aimd_des.utils.rng import uniforms_row
print("numba" in sys.modules)
import numba
from numba.core import entrypoints
entrypoints._already_initialized |= {known}
@numba.njit
def power(x):
    return exp(x)
print(abs(power(1.0) - math.e) < 1e-15, uniforms_row._dispatcher)
"""
NOT_INSTALLED = "import pathlib\npathlib.Path.glob = lambda *_: iter(())\n"


@pytest.mark.parametrize("installed", [True, False])
def test_a_users_own_function_can_call_a_formula_before_any_kernel_was_called(installed: bool) -> None:
    """Numba asks the package that is installed; one that is not has taught it when it was imported."""
    program = ("" if installed else NOT_INSTALLED) + OWN.format(known=not installed)
    outcome = python("-c", program)
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stdout.split() == [str(not installed), "True", "None"]


def test_what_an_interrupt_has_kept_from_numba_is_taught_the_next_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Numba takes long enough to import for a user to stop it, who goes on in the same process."""
    taught: list[str] = []

    def stopped() -> None:
        taught.append("begun")
        if len(taught) == 2:
            raise KeyboardInterrupt

    noted = [lambda: taught.append("first"), stopped, lambda: taught.append("last")]
    monkeypatch.setattr(jit, "_noted", noted)
    with pytest.raises(KeyboardInterrupt):
        jit.teach_numba()
    for _ in range(2):
        jit.teach_numba()
        assert taught == ["first", "begun", "begun", "last"]
    jit.note(lambda: taught.append("at once"))
    assert taught[-1] == "at once"


@pytest.mark.parametrize("after", [True, False])
def test_folders_that_may_not_be_entered_are_passed_over(
    after: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python imports past a folder of its path that is another user's, and the package is found behind it."""
    entered = Path.glob

    def refusing(self: Path, pattern: str) -> Any:
        if self.name == "another's":
            raise PermissionError(13, "Permission denied")
        return entered(self, pattern)

    monkeypatch.setattr(Path, "glob", refusing)
    found = jit._is_found_by_numba()
    monkeypatch.setattr(sys, "path", [*sys.path, "another's"] if after else ["another's", *sys.path])
    assert jit._is_found_by_numba() == found


def test_calls_go_to_machine_code_without_a_function_between() -> None:
    assert doubled.__call__.__name__ == "_first_call"
    assert doubled(1.5) == 3.0
    assert doubled.__call__ is doubled.dispatcher  # type: ignore[attr-defined]
    assert (doubled.__name__, doubled.__doc__) == ("doubled", "Return twice a number.")


def test_a_kernel_is_pickled_by_its_name() -> None:
    assert pickle.loads(pickle.dumps(rng.uniforms_row)) is rng.uniforms_row


def test_threads_that_call_a_kernel_first_make_it_once() -> None:
    begin = Barrier(4)

    def call(x: float) -> Any:
        begin.wait()
        return halved(x), halved.dispatcher  # type: ignore[attr-defined]

    with ThreadPoolExecutor(4) as pool:
        values, dispatchers = zip(*pool.map(call, [1.0, 2.0, 3.0, 4.0]), strict=True)
    assert values == (0.5, 1.0, 1.5, 2.0)
    assert len(set(map(id, dispatchers))) == 1


split, power, floor = portable_math._split_normal, portable_math._power_of_two, portable_math._floor
wide, highest, bits, time = (
    rng._multiply_wide,
    radix_heap._highest_bit,
    radix_heap.bits_of,
    radix_heap.time_of,
)


def side_by_side(number: float) -> tuple[float, float, float, float]:
    one, other = four_lanes(number, -number, 0.3, -0.0), four_lanes(0.1, number, number + 1.0, 0.0)
    return lanes_of((one * other - 0.1) * number + (number * (0.7 + one) - other * (number - one)))


def all_instructions(number: float, word: int, one: np.uint64, other: np.uint64) -> Any:
    of_numbers = split(number), power(floor(8.0 * number)), bits(number), time(bits(number)), bits(-0.0)
    return of_numbers, highest(word), highest(0), wide(one, other), opaque(word), opaque(one)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_instructions_do_what_the_functions_do_that_they_replace() -> None:
    doubled(1.0)  # has Numba taught
    compiled, lanes = numba.njit(all_instructions), numba.njit(side_by_side)
    draws = np.random.default_rng(0)
    for _ in range(1000):
        number, word = (
            float(draws.gamma(0.1)) + 1e-300,
            int(draws.integers(1, 2**62)) >> int(draws.integers(62)),
        )
        words = draws.integers(0, 2**64, 2, dtype=np.uint64)
        assert compiled(number, word, *words) == all_instructions(number, word, *words)
        assert lanes(number) == side_by_side(number)
    used = (split, power, floor, wide, highest, bits, time, opaque, four_lanes, lanes_of)
    assert {function.__name__.lstrip("_") for function in used} == instructions._BUILT.keys()
