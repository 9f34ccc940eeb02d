"""Replications of any function of a seed, for what no scenario file can say: paired, shared out, resumed."""

import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, as_completed
from contextlib import ExitStack, contextmanager
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from aimd_des._version import RESULT_VERSION
from aimd_des.study.fingerprint import fingerprint
from aimd_des.study.locks import LOCK, alone
from aimd_des.study.outcomes import decoded, encoded
from aimd_des.study.seal import read_sealed, write_sealed
from aimd_des.study.workers import Processes
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.folders import check_folder
from aimd_des.utils.validation import FloatArray
from aimd_des.utils.whole_files import is_left, sweep_left, write_file

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
    """Call every job with the same seeds, so that jobs share their random numbers and differences are paired.

    Parameters
    ----------
    jobs : sequence of callable
        Each takes a seed.  To be kept or shared, a job is a function of a module or a `functools.partial` of
        one, its arguments can be pickled.
    replications : int
        Number of seeds, at least 1.
    seed : int
        The first seed, at least 0.
    workers : int, optional
        Number of processes; default: as many as there are processors.
    out : path, optional
        Folder of the outcomes; what is there is not called again.  Then outcomes are data: numbers, strings,
        arrays of them, and lists, tuples, mappings, NamedTuples and frozen dataclasses of such.

    Returns
    -------
    list of list
        The outcomes of each job, one a seed.

    Raises
    ------
    InputError
        If a number is out of range, a job cannot be kept or shared, an outcome is no data, or the folder is
        not of a study, in use, or damaged.
    SimulationError
        If a worker process dies.

    Notes
    -----
    A folder has one JSON file a call, with a checksum.  Its key is made of the job's name, arguments and
    source (with all of one's own that it refers to), the seed, and the version of results. Where one of
    them changes, the job is called again.  Reading a folder runs no code of it.
    """
    replications = validation.integer("replications", replications, low=1)
    seed = validation.integer("seed", seed, low=0)
    many = validation.integer("workers", (os.cpu_count() or 1) if workers is None else workers, low=1)
    numbers = range(seed, seed + replications)
    calls = [(job, number) for job in jobs for number in numbers]
    if out is not None or many > 1:
        for job in jobs:
            _check(job)
    with ExitStack() as stack:
        kept = None if out is None else stack.enter_context(_taken(Path(out)))
        names = [] if kept is None else [name for job in jobs for name in _names(job, numbers)]
        found: dict[int, _Outcome] = {}
        if kept is not None:
            found = {place: _read(kept, name) for place, name in enumerate(names) if (kept / name).is_file()}
        missing = [place for place in range(len(calls)) if place not in found]

        def take(place: int, outcome: _Outcome) -> None:
            if kept is not None:
                content = encoded(outcome)
                write_sealed(kept, names[place], content)
                outcome = decoded(content)  # so that what is new has the form of what is read
            found[place] = outcome

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


def _check(job: Callable[[int], Any]) -> None:
    """Refuse a job that cannot be sent to a process, nor known again: one without a name, say."""
    try:
        pickle.dumps(job, protocol=5)
    except Exception as error:  # noqa: BLE001 - arguments of others may raise anything
        allowed = f"a function of a module, or a partial of one, with data for arguments ({error})"
        raise InputError.of("job", job, allowed) from None


@contextmanager
def _taken(folder: Path) -> Iterator[Path]:
    """Keep a folder that is ours for this process; it is made if there is none."""
    if not (folder / _MARK).is_file():
        # What a process that was killed before it wrote the mark has left is no reason to refuse.
        held = [path.name for path in folder.iterdir()] if folder.is_dir() else [""]
        if any(name != LOCK and not is_left(name) for name in held):
            check_folder(folder, overwrite=False)
        folder.mkdir(parents=True, exist_ok=True)
    with alone(folder):
        sweep_left(folder)
        write_file(folder / _MARK, b"Outcomes of aimd_des.study.replicate, by job and seed.\n")
        yield folder


def _names(job: Callable[[int], Any], seeds: Iterable[int]) -> list[str]:
    """Name the file of each outcome by what is called: its name, source and arguments, and the seed."""
    named: Any = job
    while isinstance(named, partial):
        named = named.func
    name = getattr(named, "__module__", None), getattr(named, "__qualname__", type(named).__qualname__)
    whole = fingerprint(job)
    digests = [sha256(repr((name, whole, seed, RESULT_VERSION)).encode()).hexdigest() for seed in seeds]
    return [f"{digest[:32]}.json" for digest in digests]


def _read(folder: Path, name: str) -> Any:
    remedy = "remove it, and call again"
    content, sealed = read_sealed(folder, name, remedy)
    try:
        if not sealed:
            raise ValueError("it has no checksum")
        return decoded(content)
    except Exception as error:  # noqa: BLE001 - any error that damage causes
        raise InputError(f"{folder / name}: cannot be read ({error}); {remedy}") from None


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
    For a measure that takes the random error of single runs for a deviation, such as a distance from an
    optimum. The mean of the measures would never be 0; the measure of the mean tends to the deviation
    without random error.
    """
    stack, count = np.stack([np.asarray(value, dtype=np.float64) for value in values]), len(values)
    whole = np.asarray(measure(stack.mean(axis=0)), dtype=np.float64)
    if count == 1:
        return whole, np.full_like(whole, np.nan)
    parts = np.stack([measure(np.delete(stack, out, axis=0).mean(axis=0)) for out in range(count)])
    return whole, np.sqrt((count - 1) / count * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))
