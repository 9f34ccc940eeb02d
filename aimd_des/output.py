"""The folder of a run: scenario, summary, frames and figures, written whole or not at all."""

import json
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

import aimd_des
from aimd_des.errors import InputError
from aimd_des.frames import categorical
from aimd_des.results import Result
from aimd_des.scenario import Scenario

__all__ = ["check_folder", "library_versions", "new_folder", "write_run"]

#: The file by which a folder is recognised as one that this program wrote.
PROVENANCE = "run.json"
_LIBRARIES = ("numpy", "scipy", "numba", "simpy", "pandas")


def check_folder(folder: Path, *, overwrite: bool, mark: str = PROVENANCE) -> None:
    """Refuse a folder that cannot be written, before anything runs.

    Parameters
    ----------
    folder : Path
        Where results shall go.
    overwrite : bool
        Whether earlier results may be replaced.
    mark : str
        The file by which earlier results are recognised.

    Raises
    ------
    InputError
        If it is a file, holds something and `overwrite` is false, holds something that this
        program did not write, or cannot be created.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError.of("output folder", str(folder), "a folder", "it is a file; choose another name")
    if folder.is_dir() and any(folder.iterdir()):
        if not overwrite:
            raise InputError.of(
                "output folder", str(folder), "new or empty", "choose another, or say --overwrite"
            )
        if not (folder / mark).is_file():
            raise InputError.of(
                "output folder",
                str(folder),
                "one that this program wrote",
                f"it has no {mark}; remove it yourself",
            )
    above = next(path for path in folder.resolve().parents if path.exists())
    try:
        with tempfile.TemporaryDirectory(prefix=".writable", dir=above):
            pass
    except OSError as error:
        raise InputError(f"output folder {str(folder)!r}: cannot be written ({error.strerror})") from None


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Give a temporary folder that takes the place of `folder` once its block has ended well.

    Parameters
    ----------
    folder : Path
        Where results shall go; `check_folder` has accepted it.

    Yields
    ------
    Path
        Where to write; it is removed if the block fails.
    """
    target = folder.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        _take_place(temporary, target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _take_place(temporary: Path, target: Path) -> None:
    """Put one folder where another may be; if that fails, the other is there again."""
    if not target.exists():
        temporary.replace(target)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.old.", dir=target.parent))
    old = target.replace(aside / target.name)
    try:
        temporary.replace(target)
    except BaseException:
        old.replace(target)
        aside.rmdir()
        raise
    shutil.rmtree(aside)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def library_versions() -> dict[str, str]:
    """Name what results were made with.

    Returns
    -------
    dict of str
        The version of this package, of Python and of the libraries that results may depend on.
    """
    libraries = {library: version(library) for library in _LIBRARIES}
    return {"aimd_des": aimd_des.__version__, "python": platform.python_version(), **libraries}


def write_run(folder: Path, scenario: Scenario, result: Result, *, figures: bool = True) -> None:
    """Write everything about a run.

    Parameters
    ----------
    folder : Path
        Where results shall go; `check_folder` has accepted it.
    scenario : Scenario
        What was run.
    result : Result
        What came out.
    figures : bool
        Whether to draw.
    """
    with new_folder(folder) as place:
        (place / "scenario.toml").write_text(scenario.resolved().to_toml(), encoding="utf-8")
        result.summary().to_csv(place / "summary.csv")
        for name, frame in _frames(result).items():
            frame.to_parquet(place / f"{name}.parquet", index=False)
        if figures:
            from aimd_des.plots import paper_figures

            for name, figure in paper_figures(result).items():
                figure.savefig(place / f"{name}.png", dpi=160)
        provenance = {
            "digest": result.digest,
            "seed": result.seed,
            "versions": library_versions(),
        }
        (place / PROVENANCE).write_text(json.dumps(provenance, indent=2) + "\n", encoding="utf-8")


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
            "camera": categorical(np.tile(here, m), result.problem.agent_names),
            "resource": categorical(np.repeat(np.arange(m), len(here)), result.problem.resource_names),
            "allocation": best.T.ravel(),
        }
    )
