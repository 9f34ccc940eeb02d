"""Replications of functions: paired, the same however they are shared, kept and resumed; their statistics."""

import importlib
import linecache
import os
import shutil
import signal
import struct
import sys
from dataclasses import dataclass
from functools import partial
from operator import is_
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from aimd_des.study import jackknife, mean_and_error, replicate
from aimd_des.study.locks import alone
from aimd_des.study.outcomes import decoded, encoded
from aimd_des.utils.errors import InputError, SimulationError
from scenarios.common.systems import memory_alone
from tests.conftest import python


def square(seed: int) -> float:
    return float(seed**2)


def half(seed: int) -> float:
    return 0.5 * seed


def noted(folder: Path, stop_at: int, seed: int) -> int:
    """Note every call in a file, and fail at one."""
    if seed == stop_at:
        raise OSError("interrupted")
    with (folder / "calls").open("a", encoding="utf-8") as file:
        file.write(f"{seed}\n")
    return 10 * seed


@dataclass(frozen=True)
class Record:
    value: float
    parts: Any
    check: bool = True

    def __post_init__(self) -> None:
        if self.check and self.value < 0.0:
            raise ValueError("negative")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Record) and (self.value, self.parts) == (other.value, other.parts)

    __hash__ = None  # type: ignore[assignment]


class Pair(NamedTuple):
    one: Any
    two: Any = None


class Open:
    """A class that is no record."""


def everything(seed: int) -> Pair:
    """Give one of all that can be kept, with numbers that text is apt to change."""
    draws = np.random.default_rng(seed)
    table = draws.normal(size=(3, 4))
    hard = [0.1 + 0.2, -0.0, np.nan, -np.inf, 5e-324, 1.7976931348623157e308, float(table[0, 0])]
    numbers = {"hard": hard, 3: 2**80, True: None, 0.5: 1 - 2j, "é\n\ud800": "é\n\ud800"}
    arrays = (
        table,
        np.asfortranarray(table),
        table[:, 1],
        table[::2, ::-1],
        np.empty((0, 3)),
        np.array(seed, dtype=np.int16),
        np.array([np.nan, -np.nan, -0.0]),
        np.array(["a", "Ω"]),
        np.array([True, False]),
        np.array(["2026-11-29"], dtype="datetime64[ns]"),
        table.astype("<f4"),
    )
    scalars = [np.float64(np.nan), np.int32(-1), np.bool_(True), np.str_("x"), np.complex64(1j)]
    return Pair(Record(float(seed), arrays), Pair(numbers, scalars))


def bits(value: Any) -> Any:
    """Take a value apart into types and bytes."""
    kind = type(value).__name__
    if isinstance(value, np.ndarray | np.generic):
        order = np.asarray(value).flags.f_contiguous and not np.asarray(value).flags.c_contiguous
        return kind, value.dtype.str, value.shape, order, value.tobytes()
    if isinstance(value, dict):
        return kind, [(key, bits(part)) for key, part in value.items()]
    if isinstance(value, list | tuple):
        return kind, [bits(part) for part in value]
    if isinstance(value, Record):
        return kind, bits(vars(value))
    return kind, struct.pack("<d", value) if isinstance(value, float) else repr(value)


def outcomes(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.json"))


REMEMBERED: list[Any] = []


def remembered(place: int, seed: int) -> Any:
    return REMEMBERED[place]


def dying(folder: Path, seed: int) -> Pair:
    """Kill the process at every third call, unless there is calm."""
    if not (folder / "calm").exists() and seed % 3 == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return everything(seed)


def killed(seed: int) -> int:
    os._exit(seed)


def test_jobs_have_consecutive_seeds_and_share_them() -> None:
    assert replicate([square, half], 3, seed=4, workers=1) == [[16.0, 25.0, 36.0], [2.0, 2.5, 3.0]]


@pytest.mark.slow
def test_a_pool_gives_the_same_in_the_same_order() -> None:
    assert replicate([square, half], 3, seed=4, workers=2) == [[16.0, 25.0, 36.0], [2.0, 2.5, 3.0]]


@pytest.mark.slow
def test_a_worker_that_dies_is_said_so() -> None:
    with pytest.raises(SimulationError, match="worker process died"):
        replicate([killed], 2, seed=1, workers=2)


def test_what_is_there_is_not_called_again(tmp_path: Path) -> None:
    out = tmp_path / "kept"
    (tmp_path / "calls").touch()
    stopped, whole = partial(noted, tmp_path, 7), partial(noted, tmp_path, -1)
    with pytest.raises(OSError, match="interrupted"):
        replicate([stopped], 4, seed=5, workers=1, out=out)
    assert len(outcomes(out)) == 2
    for _ in range(2):
        assert replicate([whole], 4, seed=5, workers=1, out=out) == [[50, 60, 70, 80]]
    # Another argument is another job: all of its four are called, and called once.
    assert (tmp_path / "calls").read_text().split() == ["5", "6", "5", "6", "7", "8"]


def test_outcomes_are_recognised_by_another_process(tmp_path: Path) -> None:
    job = partial(is_, memory_alone())
    assert replicate([job], 1, workers=1, out=tmp_path) == [[False]]
    program = (
        "from functools import partial; from operator import is_; from aimd_des.study import replicate;"
        "from scenarios.common.systems import memory_alone;"
        f"replicate([partial(is_, memory_alone())], 1, workers=1, out={str(tmp_path)!r})"
    )
    done = python("-c", program)
    assert done.returncode == 0, done.stderr
    assert len(outcomes(tmp_path)) == 1


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_what_is_resumed_is_what_is_new_to_the_bit(workers: int, tmp_path: Path) -> None:
    fresh = replicate([everything], 3, seed=1, workers=1)
    kept = [replicate([everything], 3, seed=1, workers=workers, out=tmp_path / "kept") for _ in range(2)]
    assert bits(kept[0]) == bits(kept[1]) == bits(fresh)
    outcomes(tmp_path / "kept")[1].unlink()
    assert bits(replicate([everything], 3, seed=1, workers=workers, out=tmp_path / "kept")) == bits(fresh)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_who_is_killed_goes_on_where_he_was(workers: int, tmp_path: Path) -> None:
    out = tmp_path / "kept"
    program = (
        "from functools import partial; from pathlib import Path; from aimd_des.study import replicate;"
        "from tests.test_study_replicate import dying;"
        f"replicate([partial(dying, Path({str(tmp_path)!r}))], 6, workers={workers}, out={str(out)!r})"
    )
    assert python("-c", program).returncode != 0
    done = len(outcomes(out))
    assert 1 <= done < 6
    (out / f".x.json.{'0' * 32}.tmp").write_bytes(b"half")
    (tmp_path / "calm").touch()
    assert bits(replicate([partial(dying, tmp_path)], 6, workers=workers, out=out)) == bits(
        [[everything(seed) for seed in range(6)]]
    )
    assert not list(out.glob("*.tmp"))
    assert len(outcomes(out)) == 6


def test_an_outcome_is_held_against_its_checksum(tmp_path: Path) -> None:
    replicate([square], 1, workers=1, out=tmp_path)
    (file,) = outcomes(tmp_path)
    whole = file.read_bytes()
    for place in range(0, len(whole), 3):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(InputError, match=r"\.json: .*remove it, and call again"):
            replicate([square], 1, workers=1, out=tmp_path)
    for cut in (0, 1, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"\.json: .*remove it, and call again"):
            replicate([square], 1, workers=1, out=tmp_path)
    file.unlink()
    assert replicate([square], 1, workers=1, out=tmp_path) == [[0.0]]


def test_changed_code_of_a_job_is_called_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    source, out = tmp_path / "jobs_of_mine.py", tmp_path / "kept"
    text = "FACTOR = 2\n\ndef helper(x):\n    return FACTOR * x\n\ndef job(seed):\n    return helper(seed)\n"
    found = []
    for one, other in (("", ""), ("# said\n", ""), ("FACTOR = 2", "FACTOR = 3"), ("* x", "* x + 1")):
        text = text.replace(one, other) if other else one + text
        source.write_text(text)
        monkeypatch.delitem(sys.modules, "jobs_of_mine", raising=False)
        importlib.invalidate_caches()
        linecache.clearcache()
        shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
        found.append(replicate([importlib.import_module("jobs_of_mine").job], 1, 5, workers=1, out=out)[0][0])
    monkeypatch.delitem(sys.modules, "jobs_of_mine")
    assert found == [10, 10, 15, 16]
    assert len(outcomes(out)) == 3


@pytest.mark.parametrize(
    "outcome", [{1}, b"x", object(), [np.array([None])], {"a": (1, {(1, 2): 3})}, Open()]
)
def test_what_is_no_data_is_refused_with_the_first_outcome(outcome: Any, tmp_path: Path) -> None:
    job = partial(remembered, len(REMEMBERED))
    REMEMBERED.append(outcome)
    with pytest.raises(InputError, match="outcome"):
        replicate([job], 2, workers=1, out=tmp_path / "kept")
    assert outcomes(tmp_path / "kept") == []
    assert replicate([job], 2, workers=1) == [[outcome, outcome]]


def test_the_order_of_bytes_stays() -> None:
    # Sent from a worker it would not: NumPy turns it when it pickles.
    value = np.arange(3.0).astype(">f4")
    assert bits(decoded(encoded(value))) == bits(value)


def test_the_place_of_what_is_no_data_is_said() -> None:
    with pytest.raises(InputError, match=r"outcome\.parts\[1\]\['a'\]"):
        encoded(Record(0.0, (1, {"a": {2}})))


def test_reading_calls_nothing_and_imports_nothing() -> None:
    content = encoded(Record(1.0, ()))
    assert decoded(content) == Record(1.0, ())
    for name in ("os:system", "wave:Wave_read", "builtins:dict", f"{__name__}:Open", f"{__name__}:missing"):
        sys.modules.pop("wave", None)
        with pytest.raises(ValueError, match="no record"):
            decoded(content.replace(f"{__name__}:Record".encode(), name.encode()))
        assert "wave" not in sys.modules
    for one, other in ((b'"value"', b'"other"'), (b'"outcome"', b'"income"'), (b'"tuple"', b'"set"')):
        with pytest.raises((ValueError, KeyError)):
            decoded(content.replace(one, other))
    assert decoded(content.replace(b"1.0", b"-1.0")) == Record(-1.0, (), check=False)  # no constructor
    array = encoded(np.arange(3.0))
    for one, other in ((b"<f8", b"|O"), (b"<f8", b"<f4"), (b"3", b"4"), (b'"C"', b'"A"'), (b"AAAA", b"?AAA")):
        with pytest.raises((ValueError, TypeError)):
            decoded(array.replace(one, other, 1))


def test_a_folder_that_another_process_has_is_refused(tmp_path: Path) -> None:
    replicate([square], 1, workers=1, out=tmp_path)
    with alone(tmp_path), pytest.raises(InputError, match="no other"):
        replicate([square], 1, workers=1, out=tmp_path)


def test_a_folder_of_something_else_and_a_job_without_a_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(InputError, match="output folder"):
        replicate([square], 1, workers=1, out=tmp_path)
    opened: Any = (tmp_path / "mine.txt").open()
    with opened:
        jobs: list[Any] = [lambda seed: seed, partial(killed, opened), partial(pow, (n for n in "ab"))]
        for job in jobs:
            for how in ({"workers": 1, "out": tmp_path / "new"}, {"workers": 2}):
                with pytest.raises(InputError, match="job"):
                    replicate([square, job], 1, **how)
    assert not (tmp_path / "new").exists()
    # A process that was killed before its mark was written leaves no more than this.
    (tmp_path / "left").mkdir()
    (tmp_path / "left" / ".lock").touch()
    (tmp_path / "left" / f".replications.txt.{'0' * 32}.tmp").touch()
    assert replicate([square], 1, workers=1, out=tmp_path / "left") == [[0.0]]


@pytest.mark.parametrize(("name", "number"), [("replications", 0), ("seed", -1), ("workers", 0)])
def test_numbers_out_of_range_are_refused(name: str, number: int) -> None:
    given: Any = {"replications": 1, "seed": 0, "workers": 1, name: number}
    with pytest.raises(InputError, match=name):
        replicate([square], **given)


def test_means_errors_and_the_jackknife_of_a_mean() -> None:
    values = np.array([[1.0, 2.0], [3.0, 2.0], [8.0, 2.0]])
    mean, error = mean_and_error(values)
    assert mean.tolist() == [4.0, 2.0]
    assert error == pytest.approx([np.std([1, 3, 8], ddof=1) / np.sqrt(3), 0.0])
    again, jackknifed = jackknife(list(values), lambda mean: mean)
    assert again == pytest.approx(mean)
    assert jackknifed == pytest.approx(error)
    assert np.isnan(mean_and_error(values[:1])[1]).all()
    assert np.isnan(jackknife([values[0]], lambda mean: mean)[1]).all()
