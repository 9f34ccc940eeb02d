"""Parts of kernels and kernels that are deferred, and the same bits without either."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.compiler import Flags
from numba.core.errors import TypingError

from aimd_des.utils import compiling, jit, numba_internals
from aimd_des.utils.numba_internals import are_as_expected
from aimd_des.utils.validation import FloatArray
from tests.conftest import ROOT
from tests.forks import FILE, compilers

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")

SOURCE = """
from aimd_des.utils.compiling import PARTS
from aimd_des.utils.jit import deferred, formula, kernel, routine

@formula
def line(x, y):
    return x + 0.1 * y

@kernel
def step(x, y):
    return line(x, y) / y

@routine
def walk(x, y):
    for _ in range(5):
        x = step(x, y)
    return x

@deferred
def halved(x) -> float:
    return 0.5 * x

@deferred
def rare(x, y) -> float:
    return x - y

@routine
def far(x, y):
    if y > 100.0:
        return rare(x, y)
    return halved(2.0 * walk(x, y)) + halved(x=2.0 * walk(y, x))
"""

PROGRAM = """
from compiled_here import PARTS, far, line, walk
print(PARTS, far(1.0, 3.0).hex(), walk(1.0, 3.0).hex(), line(1.0, 3.0).hex())
"""

OTHERS = {
    "as it is": "",
    "another version": "import numba; numba.__version__ = '9.9.0'",
    "other modules": "import sys; sys.modules['aimd_des.utils.numba_internals'] = None",
}


def outcome(change: str, folder: Path) -> tuple[list[str], list[str]]:
    """Words that the program prints after a change of Numba, and the functions whose code is on the disk."""
    (folder / "compiled_here.py").write_text(SOURCE, encoding="utf-8")
    (folder / "program.py").write_text(f"{change}\n{PROGRAM}", encoding="utf-8")
    done = compilers().run(FILE, "program.py", cwd=folder, NUMBA_CACHE_DIR=str(folder / "cache"))
    assert done.returncode == 0, done.stderr
    kept = {re.sub(r"compiled_here\.(\w+)-.*", r"\1", path.name) for path in folder.rglob("*.nbc")}
    return done.stdout.split(), sorted(kept)


@pytest.mark.parametrize("change", OTHERS)
def test_without_parts_the_bits_are_the_same(change: str, tmp_path: Path) -> None:
    words, kept = outcome(OTHERS[change], tmp_path)
    x, y = 1.0, 3.0
    for _ in range(5):
        x = (x + 0.1 * y) / y
    assert words[2:] == [x.hex(), (1.0 + 0.1 * 3.0).hex()]
    forth, back = x, 3.0
    for _ in range(5):
        back = (back + 0.1 * 1.0) / 1.0
    assert words[1] == (forth + back).hex()
    # Of parts, only what Python calls is on the disk; of what is deferred, only what is called.
    assert words[0] == str(change == "as it is")
    without = ["far", "halved", "rare", "step", "walk"]
    as_it_is = ["far", "halved", "walk"] if compiling.DEFERS else ["far", "walk"]
    assert kept == (as_it_is if change == "as it is" else without)


def test_the_bounds_of_numba_and_the_version_that_was_tested_make_parts() -> None:
    requirements = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "dependencies"
    ]
    (oldest,) = (re.findall(r"^numba>=([\d.]+)", one)[0] for one in requirements if one.startswith("numba"))
    (tested,) = re.findall(r"^numba==([\d.]+)$", (ROOT / "constraints.txt").read_text("utf-8"), re.MULTILINE)
    assert are_as_expected(f"{oldest}.0")
    assert are_as_expected(tested)
    assert are_as_expected(numba.__version__) == compiling.PARTS


@pytest.mark.parametrize("version", ["0.59.1", "0.69.0", "1.0.0", "unknown"])
def test_another_version_makes_no_parts(version: str) -> None:
    assert not are_as_expected(version)


def test_a_name_that_is_missing_makes_no_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(numba_internals._NAMES, Flags, ("no_compile", "not_there"))
    assert not are_as_expected("0.60.0")


@jit.kernel
def _part(x: float) -> float:
    return 2.0 * x


@jit.kernel
def _whole(x: float) -> float:
    return _part(x) + 1.0


@pytest.mark.skipif(not compiling.PARTS, reason="this Numba makes no parts")
def test_a_part_has_no_machine_code_and_cannot_be_called() -> None:
    # Not from the disk, where an earlier run may have left it: nothing would be asked of the part.
    _whole.dispatcher._cache.flush()  # type: ignore[attr-defined]
    assert _whole(1.5) == 4.0
    ((signature, compiled),) = _part.dispatcher.get_overload.__self__.overloads.items()  # type: ignore[attr-defined]
    assert signature == (numba.float64,)
    assert compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name) == 0
    with pytest.raises(KeyError):
        compiled.entry_point()
    assert _part(1.5) == 3.0  # machine code of its own, when Python asks


@jit.formula
def _add_row(one: FloatArray, other: FloatArray) -> None:
    for i in range(one.shape[0]):
        one[i] += other[i]


@jit.row_formula
def _add_separate(one: FloatArray, other: FloatArray) -> None:
    for i in range(one.shape[0]):
        one[i] += other[i]


@jit.kernel
def _adds(one: FloatArray, other: FloatArray) -> None:
    _add_row(one, other)


@jit.kernel
def _adds_separate(one: FloatArray, other: FloatArray) -> None:
    _add_separate(one, other)


@pytest.mark.skipif(not compiling.DEFERS, reason="older versions make no vectors of these loops")
@pytest.mark.parametrize(("kernel", "compares"), [(_adds, True), (_adds_separate, False)])
def test_where_arrays_lie_is_not_compared_if_they_do_not_overlap(kernel: Any, compares: bool) -> None:
    kernel.dispatcher._cache.flush()  # Numba shows no code that it has loaded from the disk
    numbers = np.arange(11.0)
    kernel(numbers, np.ones(11))
    assert numbers.tolist() == np.arange(1.0, 12.0).tolist()
    (code,) = kernel.dispatcher.inspect_llvm().values()
    assert " x double>" in code
    assert ("memcheck" in code) == compares


@jit.kernel
def _talks(x: float) -> float:
    print("x is", x)  # noqa: T201 - it calls Python
    return x


@jit.kernel
def _listens(x: float) -> float:
    return _talks(x)


@pytest.mark.skipif(not compiling.PARTS, reason="this Numba makes no parts")
def test_a_part_that_calls_python_is_refused() -> None:
    with pytest.raises(NotImplementedError, match="_talks calls Python"):
        _listens(1.0)


DEFERRED = """
from compiled_here import far, halved, rare
kernels = halved, rare
print(far(1.0, 3.0).hex(), *(len(kernel.dispatcher.overloads) for kernel in kernels), end=" ")
print(far(1.0, 300.0), *(len(kernel.dispatcher.overloads) for kernel in kernels), end=" ")
print(*(sum(kernel.dispatcher.stats.cache_misses.values()) for kernel in (far, *kernels)))
"""


@pytest.mark.skipif(not compiling.DEFERS, reason="this Numba defers nothing")
def test_what_is_deferred_is_compiled_when_it_is_first_called_and_then_comes_from_the_disk(
    tmp_path: Path,
) -> None:
    (tmp_path / "compiled_here.py").write_text(SOURCE, encoding="utf-8")
    (tmp_path / "program.py").write_text(DEFERRED, encoding="utf-8")
    told = []
    for folder in (tmp_path / "cache", tmp_path / "carried"):  # code is found wherever its folder is
        if told:
            (tmp_path / "cache").rename(folder)
        done = compilers().run(FILE, "program.py", cwd=tmp_path, NUMBA_CACHE_DIR=str(folder))
        assert done.returncode == 0, done.stderr
        told.append(done.stdout.split())
    assert told[0][1:] == ["1", "0", "-299.0", "1", "1", "1", "1", "1"]
    assert told[1][1:] == ["1", "0", "-299.0", "1", "1", "0", "0", "0"]
    assert told[0][0] == told[1][0]


@jit.deferred
def _inner(x: float) -> float:
    return 2.0 * x


@jit.shared
def _both(x: float) -> float:
    return 2.0 * x


@jit.kernel
def _ask_both(x: float) -> float:
    return _inner(x) + _both(x)


@pytest.mark.skipif(not compiling.DEFERS, reason="this Numba defers nothing")
def test_what_is_deferred_has_no_way_in_from_python_and_what_is_shared_has_one() -> None:
    assert _ask_both(1.5) == 6.0
    for deferred, expected in ((_inner, False), (_both, True)):
        (made,) = deferred.dispatcher.overloads.values()  # type: ignore[attr-defined]
        way_in = made.library.get_pointer_to_function(made.fndesc.llvm_cpython_wrapper_name)
        assert bool(way_in) == expected
    with pytest.raises(TypeError, match="_inner: only compiled code can call it"):
        _inner(1.5)
    assert _both(1.5) == 3.0


@jit.deferred
def _wrong(x: float) -> int:
    return 2.5 * x  # type: ignore[return-value]


@jit.deferred
def _broken(x: float) -> float:
    return x.missing  # type: ignore[attr-defined,no-any-return]


@jit.kernel
def _ask(x: float) -> float:
    return _wrong(x) if x > 0.0 else _broken(x)


@pytest.mark.skipif(not compiling.DEFERS, reason="this Numba defers nothing")
@pytest.mark.parametrize(
    ("x", "error", "why"), [(1.0, TypeError, "returns float64"), (-1.0, TypingError, "attribute 'missing'")]
)
def test_what_cannot_be_compiled_is_refused_where_it_is_called(
    x: float, error: type[Exception], why: str
) -> None:
    with pytest.raises(error, match=why):
        _ask(x)


@pytest.mark.skipif(not compiling.DEFERS, reason="this Numba defers nothing")
def test_compiling_can_be_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(signature: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(_interrupted.dispatcher, "compile", interrupt)
    with pytest.raises(KeyboardInterrupt):
        _ask_again(1.0)
    monkeypatch.undo()
    assert _ask_again(1.0) == 3.0


@jit.deferred
def _interrupted(x: float) -> float:
    return 3.0 * x


@jit.kernel
def _ask_again(x: float) -> float:
    return _interrupted(x)


def test_options_that_are_compared_quickly_are_equal_where_those_of_numba_are() -> None:
    settings: list[dict[str, object]] = [
        {},
        {"nrt": False},  # as if it were not set
        {"nrt": True},
        {"no_compile": True},
        {"nrt": True, "no_compile": True},
        {"nrt": True, "error_model": "numpy"},
    ]
    plain = [Flags() for _ in settings]
    for flags, setting in zip(plain, settings, strict=True):
        for name, value in setting.items():
            setattr(flags, name, value)
    quick = [numba_internals._QuickFlags(flags) for flags in plain]
    for one, same in zip(quick, plain, strict=True):
        assert hash(one) == hash(same)
        assert [one == other for other in quick] == [same == other for other in plain]
        assert [one == other for other in plain] == [other == one for other in plain]
        assert [one == other for other in plain] == [same == other for other in plain]
    assert quick[0] == quick[1] != quick[2]
    assert quick[0] != "flags"
