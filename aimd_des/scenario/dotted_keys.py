"""Settings by dotted keys, such as ``channel.latency`` or ``interventions.1.at``, in nested data."""

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.utils.errors import InputError

#: Parts that a dotted key may have, and how deep tables and lists may be nested.
MOST_PARTS = 64

# A part of a key: bare, or in quotes as TOML has it.
_PART = re.compile(r"""\s*(?:"([^"\n]*)"|'([^'\n]*)'|([A-Za-z0-9_-]+))\s*(\.|$)""")

# What begins so was meant to be TOML, and is no plain word.
_OPENERS = ('"', "'", "[", "{", "=")


def split_key(key: str) -> tuple[str, ...]:
    """Split a dotted key into its parts.

    Examples
    --------
    >>> split_key('parameters."my.size"')
    ('parameters', 'my.size')
    """
    parts: list[str] = []
    place, dotted = 0, True
    while dotted:
        if len(parts) == MOST_PARTS:
            raise InputError.of("key", key, f"of at most {MOST_PARTS} parts")
        part = _PART.match(key, place)
        if part is None:
            allowed = "names of keys joined by dots, such as channel.latency or resources.0.capacity"
            raise InputError.of("key", key, allowed)
        parts.append(next(group for group in part.groups() if group is not None))
        place, dotted = part.end(), part[4] == "."
    return tuple(parts)


def check_depth(data: Mapping[str, Any], source: str) -> None:
    """Refuse data that are nested deeper than anything that a file can mean."""
    level: list[Any] = [data]
    for _ in range(MOST_PARTS + 1):
        inside = (part.values() if isinstance(part, Mapping) else part for part in level)
        level = [item for part in inside for item in part if isinstance(item, Mapping | list)]
        if not level:
            return
    raise InputError(f"{source}: is nested deeper than {MOST_PARTS} tables and lists")


def with_settings(data: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Set values in nested data, and leave the data as they are.

    Parameters
    ----------
    data : mapping
        Tables and lists, as of a scenario file.
    settings : mapping of str to object
        A value for each dotted key.

    Returns
    -------
    dict
        The data with the values set.

    Raises
    ------
    InputError
        If a key leads into something that is no table, or to an element that is not there.

    Examples
    --------
    >>> with_settings({"channel": {"loss": 0.1}}, {"channel.loss": 0.2, "clocks.jitter": 0.5})
    {'channel': {'loss': 0.2}, 'clocks': {'jitter': 0.5}}
    """
    changed = dict(data)
    for key, value in with_new_keys(settings).items():
        changed = _set(changed, key, split_key(key), 0, value)
    return changed


def _set(container: Any, key: str, parts: tuple[str, ...], depth: int, value: Any) -> Any:
    """Copy one table or list with the rest of a key set in it."""
    if depth == len(parts):
        return value
    here, part = ".".join(parts[:depth]), parts[depth]
    if isinstance(container, Mapping):
        inner = container.get(part, {} if depth + 1 < len(parts) else None)
        return {**container, part: _set(inner, key, parts, depth + 1, value)}
    if isinstance(container, list):
        if not re.fullmatch("[0-9]{1,9}", part) or int(part) >= len(container):
            allowed = f"the number of one of its {len(container)}, from 0" if container else "left out"
            raise InputError.of(f"{key}: element of {here}", part, allowed)
        place = int(part)
        return [
            *container[:place],
            _set(container[place], key, parts, depth + 1, value),
            *container[place + 1 :],
        ]
    raise InputError.of(f"{key}: {here}", container, f"a table, to have a key {part!r}", f"set {here} itself")


def parse_setting(text: str) -> tuple[str, Any]:
    """Read ``key=value`` as it is given on the command line.

    Parameters
    ----------
    text : str
        A dotted key, and a value of TOML or a plain word.

    Returns
    -------
    tuple of str and object
        Key and value.

    Raises
    ------
    InputError
        If it is neither.

    Examples
    --------
    >>> parse_setting("channel.latency=0.5"), parse_setting("agents=fleet")
    (('channel.latency', 0.5), ('agents', 'fleet'))
    """
    key, sign, word = (part.strip() for part in text.partition("="))
    if not sign or not word:
        raise InputError.of("setting", text, "key=value, such as channel.latency=0.5")
    split_key(key)
    try:
        read = tomllib.loads(f"value = {word}")
    except (ValueError, RecursionError) as error:  # integers of thousands of digits, too
        if word.startswith(_OPENERS) or "\n" in word or isinstance(error, RecursionError):
            raise InputError.of(f"value of {key}", word, "a value of TOML, or a plain word") from None
        return key, word
    if len(read) != 1:
        raise InputError.of(f"value of {key}", word, "one value of TOML, on one line")
    return key, read["value"]
