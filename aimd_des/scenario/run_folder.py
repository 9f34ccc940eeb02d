"""The folder of a run: scenario, summary, frames and figures, as they are written and as they are read back.

The numbers are written first, whole or not at all, and then the figures.  Among the frames is the optimum
that the run is held against, so that readers of a folder need not solve for it again.
"""

import csv
import json
import platform
import tomllib
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aimd_des._version import __version__
from aimd_des.results.frames import categorical, columns_now, name_as_written, safe_names
from aimd_des.results.measures import EXPECTED, SHOWN, shown_measures
from aimd_des.results.misallocation import optimum_for_used
from aimd_des.results.result import Result
from aimd_des.results.tracking import piece_problem
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.scenario.scenario import Scenario
from aimd_des.utils import validation
from aimd_des.utils.checksums import (
    SUMS,
    checksum,
    checksums_of,
    read_checksums,
    verified,
    write_checksums,
)
from aimd_des.utils.errors import InputError
from aimd_des.utils.folders import PROVENANCE, Place, TakenError, new_folder
from aimd_des.utils.shown import Shown, ShowsItself

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Number = int | float

_SCENARIO, _SUMMARY = "scenario.toml", "summary.csv"
_REMEDY = "run the scenario again"
_LIBRARIES = ("numpy", "scipy", "numba", "simpy", "pandas")


def library_versions() -> dict[str, str]:
    """Name what results were made with."""
    libraries = {library: version(library) for library in _LIBRARIES}
    return {"aimd_des": __version__, "python": platform.python_version(), **libraries}


def write_run(
    place: Place,
    scenario: Scenario,
    result: Result,
    *,
    figures: bool = True,
    formats: Sequence[str] = ("png",),
    also: Callable[[Path], None] | None = None,
) -> None:
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
    formats : sequence of str
        Of the figures: "png", "pdf" and "svg".
    also : callable, optional
        Writes other files into the folder that it is given, before their checksums are taken.

    Raises
    ------
    InputError
        If something has come to that place meanwhile; it says where the results are.

    Warns
    -----
    RuntimeWarning
        For each figure that cannot be drawn: the numbers are there all the same.
    """
    # Frames and theory are slow to import, and a reader of a folder may need neither.
    from aimd_des.scenario.accuracy import accuracy_of

    with new_folder(place) as folder:
        (folder / _SCENARIO).write_text(scenario.resolved().to_toml(), encoding="utf-8")
        summary, accuracy = result.summary(), accuracy_of(scenario, result)
        if accuracy.expected is not None:
            summary.insert(list(summary).index("misallocation") + 1, EXPECTED, accuracy.expected)
        summary.set_axis(safe_names(summary.index)).rename_axis("resource").to_csv(folder / _SUMMARY)
        for name, frame in {**_frames(result), "convergence": accuracy.frame}.items():
            frame.to_parquet(folder / f"{name}.parquet", index=False)
        provenance = {
            "digest": result.digest,
            "seed": result.seed,
            "run_away": [result.problem.resource_names[j] for j in np.flatnonzero(result.run_away)],
            "accuracy": accuracy.words,
            "unpredicted": accuracy.reason,
            "unsettled": accuracy.left,
            "versions": library_versions(),
        }
        (folder / PROVENANCE).write_text(json.dumps(provenance, indent=2) + "\n", encoding="utf-8")
        if also is not None:
            also(folder)
        sums = checksums_of(folder, [path.name for path in folder.iterdir()])
        write_checksums(folder, sums)
    if figures:
        from aimd_des.plots.paper import run_figures

        _add_figures(place, run_figures(result), sums, formats)


def _frames(result: Result) -> "dict[str, pd.DataFrame]":
    """Give the frames of a run, with what holds for it at the end and cannot be seen from them."""
    names = ("signals", "demand", "allocations", *(["events"] if result.log else []))
    return {
        **{name: getattr(result, name) for name in names},
        "capacity": _capacities(result),
        "optimum": _optimum(result),
    }


def _capacities(result: Result) -> "pd.DataFrame":
    """Tell since when each resource has had which capacity."""
    import pandas as pd

    rows: list[tuple[float, int, float]] = []
    last = np.full(result.problem.n_resources, np.nan)
    for piece in result.history:
        changed = np.flatnonzero(piece.capacity != last).tolist()
        rows += [(piece.start, j, float(piece.capacity[j])) for j in changed]
        last = piece.capacity
    time, resource, capacity = zip(*rows, strict=True)
    names = categorical(np.array(resource), result.problem.resource_names)
    return pd.DataFrame({"time": time, "resource": names, "capacity": capacity})


def _optimum(result: Result) -> "pd.DataFrame":
    """Tell what each agent that is here at the end should hold, of the capacity and of what is used."""
    import pandas as pd

    last, m = result.history[-1], result.problem.n_resources
    here, best, of_used = np.flatnonzero(last.present), np.empty((0, m)), np.empty((0, m))
    if result.optimum is not None:
        best = result.optimum.allocation
        average = result.average_at_end[last.present]
        found = optimum_for_used(piece_problem(result.problem, last), average)
        of_used = np.full_like(best, np.nan) if found is None else found.allocation
    return pd.DataFrame(
        {
            "agent": categorical(np.tile(here, m), result.problem.agent_names),
            "resource": categorical(np.repeat(np.arange(m), len(here)), result.problem.resource_names),
            "allocation": best.T.ravel(),
            "allocation_of_used": of_used.T.ravel(),
        }
    )


def _add_figures(
    place: Place,
    makers: Mapping[str, Callable[[], "Figure"]],
    sums: Mapping[str, str],
    formats: Sequence[str],
) -> None:
    """Draw figures into the folder of a run, as long as its checksums are there; a failure is told."""
    from aimd_des.plots.style import picture_of

    for name, draw in makers.items():
        path = place.target / f"{name}.{formats[0]}"
        try:
            figure = draw()
            for form in formats:
                path = place.target / f"{name}.{form}"
                picture = picture_of(figure, form)
                # By now the folder may be another run's, or a new one of another program.
                if read_checksums(place.target, "") != sums:
                    raise TakenError(0, "the folder is no longer that of this run")
                with_it = {**sums, path.name: checksum(picture)}
                _write(path, picture, with_it)
                sums = with_it
        except Exception as failure:  # noqa: BLE001 - for any error, the numbers are what the run was for
            cause = f"{type(failure).__name__}: {failure}"
            if isinstance(failure, OSError):
                cause = failure.strerror or cause
            said = f"{place.folder / path.name}: is missing ({cause})"
            warnings.warn(f"{said}; all numbers are written", RuntimeWarning, stacklevel=3)


def _write(path: Path, content: bytes, sums: Mapping[str, str]) -> None:
    """Write a figure and the checksums with it, or neither: without its checksum the folder is damaged."""
    try:
        path.write_bytes(content)
        write_checksums(path.parent, sums)
    except OSError:
        path.unlink(missing_ok=True)
        raise


@dataclass(frozen=True, repr=False)
class StoredRun(ShowsItself):
    """A folder that `aimd-des run` wrote.

    Attributes
    ----------
    folder : Path
        Where it is.
    scenario : dict
        What was run, every value spelled out.
    digest : str
        Of the result.
    versions : dict of str to str
        Of this program, Python and the libraries.
    measures : dict of str to dict of str to number
        For each resource, each measure by its name.
    checksums : mapping of str to str, or None
        Of the files, by their names; None for a folder without them.
    run_away : tuple of str
        The resources from whose capacity demand has run away.
    accuracy : tuple of str
        What theory expects of the accuracy, in sentences.
    unpredicted : str
        Why theory expects nothing, where it does not.
    unsettled : float, optional
        By theory, the share of the deviation that decays most slowly which is left at the end.
    """

    folder: Path
    scenario: dict[str, Any]
    digest: str
    versions: dict[str, str]
    measures: dict[str, dict[str, Number]]
    checksums: Mapping[str, str] | None
    run_away: tuple[str, ...] = ()
    accuracy: tuple[str, ...] = ()
    unpredicted: str = ""
    unsettled: float | None = None

    def _shown(self) -> Shown:
        first: dict[str, Number] = next(iter(self.measures.values()), {})
        known = {name: [of[name] for of in self.measures.values()] for name in SHOWN if name in first}
        said = [
            f"{key} {self.scenario[key]}" for key in ("dynamics", "seed", "until") if key in self.scenario
        ]
        return Shown(f"Run in {self.folder}: {', '.join(said)}", *shown_measures(list(self.measures), known))

    def has(self, frame: str) -> bool:
        """Tell whether a frame was written; earlier versions wrote fewer.

        Parameters
        ----------
        frame : str
            Its name.

        Returns
        -------
        bool
            Whether the folder has it.
        """
        return (self.folder / f"{frame}.parquet").is_file()

    def frame(self, name: str) -> "pd.DataFrame":
        """Read a frame.

        Parameters
        ----------
        name : str
            Such as "signals".

        Returns
        -------
        DataFrame
            As the run wrote it.

        Raises
        ------
        InputError
            If it is not there, or not as the run wrote it.
        """
        import pandas as pd

        content = _read(self.folder, f"{name}.parquet", self.checksums)
        try:
            frame = pd.read_parquet(BytesIO(content))
        except Exception as damage:  # noqa: BLE001 - without a checksum, a damaged file may do anything
            path, cause = self.folder / f"{name}.parquet", " ".join(str(damage).split())
            raise InputError(f"{path}: is damaged ({cause}); {_REMEDY}") from None
        return frame.set_axis(columns_now(frame.columns), axis="columns")

    def text(self, name: str) -> str:
        """Read a file of text.

        Parameters
        ----------
        name : str
            Such as "summary.csv".

        Returns
        -------
        str
            What it holds.

        Raises
        ------
        InputError
            If it is not there, or not as the run wrote it.
        """
        return _text(self.folder, name, self.checksums)

    def source(self) -> str:
        """Read the scenario.

        Returns
        -------
        str
            As TOML.
        """
        return _text(self.folder, _SCENARIO, self.checksums)


def load_run(folder: str | Path) -> StoredRun:
    """Read the folder of a run.

    Parameters
    ----------
    folder : str or Path
        As `aimd-des run` wrote it.

    Returns
    -------
    StoredRun
        Its frames are read when they are asked for.

    Raises
    ------
    InputError
        If it is no such folder, or a file of it is damaged.

    Warns
    -----
    UserWarning
        If the folder has no checksums: an earlier version wrote it.
    """
    folder = validation.path("folder", folder)
    sums = read_checksums(folder, _REMEDY)
    text = {name: _text(folder, name, sums) for name in (PROVENANCE, _SCENARIO, _SUMMARY)}
    name = PROVENANCE
    try:
        provenance = json.loads(text[name])
        digest, versions = str(provenance["digest"]), dict(provenance["versions"])
        run_away, accuracy = (tuple(map(str, provenance.get(key, ()))) for key in ("run_away", "accuracy"))
        unpredicted, left = str(provenance.get("unpredicted", "")), provenance.get("unsettled")
        unsettled = None if left is None else float(left)
        name = _SCENARIO
        scenario = with_new_keys(tomllib.loads(text[name]), silent=True)
        name = _SUMMARY
        head, *rows = csv.reader(StringIO(text[name], newline=""), strict=True)
        place = head.index("resource")
        measures = {
            name_as_written(row[place]): {
                key: _number(word) for key, word in zip(head, row, strict=True) if key != "resource"
            }
            for row in rows
        }
    except (ValueError, KeyError, TypeError, csv.Error, RecursionError) as damage:
        raise InputError(f"{folder / name}: is damaged ({damage}); {_REMEDY}") from None
    if sums is None:
        said = (
            f"{folder}: has no {SUMS}, so nothing tells whether its files are as they were written; {_REMEDY}"
        )
        warnings.warn(said, UserWarning, stacklevel=2)
    return StoredRun(
        folder, scenario, digest, versions, measures, sums, run_away, accuracy, unpredicted, unsettled
    )


def _read(folder: Path, name: str, sums: Mapping[str, str] | None) -> bytes:
    try:
        return verified(folder, name, sums, _REMEDY)
    except FileNotFoundError:
        raise InputError.of(
            "folder", str(folder), "one that aimd-des run or aimd-des sweep wrote", f"it has no {name}"
        ) from None


def _text(folder: Path, name: str, sums: Mapping[str, str] | None) -> str:
    content = _read(folder, name, sums)
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{folder / name}: cannot be read ({error})") from None


def _number(word: str) -> Number:
    """Read a number; pandas writes nothing for what is not a number."""
    if not word:
        return float("nan")
    try:
        return int(word)
    except ValueError:
        return float(word)
