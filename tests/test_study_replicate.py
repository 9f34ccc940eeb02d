"""Replications of functions: paired, the same however they are shared, kept and resumed; their statistics."""

import os
from functools import partial
from operator import is_
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des.study import jackknife, mean_and_error, replicate
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
    assert [path.suffix for path in sorted(out.iterdir())].count(".pickle") == 2
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
    assert len(list(tmp_path.glob("*.pickle"))) == 1


def test_a_folder_of_something_else_and_a_job_without_a_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(InputError, match="output folder"):
        replicate([square], 1, workers=1, out=tmp_path)
    with pytest.raises(InputError, match="job"):
        replicate([lambda seed: seed], 1, workers=1, out=tmp_path / "new")
    replicate([square], 1, workers=1, out=tmp_path / "other")
    (damaged,) = (tmp_path / "other").glob("*.pickle")
    damaged.write_bytes(b"\x80")
    with pytest.raises(InputError, match="cannot be read"):
        replicate([square], 1, workers=1, out=tmp_path / "other")


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
