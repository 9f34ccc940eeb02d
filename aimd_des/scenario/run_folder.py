"""The folder of a run: scenario, summary and frames, written whole or not at all, and then its figures."""

import json
import os
import platform
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aimd_des._version import __version__
from aimd_des.results.frames import categorical, safe_names
from aimd_des.results.result import Result
from aimd_des.scenario.scenario import Scenario
from aimd_des.utils.checksums import checksum, checksums_of, read_checksums, write_checksums
from aimd_des.utils.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Place", "check_folder", "library_versions", "new_folder", "write_run"]

#: The file by which a folder is recognised as one that this program wrote.
PROVENANCE = "run.json"
_DPI = 160
_LIBRARIES = ("numpy", "scipy", "numba", "simpy", "pandas")


@dataclass(frozen=True)
class Place:
    """Where results shall go, and what was there before anything ran: only that may be replaced.

    Attributes
    ----------
    folder : Path
        As the user names it.
    target : Path
        The same without links.
    held : mapping of str to tuple of int
        What earlier results consist of: for each file and folder by which it is known again.
    """

    folder: Path
    target: Path
    held: Mapping[str, tuple[int, ...]]


def check_folder(folder: Path, *, overwrite: bool, mark: str = PROVENANCE) -> Place:
    """Refuse a folder that cannot be written, before anything runs.

    Parameters
    ----------
    folder : Path
        Where results shall go.
    overwrite : bool
        Whether earlier results may be replaced.
    mark : str
        The file by which a folder is recognised as one that this program wrote.

    Returns
    -------
    Place
        What `new_folder` and `write_run` take.

    Raises
    ------
    InputError
        If it is a file, holds something that may not be replaced, or cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError.of("output folder", str(folder), "a folder", "it is a file; choose another name")
    target = folder.resolve()
    held = _contents(target) if target.is_dir() else {}
    if held and not overwrite:
        raise InputError.of(
            "output folder", str(folder), "new or empty", "choose another, or say --overwrite"
        )
    if held and not (folder / mark).is_file():
        raise InputError.of(
            "output folder",
            str(folder),
            "one that this program wrote",
            f"it has no {mark}; remove it yourself",
        )
    above = next(path for path in target.parents if path.exists())
    try:
        with tempfile.TemporaryDirectory(prefix=".writable", dir=above):
            pass
    except OSError as error:
        raise InputError(f"output folder {str(folder)!r}: cannot be written ({error.strerror})") from None
    return Place(folder, target, held)


def _contents(folder: Path) -> dict[str, tuple[int, ...]]:
    """List what is below a folder, with what changes when a file is replaced or written again."""
    found: dict[str, tuple[int, ...]] = {}
    for above, folders, files in os.walk(folder, onerror=_raise):
        for name in folders:
            path = Path(above, name)
            found[str(path.relative_to(folder))] = (path.lstat().st_ino,)
        for name in files:
            path = Path(above, name)
            now = path.lstat()
            found[str(path.relative_to(folder))] = (now.st_ino, now.st_size, now.st_mtime_ns)
    return found


def _raise(error: OSError) -> None:
    raise error


@contextmanager
def new_folder(place: Place) -> Iterator[Path]:
    """Give a temporary folder that takes its place once its block has ended well.

    What has come to that place since it was checked stays there: the new folder then gets a name beside it.

    Parameters
    ----------
    place : Place
        As `check_folder` has found it.

    Yields
    ------
    Path
        The temporary folder.

    Raises
    ------
    InputError
        If the place has been taken meanwhile; it says where the folder is.
    """
    target = place.target
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    try:
        _take_place(temporary, place)
    except OSError as failure:
        kept = temporary.rename(temporary.with_name(temporary.name.removeprefix(".")))
        why = "something has come there" if isinstance(failure, _TakenError) else failure.strerror
        raise InputError(
            f"output folder {str(place.folder)!r}: cannot be replaced any more ({why}) and was left alone; "
            f"what was to be written there is in {str(place.folder.with_name(kept.name))!r}"
        ) from None


class _TakenError(OSError):
    """A place holds something that was not there when it was checked."""


def _take_place(temporary: Path, place: Place) -> None:
    """Put one folder where another may be; if that fails, the other is there again."""
    target = place.target
    if not place.held:
        _rename(temporary, target)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.old.", dir=target.parent))
    try:
        old = target.rename(aside / target.name)
    except BaseException:
        aside.rmdir()
        raise
    # Nobody finds it there, so that what is seen now is what is removed.
    try:
        if _contents(old) != place.held:
            raise _TakenError
        _rename(temporary, target)
    except BaseException:
        try:
            _rename(old, target)
            aside.rmdir()
        except OSError:  # others have come there in between
            warnings.warn(f"{old}: holds what was at {place.folder} before", RuntimeWarning, stacklevel=4)
        raise
    _remove(old, place.held)


def _rename(folder: Path, target: Path) -> None:
    """Rename a folder; nothing but an empty folder may have its new name."""
    with suppress(OSError):
        target.rmdir()  # of an empty folder: not every system renames over it
    try:
        folder.rename(target)
    except OSError as failure:
        if os.path.lexists(target):
            raise _TakenError from failure
        raise


def _remove(folder: Path, held: Mapping[str, tuple[int, ...]]) -> None:
    """Remove what a folder is known to hold, and nothing else, and the folder above it."""
    try:
        for name in sorted(held, reverse=True):  # what is in a folder comes before it
            path = folder / name
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            else:
                path.unlink()
        folder.rmdir()
        folder.parent.rmdir()
    except OSError as failure:
        said = f"{folder}: a part of the earlier results could not be removed ({failure.strerror})"
        warnings.warn(said, RuntimeWarning, stacklevel=2)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def library_versions() -> dict[str, str]:
    """Name what results were made with."""
    libraries = {library: version(library) for library in _LIBRARIES}
    return {"aimd_des": __version__, "python": platform.python_version(), **libraries}


def write_run(place: Place, scenario: Scenario, result: Result, *, figures: bool = True) -> None:
    """Write everything about a run: the numbers first, whole or not at all, and then the figures.

    Parameters
    ----------
    place : Place
        Where results shall go, as `check_folder` has found it.
    scenario : Scenario
        What was run.
    result : Result
        What came out.
    figures : bool
        Whether to draw.

    Raises
    ------
    InputError
        If something has come to that place meanwhile; it says where the results are.

    Warns
    -----
    RuntimeWarning
        For each figure that cannot be drawn: the numbers are there all the same.
    """
    with new_folder(place) as folder:
        (folder / "scenario.toml").write_text(scenario.resolved().to_toml(), encoding="utf-8")
        summary = result.summary()
        summary.set_axis(safe_names(summary.index)).rename_axis("resource").to_csv(folder / "summary.csv")
        for name, frame in _frames(result).items():
            frame.to_parquet(folder / f"{name}.parquet", index=False)
        provenance = {
            "digest": result.digest,
            "seed": result.seed,
            "run_away": [result.problem.resource_names[j] for j in np.flatnonzero(result.run_away)],
            "versions": library_versions(),
        }
        (folder / PROVENANCE).write_text(json.dumps(provenance, indent=2) + "\n", encoding="utf-8")
        sums = checksums_of(folder, [path.name for path in folder.iterdir()])
        write_checksums(folder, sums)
    if figures:
        from aimd_des.plots.paper import figure_makers

        _add_figures(place, figure_makers(result), sums)


def _frames(result: Result) -> dict[str, pd.DataFrame]:
    """Give the frames of a run, with what holds for it at the end and cannot be seen from them."""
    names = ("signals", "demand", "allocations", *(["events"] if result.log else []))
    return {
        **{name: getattr(result, name) for name in names},
        "capacity": _capacities(result),
        "optimum": _optimum(result),
    }


def _capacities(result: Result) -> pd.DataFrame:
    """Tell since when each resource has had which capacity."""
    rows: list[tuple[float, int, float]] = []
    last = np.full(result.problem.n_resources, np.nan)
    for piece in result.history:
        changed = np.flatnonzero(piece.capacity != last).tolist()
        rows += [(piece.start, j, float(piece.capacity[j])) for j in changed]
        last = piece.capacity
    time, resource, capacity = zip(*rows, strict=True)
    names = categorical(np.array(resource), result.problem.resource_names)
    return pd.DataFrame({"time": time, "resource": names, "capacity": capacity})


def _optimum(result: Result) -> pd.DataFrame:
    """Tell what each agent that is here at the end should hold."""
    here, m = np.flatnonzero(result.history[-1].present), result.problem.n_resources
    best = np.empty((0, m)) if result.optimum is None else result.optimum.allocation
    return pd.DataFrame(
        {
            "agent": categorical(np.tile(here, m), result.problem.agent_names),
            "resource": categorical(np.repeat(np.arange(m), len(here)), result.problem.resource_names),
            "allocation": best.T.ravel(),
        }
    )


def _add_figures(place: Place, makers: Mapping[str, Callable[[], "Figure"]], sums: Mapping[str, str]) -> None:
    """Draw figures into the folder of a run, as long as its checksums are there; a failure is told."""
    for name, draw in makers.items():
        path = place.target / f"{name}.png"
        try:
            picture = BytesIO()
            draw().savefig(picture, dpi=_DPI)
            # By now the folder may be another run's, or somebody's who has made a new one.
            if read_checksums(place.target, "") != sums:
                raise _TakenError(0, "the folder is no longer that of this run")
            _write(path, picture.getvalue())
            sums = {**sums, path.name: checksum(picture.getvalue())}
            write_checksums(place.target, sums)
        except Exception as failure:  # noqa: BLE001 - whatever it is, the numbers are what the run was for
            said = f"{place.folder / path.name}: is missing ({type(failure).__name__}: {failure})"
            warnings.warn(f"{said}; all numbers are written", RuntimeWarning, stacklevel=3)


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError:
        path.unlink(missing_ok=True)  # half a figure
        raise
