"""Replications of any function of a seed, for what no scenario file can say: paired, shared out, resumed."""

import hashlib
import os
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from aimd_des._version import RESULT_VERSION
from aimd_des.study.seal import write_file
from aimd_des.study.workers import Processes
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.folders import check_folder
from aimd_des.utils.validation import FloatArray

__all__ = ["jackknife", "mean_and_error", "replicate"]

_Outcome = TypeVar("_Outcome")
_Call = tuple[Callable[[int], _Outcome], int]

#: The file by which a folder is recognised as one of outcomes.
_MARK = "replications.txt"


def replicate(
    jobs: Sequence[Callable[[int], _Outcome]],
    replications: int,
    seed: int = 0,
    *,
    workers: int | None = None,
    out: str | Path | None = None,
) -> list[list[_Outcome]]:
    """Call every job with the same seeds, so that jobs share their luck and differences are paired.

    Notes
    -----
    Outcomes are kept by `pickle`, which runs what it reads: give only folders of your own.  They are
    recognised by name and arguments of the job, the seed and the version of results; who changes the
    code of a job removes the folder.
    """
    replications = validation.integer("replications", replications, low=1)
    seed = validation.integer("seed", seed, low=0)
    many = validation.integer("workers", (os.cpu_count() or 1) if workers is None else workers, low=1)
    calls = [(job, number) for job in jobs for number in range(seed, seed + replications)]
    files = None if out is None else _files(Path(out), calls)
    found: dict[int, _Outcome] = {}
    if files is not None:
        found = {place: _read(file) for place, file in enumerate(files) if file.is_file()}
    missing = [place for place in range(len(calls)) if place not in found]

    def take(place: int, outcome: _Outcome) -> None:
        found[place] = outcome
        if files is not None:
            write_file(files[place], pickle.dumps(outcome, protocol=5))

    if many == 1:
        for place in missing:
            job, number = calls[place]
            take(place, job(number))
    elif missing:
        _share(calls, missing, many, take)
    outcomes = [found[place] for place in range(len(calls))]
    return [outcomes[first : first + replications] for first in range(0, len(calls), replications)]


def _share(
    calls: list[_Call[_Outcome]], missing: list[int], workers: int, take: Callable[[int, _Outcome], None]
) -> None:
    """Call what is missing in processes, and take every outcome as it comes."""
    with Processes(workers) as pool:
        executor = pool.start(min(workers, len(missing)))
        try:
            waiting = {executor.submit(calls[place][0], calls[place][1]): place for place in missing}
            for future in as_completed(waiting):
                take(waiting[future], future.result())
        except BrokenExecutor as error:
            raise SimulationError(f"a worker process died: out of memory, or killed ({error})") from None
        finally:
            pool.stop(executor)


def _files(folder: Path, calls: list[_Call[_Outcome]]) -> list[Path]:
    """Name the file of each outcome, in a folder that is ours."""
    if not (folder / _MARK).is_file():
        check_folder(folder, overwrite=False, mark=_MARK)
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / _MARK, b"Outcomes of aimd_des.study.replicate, by job and seed.\n")
    files = []
    for job, number in calls:
        try:
            words = pickle.dumps((job, number, RESULT_VERSION), protocol=5)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            allowed = f"a function of a module, or a partial of one ({error})"
            raise InputError.of("job", job, allowed) from None
        files.append(folder / f"{hashlib.sha256(words).hexdigest()[:32]}.pickle")
    return files


def _read(file: Path) -> Any:
    try:
        return pickle.loads(file.read_bytes())  # noqa: S301 - the caller answers for the folder
    except Exception as error:  # noqa: BLE001 - damaged pickles raise anything
        raise InputError(f"{file}: cannot be read ({error}); remove it, and call again") from None


def mean_and_error(values: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Estimate the mean of numbers, or of arrays element by element, and its standard error.

    Parameters
    ----------
    values : array_like, shape (r, ...)
        One number, or array of numbers, a replication.

    Returns
    -------
    mean, error : ndarray, shape (...)
        In the unit of the values; the error is NaN for a single replication.
    """
    table = np.asarray(values, dtype=np.float64)
    count = len(table)
    spread = table.std(axis=0, ddof=1) if count > 1 else np.full(table.shape[1:], np.nan)
    return np.asarray(table.mean(axis=0)), np.asarray(spread / np.sqrt(count))


def jackknife(
    values: Sequence[npt.ArrayLike], measure: Callable[[FloatArray], npt.ArrayLike]
) -> tuple[FloatArray, FloatArray]:
    """Measure the mean over all replications, and estimate the error of that by leaving out one at a time.

    Parameters
    ----------
    values : sequence of array_like
        One array a replication, of one shape.
    measure : callable
        Of the mean of such arrays; need not be linear.

    Returns
    -------
    value, error : ndarray
        Of the measure; the error is NaN for a single replication.

    Notes
    -----
    For a measure that takes the luck of single runs for a deviation, such as a distance from an optimum:
    the mean of the measures would never be 0, the measure of the mean tends to what is left without luck.
    """
    stack, count = np.stack([np.asarray(value, dtype=np.float64) for value in values]), len(values)
    whole = np.asarray(measure(stack.mean(axis=0)), dtype=np.float64)
    if count == 1:
        return whole, np.full_like(whole, np.nan)
    parts = np.stack([measure(np.delete(stack, out, axis=0).mean(axis=0)) for out in range(count)])
    return whole, np.sqrt((count - 1) / count * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))
