"""Scenario files: TOML in, with errors that name file and line."""

import re
import tomllib
from pathlib import Path
from typing import Any

from aimd_des.scenario.dotted_keys import MOST_PARTS, check_depth, with_settings
from aimd_des.scenario.error_messages import Place
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.scenario.scenario import Scenario, validate_scenario
from aimd_des.utils import validation
from aimd_des.utils.checksums import read_checksums, verified
from aimd_des.utils.errors import InputError

# Of a line without the spaces around it.  No two parts match the same, or long lines would take for ever.
_HEADER = re.compile(r"(\[\[?)([^\[\]]+)\]")
_KEY = re.compile(r"([A-Za-z0-9_.\-\"' ]+)=")

_REMEDY = "restore it, or copy it to another folder if you have changed it yourself"

# So many letters hold the costs of some hundred thousand agents.
_LARGEST = 32 * 10**6
# The parser takes time and memory with the square of a key's parts: they are counted before.  A match begins
# where a word does, or long words would take for ever.
_LONG_KEY = re.compile(
    rf"""(?<![A-Za-z0-9_-])(?:(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}"""
)


def load_scenario(path: str | Path, /, **changes: Any) -> Scenario:
    """Read a scenario from a TOML file.

    Parameters
    ----------
    path : str or Path
        The file.
    **changes
        Values that replace those of the file, by their key; one in a table by its dotted key, which
        `with_settings` describes: ``load_scenario(path, **{"channel.latency": 0.5})``.

    Returns
    -------
    Scenario
        Checked, not resolved.

    Raises
    ------
    InputError
        One line for each error: file, line, key, what is wrong, and the nearest known word.
    """
    data, lines = read_tables(validation.path("path", path))
    return validate_scenario(with_settings(data, changes), str(path), lines)


def read_tables(path: Path) -> tuple[dict[str, Any], dict[Place, int]]:
    """Read the file of a scenario or a study, which may have old keys."""
    data, lines = read_toml(path)
    try:
        data = with_new_keys(data, str(path))
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from None
    return data, {_new_place(place): line for place, line in lines.items()}


def _new_place(place: Place) -> Place:
    """Name the place of an old key anew."""
    dotted = ".".join(map(str, place))
    (new,) = with_new_keys({dotted: None}, silent=True)
    return place if new == dotted else (*place[:-1], new.rpartition(".")[2])


def _hold_against_checksum(path: Path) -> None:
    """Refuse the scenario in the folder of a run unless it is as it was written."""
    name = "scenario.toml"
    sums = read_checksums(path.parent, _REMEDY) if path.name == name else None
    if sums is not None and not sums.keys().isdisjoint({name, "run.json"}):
        verified(path.parent, name, sums, _REMEDY)


def read_toml(path: Path) -> tuple[dict[str, Any], dict[Place, int]]:
    """Read a TOML file."""
    try:
        text = _text(path)
        _hold_against_checksum(path)
        data = tomllib.loads(text)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except InputError:  # which is a ValueError, as those of the parser are
        raise
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: must be saved as UTF-8 ({error.reason} at byte {error.start})") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    except (ValueError, RecursionError) as error:  # integers of thousands of digits, too
        raise InputError(f"{path}: is not valid TOML: {error}") from None
    check_depth(data, str(path))
    return data, _key_lines(text)


def _text(path: Path) -> str:
    """Read a file, unless its size or its keys show that it is no scenario."""
    # The mark that some programs put before UTF-8 is no part of the first key.
    with path.open(encoding="utf-8-sig") as file:
        text = file.read(_LARGEST + 1)
    if len(text) > _LARGEST:
        raise InputError(f"{path}: must be at most {_LARGEST:,} letters long; let a model make the problem")
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"{path}:{line}: a key must have at most {MOST_PARTS} parts")
    return text


def _key_lines(text: str) -> dict[Place, int]:
    """Find the line of each key and table; the parser does not tell."""
    lines: dict[Place, int] = {}
    table: Place = ()
    counts: dict[Place, int] = {}
    for number, line in enumerate(map(str.strip, text.splitlines()), start=1):
        if header := _HEADER.match(line):
            table = _split(header[2])
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines[table] = number
        elif key := _KEY.match(line):
            lines.setdefault((*table, *_split(key[1])), number)
    return lines


def _split(dotted: str) -> Place:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))
