"""The canonical form of a scenario: the same bytes for the same run, to be hashed."""

import inspect
import json
from collections.abc import Callable, Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, get_args, get_type_hints

from aimd_des.scenario.old_keys import with_first_keys
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import ARRAY_LIKE

# They change no result.
_IMMATERIAL = {"title", "agents"}

# Costs had no kind at first: hashes of studies are made without it.
_FIRST_COSTS = {"kind": "polynomial"}


def canonical_form(spoken: Mapping[str, Any], *, own_seed: bool) -> Callable[[int], bytes]:
    """Write what decides a result, in one way only, as a function of the seed: the rest is prepared once."""
    material = {
        key: value if key == "parameters" else _with_contents(value)
        for key, value in with_first_keys(spoken).items()
        if key not in _IMMATERIAL
    }
    if "costs" in material:
        costs = material["costs"]
        material["costs"] = {k: v for k, v in costs.items() if (k, v) not in _FIRST_COSTS.items()}

    def at(seed: int) -> bytes:
        words = with_seed(material, seed, own=own_seed)
        return json.dumps(words, sort_keys=True, separators=(",", ":"), default=repr).encode("ascii")

    return at


def with_seed(tables: Mapping[str, Any], seed: int, *, own: bool) -> dict[str, Any]:
    """Put a seed into a scenario, and into the parameters of a model that gets its own from there."""
    found = {**tables, "seed": seed}
    if own:
        parameters = tables["parameters"]
        found["parameters"] = {**parameters, "seed": type(parameters["seed"])(seed)}
    return found


def typed_parameters(function: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Write parameters of a model so that equal ones look alike."""
    try:
        hints = get_type_hints(function)
    except (NameError, TypeError):  # what is annotated with names that are not there
        hints = {}
    defaults = inspect.signature(function).parameters
    typed = {}
    for name, value in given.items():
        hint = hints.get(name, type(defaults[name].default))
        leaves = {float} if hint in ARRAY_LIKE else set(_leaves(hint))
        if Path in leaves and isinstance(value, str) and Path(value).is_file():
            typed[name] = _content(value)
        elif int not in leaves and any(issubclass(leaf, float) for leaf in leaves):
            typed[name] = _as_floats(value)
        else:
            typed[name] = value
    return typed


def _leaves(hint: Any) -> Iterator[type]:
    """Yield the classes that an annotation is made of."""
    if isinstance(hint, type):
        yield hint
    for argument in get_args(hint):
        yield from _leaves(argument)


def _as_floats(value: Any) -> Any:
    if isinstance(value, list):
        return [_as_floats(item) for item in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _with_contents(value: Any) -> Any:
    """Put the contents of files in the place of their names."""
    if isinstance(value, list):
        return [_with_contents(item) for item in value]
    if isinstance(value, dict):
        return {key: _content(item) if key == "path" else _with_contents(item) for key, item in value.items()}
    return value


def _content(path: str) -> str:
    try:
        return f"sha256:{sha256(Path(path).read_bytes()).hexdigest()}"
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
