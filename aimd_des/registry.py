"""Models by name: a scenario file may call functions that were registered here, and no others."""

import sys
from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, TypeVar

from aimd_des.errors import InputError
from aimd_des.problem import Problem

__all__ = ["model", "model_parameters", "named_model"]

_Model = TypeVar("_Model", bound=Callable[..., Problem])
_REGISTERED: dict[str, Callable[..., Problem]] = {}


def model(function: _Model) -> _Model:
    """Register a function that returns a `Problem` under the name of its module.

    Parameters
    ----------
    function : callable
        All its parameters have defaults; one called ``seed`` gets the scenario's seed.

    Returns
    -------
    callable
        The function itself.
    """
    _REGISTERED[function.__module__] = function
    return function


def named_model(name: str) -> Callable[..., Problem]:
    """Find a registered model.

    Parameters
    ----------
    name : str
        A module on the path, or in the working directory, such as "models.smart_cameras".

    Returns
    -------
    callable
        The function that was registered there.

    Raises
    ------
    InputError
        If there is no such module, it cannot be imported, or it registers no model.
    """
    if name not in _REGISTERED:
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.append(here)
        if not _exists(name):
            raise InputError.of(
                "model", name, "a module on the Python path or in the working directory", _hint(name)
            )
        try:
            import_module(name)
        except Exception as error:  # whatever a module of the user's raises
            allowed = f"a module that can be imported, and this one raises {type(error).__name__}: {error}"
            raise InputError.of("model", name, allowed) from error
    if name not in _REGISTERED:
        raise InputError.of(
            "model", name, "a module that registers a model", "decorate its function with model"
        )
    return _REGISTERED[name]


def _exists(name: str) -> bool:
    try:
        return all(part.isidentifier() for part in name.split(".")) and find_spec(name) is not None
    except (ModuleNotFoundError, ValueError):  # of a parent package; a module without a specification
        return False


def _hint(name: str) -> str:
    """Name the nearest module beside the one that is missing."""
    parent = name.rpartition(".")[0]
    spec = find_spec(parent) if parent and _exists(parent) else None
    folders = list(spec.submodule_search_locations or []) if spec else []
    beside = [
        f"{parent}.{path.stem}" for folder in folders for path in sorted(Path(folder).glob("[a-z]*.py"))
    ]
    near = get_close_matches(name, beside, n=1)
    return f"did you mean {near[0]!r}?" if near else "install it, or run from the folder that holds it"


def model_parameters(name: str, given: dict[str, Any], seed: int) -> dict[str, Any]:
    """Complete the parameters of a model with its defaults.

    Parameters
    ----------
    name : str
        The model.
    given : dict
        What the scenario says.
    seed : int
        The scenario's seed, for a parameter of that name that is not given.

    Returns
    -------
    dict
        A value for each parameter of the model.

    Raises
    ------
    InputError
        If a parameter is unknown, naming the nearest one.
    """
    known = signature(named_model(name)).parameters
    for key in given:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else ""
            raise InputError.of(f"parameters of {name}", key, f"one of {', '.join(known)}", hint)
    defaults = {key: value.default for key, value in known.items() if value.default is not Parameter.empty}
    if "seed" in known:
        defaults["seed"] = seed
    return {key: given.get(key, defaults[key]) for key in known if key in given or key in defaults}
