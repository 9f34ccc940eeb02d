"""Scenario files: TOML in, with errors that name file, line, key and the nearest known word."""

import re
import tomllib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from aimd_des.errors import InputError
from aimd_des.scenario.one_run import Scenario

__all__ = ["load_scenario"]

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?")
_KEY = re.compile(r"^\s*([A-Za-z0-9_.\-\"' ]+?)\s*=")

_BRANCH = re.compile(r"float|int|str|(list|literal|dict)\[.*")

Path_ = tuple[str | int, ...]


def load_scenario(path: Path, /, **changes: Any) -> Scenario:
    """Read a scenario from a TOML file.

    Parameters
    ----------
    path : Path
        The file.
    **changes
        Top-level keys that replace those of the file.

    Returns
    -------
    Scenario
        Checked, not resolved.

    Raises
    ------
    InputError
        One line for each error: file, line, key, what is wrong, and the nearest known word.
    """
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    except (ValueError, RecursionError) as error:  # integers of thousands of digits, too
        raise InputError(f"{path}: is not valid TOML: {error}") from None
    try:
        return Scenario.model_validate({**data, **changes})
    except ValidationError as refusal:
        lines = _key_lines(text)
        # One sentence a place: where a value may have several forms, each of them complains.
        sentences: dict[Path_, str] = {}
        for detail in refusal.errors():
            sentences.setdefault(_without_branches(detail["loc"]), _sentence(path, lines, detail))
        raise InputError("\n".join(sentences.values())) from None


def _key_lines(text: str) -> dict[Path_, int]:
    """Find the line of each key and table; the parser does not tell."""
    lines: dict[Path_, int] = {}
    table: Path_ = ()
    counts: dict[Path_, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _split(header[2])
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines[table] = number
        elif key := _KEY.match(line):
            lines.setdefault((*table, *_split(key[1])), number)
    return lines


def _split(dotted: str) -> Path_:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _sentence(path: Path, lines: dict[Path_, int], error: ErrorDetails) -> str:
    """Turn one of pydantic's errors into a sentence of ours."""
    location = _without_branches(error["loc"])
    place = next(
        (lines[location[:end]] for end in range(len(location), 0, -1) if location[:end] in lines), None
    )
    where = f"{path}:{place}" if place else f"{path}"
    key = ".".join(map(str, location))
    prefix = f"{where}: {key}: " if key else f"{where}: "
    if error["type"] == "extra_forbidden":
        near = get_close_matches(str(location[-1]), _known_keys(location[:-1]), n=1)
        hint = (
            f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(_known_keys(location[:-1]))}"
        )
        return f"{prefix}unknown key {location[-1]!r}{hint}"
    if error["type"] == "missing":
        return f"{prefix}is missing"
    if error["type"] == "value_error":
        return f"{prefix}{error['ctx']['error']}"
    return f"{prefix}{error['input']!r}: {error['msg'][0].lower()}{error['msg'][1:]}"


def _without_branches(location: Sequence[str | int]) -> Path_:
    """Drop what pydantic adds for the branches of a union, such as "list[float]"."""
    known: list[str | int] = []
    for part in location:
        if isinstance(part, str) and _BRANCH.fullmatch(part):
            break
        known.append(part)
    return tuple(known)


def _known_keys(location: Path_) -> list[str]:
    """List the keys that a table may have."""
    table: type[BaseModel] = Scenario
    for part in location:
        if isinstance(part, int):
            continue
        candidates = _models_in(table.model_fields[part].annotation)
        if not candidates:
            return []
        table = candidates[0]
    return list(table.model_fields)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for argument in get_args(annotation) for found in _models_in(argument)]
