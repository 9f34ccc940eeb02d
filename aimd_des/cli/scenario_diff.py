"""Where two scenarios or studies differ, key by key."""

from collections.abc import Sequence
from typing import Any

from aimd_des.cli.printing import say
from aimd_des.cli.terminal_tables import print_table
from aimd_des.utils.formatting import given

#: How the two are called in tables.
HEADS = ("first", "second")


def print_differences(found: Sequence[Sequence[str]], none: str) -> None:
    """Print a line for each key that differs."""
    if found:
        print_table("What differs", ["key", *HEADS], found)
    else:
        say(none)


def differences(first: Any, second: Any) -> list[list[str]]:
    """Name the keys in which two tables differ."""
    one, other = flat(first), flat(second)
    found = []
    for key in dict.fromkeys([*one, *other]):
        if one.get(key) != other.get(key) or (key in one) != (key in other):
            words = [given(table[key]) if key in table else "-" for table in (one, other)]
            if words[0] == words[1]:  # what differs is in digits, or values, that are not shown
                words = _closer(one[key], other[key])
            found.append([key, *words])
    return found


def _closer(first: Any, second: Any) -> list[str]:
    """Write two values that look the same, so that they do not."""
    if not (isinstance(first, list) and isinstance(second, list)):
        return [repr(first), repr(second)]
    differing = sum(one != other for one, other in zip(first, second, strict=False))
    return [f"{given(first)}", f"{given(second)}, {differing} of them different"]


def flat(table: Any, above: str = "") -> dict[str, Any]:
    """Name every value of a scenario by its path, such as "channel.latency" or "resources.0.capacity"."""
    if isinstance(table, dict) and (table or not above):
        items = list(table.items())
    elif isinstance(table, list) and table and all(isinstance(part, dict) for part in table):
        items = list(enumerate(table))
    else:
        return {above: table}
    found = {}
    for key, value in items:
        found.update(flat(value, f"{above}.{key}" if above else str(key)))
    return found
