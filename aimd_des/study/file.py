"""Study files: TOML in, put together from the files that it extends and the scenario it is based on."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aimd_des.scenario.dotted_keys import with_settings
from aimd_des.scenario.error_messages import Place, checked
from aimd_des.scenario.file import read_tables
from aimd_des.study.seal import unsealed
from aimd_des.study.study import Study
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

#: The study in its folder, as a file that can be run itself.
STUDY_FILE = "study.toml"


def read_study(path: str | Path, settings: Mapping[str, Any] | None = None) -> Study:
    """Read a study from a TOML file.

    Parameters
    ----------
    path : str or Path
        The file.
    settings : mapping of str to value, optional
        Dotted keys of the file, such as "replications" or "scenario.until", and what replaces their values.

    Returns
    -------
    Study
        Complete: with the scenario of ``base`` and the tables of ``extends`` in it.

    Raises
    ------
    InputError
        One line for each error: file, line, key, what is wrong, and the nearest known word.
    """
    file = validation.path("path", path)
    data, lines = _read(file)
    try:
        changed = with_settings(_with_base(_extended(file, data, (file.resolve(),))), settings or {})
    except InputError as refusal:
        raise InputError(f"{file}: {refusal}") from None
    return checked(Study, changed, str(file), lines)


def _read(file: Path) -> tuple[dict[str, Any], dict[Place, int]]:
    """Read a file; that of a study's folder has a checksum, which may be removed but not belied."""
    found = read_tables(file)
    remedy = "restore it, or remove its last line if you have changed it yourself"
    unsealed(file.read_bytes(), STUDY_FILE, str(file), remedy)
    return found


def _extended(file: Path, data: dict[str, Any], chain: tuple[Path, ...]) -> dict[str, Any]:
    """Put a file over the one that it extends; of the base only the path is known yet."""
    own = dict(data)
    if "base" in own:
        own["base"] = _beside(file, "base", own["base"])
    if "extends" not in own:
        return own
    above = _beside(file, "extends", own.pop("extends"))
    if above.resolve() in chain:
        raise InputError.of("extends", str(above), "another file than those that extend it")
    found = _extended(above, _read(above)[0], (*chain, above.resolve()))
    return _merged(found, own)


def _beside(file: Path, key: str, name: Any) -> Path:
    if not isinstance(name, str):
        raise InputError.of(key, name, "the path of a file, seen from the file that names it")
    return file.parent / name


def _with_base(data: dict[str, Any]) -> dict[str, Any]:
    """Put what the study says of its scenario over the file that it is based on."""
    if "base" not in data:
        return data
    rest = {key: value for key, value in data.items() if key != "base"}
    base = read_tables(data["base"])[0]
    base.pop("seed", None)  # the study's own decides
    own = rest.get("scenario", {})
    return {**rest, "scenario": _merged(base, own) if isinstance(own, dict) else own}


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Merge tables key by key; one of another kind, and all that is no table, replaces what was there."""
    found = dict(below)
    for key, value in above.items():
        old = found.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            same_kind = value.get("kind", old.get("kind")) == old.get("kind")
            found[key] = _merged(old, value) if same_kind else value
        else:
            found[key] = value
    return found
