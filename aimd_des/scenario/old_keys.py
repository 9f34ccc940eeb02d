"""Old names of keys: what is read may have them, and what is hashed has them still, so that studies go on."""

import logging
from collections.abc import Callable, Mapping
from typing import Any

from aimd_des.utils.deprecation import renamed
from aimd_des.utils.old_keywords import KEYWORDS, refuse_both

_LOGGER = logging.getLogger("aimd_des")

# Where the keys stand that have been renamed: in a scenario, and in a study.
_TABLES = {"control_unit", "scenario.control_unit"}
_ABOVE = {"scenario"}
_FIRST = {new: old for old, new in KEYWORDS.items()}


_Tell = Callable[[str, str], None]


def with_new_keys(data: Mapping[str, Any], source: str = "", *, silent: bool = False) -> dict[str, Any]:
    """Rename old keys of a scenario, a study or dotted settings, with a sentence about each."""

    def tell(old: str, new: str) -> None:
        if not silent:
            _LOGGER.warning("%s", f"{source}: {renamed(old, new)}".removeprefix(": "))

    found = _with_keys(data, KEYWORDS, tell)
    if isinstance(axes := found.get("axes"), list):
        found["axes"] = [axis_with_new_keys(one, tell) if isinstance(one, dict) else one for one in axes]
    return found


def axis_with_new_keys(axis: Mapping[str, Any], tell: _Tell | None = None) -> dict[str, Any]:
    """Rename old keys that an axis sets; its column keeps its name, so that folders of studies go on."""

    def renew(settings: Mapping[str, Any]) -> dict[str, Any]:
        return with_new_keys(settings) if tell is None else _with_keys(settings, KEYWORDS, tell)

    found = dict(axis)
    if isinstance(key := axis.get("key"), str) and (new := next(iter(renew({key: None})))) != key:
        found = {"name": key, **found, "key": new}
    if isinstance(cases := axis.get("cases"), dict):
        found["cases"] = {
            name: renew(case) if isinstance(case, dict) else case for name, case in cases.items()
        }
    return found


def with_first_keys(data: Mapping[str, Any]) -> dict[str, Any]:
    """Give keys the names that they had first: hashes of scenarios and of settings are made of those."""
    return _with_keys(data, _FIRST, lambda *_: None)


def _with_keys(
    data: Mapping[str, Any], names: Mapping[str, str], tell: _Tell, above: str = ""
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in data.items():
        place = f"{above}{key}"
        table, _, last = place.rpartition(".")
        name = key
        if place in _TABLES | _ABOVE and isinstance(value, Mapping):
            value = _with_keys(value, names, tell, f"{place}.")  # noqa: PLW2901 - the same, renamed
        elif table in _TABLES and last in names:
            name = f"{key.removesuffix(last)}{names[last]}"
            refuse_both(place, value, f"{table}.{names[last]}", given=name in data)
            tell(place, f"{table}.{names[last]}")
        found[name] = value
    return found
