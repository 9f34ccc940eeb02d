"""Folders of results: written whole or not at all, and no other folder is touched."""

import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from aimd_des.utils.errors import InputError

#: The file by which the folder of a run is recognised as one that this program wrote.
PROVENANCE = "run.json"


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


def is_study(folder: Path) -> bool:
    """Tell whether a folder is that of a study."""
    return (folder / "manifest.json").is_file()


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
        why = "something has come there" if isinstance(failure, TakenError) else failure.strerror
        raise InputError(
            f"output folder {str(place.folder)!r}: cannot be replaced any more ({why}) and was left alone; "
            f"what was to be written there is in {str(place.folder.with_name(kept.name))!r}"
        ) from None


class TakenError(OSError):
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
    # No other program finds it there, so that what is seen now is what is removed.
    try:
        if _contents(old) != place.held:
            raise TakenError
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
    """Rename a folder; only an empty folder may have its new name."""
    with suppress(OSError):
        target.rmdir()  # of an empty folder: not every system renames over it
    try:
        folder.rename(target)
    except OSError as failure:
        if os.path.lexists(target):
            raise TakenError from failure
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
