"""Models by name: a scenario file may call functions that were registered here, and no others."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib import import_module
from inspect import Parameter, signature
from typing import Any, TypeVar

from aimd_des.problem.problem import Problem
from aimd_des.scenario.module_source import decorated, modules_in, source_of
from aimd_des.utils.errors import InputError

__all__ = ["made_by", "model", "model_parameters", "models_of", "named_model"]

_Model = TypeVar("_Model", bound=Callable[..., Problem])
# By module and by the name of the function in it.
_REGISTERED: dict[str, dict[str, Callable[..., Problem]]] = {}

# What the decorator is called where it is imported.
_DECORATORS = frozenset({"aimd_des.model", "aimd_des.registry.model", "aimd_des.scenario.models.model"})


def model(function: _Model) -> _Model:
    """Register a function that returns a `Problem`: a scenario can name it by its module.

    Where a module registers several, each is named by module and function, such as
    "my_models.small".

    Parameters
    ----------
    function : callable
        At the top level of its module.  All its parameters have defaults; one called ``seed`` gets the
        scenario's seed.

    Returns
    -------
    callable
        The function itself.
    """
    _REGISTERED.setdefault(function.__module__, {})[function.__name__] = function
    return function


def named_model(name: str) -> Callable[..., Problem]:
    """Find a registered model, and import its module.

    A module that registers no model is not imported: that is read in its source.
    """
    module, function = _called(name)
    if module not in _REGISTERED:
        try:
            import_module(module)
        except (Exception, SystemExit) as error:  # whatever a module of the user's raises
            _REGISTERED.pop(module, None)  # what it had registered before
            raise _not_imported(name, error) from error
    if function not in _REGISTERED.get(module, {}):
        raise InputError.of("model", name, "a module that registers a model when it is imported")
    return _REGISTERED[module][function]


def _called(name: str) -> tuple[str, str]:
    """Say which function of which module a name means."""
    own = _functions_of(name)
    if own is not None and len(own) == 1:
        return name, own[0]
    if own:
        raise InputError.of("model", name, f"one of {', '.join(f'{name}.{function}' for function in own)}")
    module, _, function = name.rpartition(".")
    above = (_functions_of(module) if module else None) or []
    if function in above:
        return module, function
    if own is not None:
        remedy = "decorate its function with aimd_des.model"
        raise InputError.of("model", name, "a module that registers a model", remedy)
    beside = [*(f"{module}.{function}" for function in above), *(modules_in(module) if module else ())]
    near = get_close_matches(name, beside, n=1)
    remedy = f"did you mean {near[0]!r}?" if near else "install it, or run from the folder that holds it"
    raise InputError.of("model", name, "a module on the Python path or in the working directory", remedy)


def _functions_of(module: str) -> list[str] | None:
    """Name the models that a module has registered, or would; None if there is no such module."""
    if module in _REGISTERED:
        return list(_REGISTERED[module])
    try:
        source = source_of(module)
        return None if source is None else decorated(source, _DECORATORS)
    except (ImportError, SyntaxError, ValueError, RecursionError, MemoryError) as error:  # no Python
        raise _not_imported(module, error) from error


def _not_imported(name: str, error: BaseException) -> InputError:
    """Say that a module is broken."""
    allowed = f"a module that can be imported, and this one raises {type(error).__name__}: {error}"
    return InputError.of("model", name, allowed)


def models_of(module: str) -> list[str]:
    """Name the models of a module, as a scenario can; nothing is imported."""
    try:
        functions = _functions_of(module) or []
    except InputError:
        return []
    return [module] if len(functions) == 1 else [f"{module}.{function}" for function in functions]


def made_by(name: str, parameters: Mapping[str, Any]) -> Problem:
    """Let a model make a problem."""
    function = named_model(name)
    try:
        problem = function(**parameters)
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # whatever it does not check itself
        cause = f"{type(error).__name__}: {error}".rstrip(": ")
        raise InputError(f"parameters: {name} makes no problem of them ({cause})") from error
    if not isinstance(problem, Problem):
        raise InputError.of(f"what {name} returns", problem, "a Problem")
    return problem


def model_parameters(name: str, given: dict[str, Any], seed: int) -> dict[str, Any]:
    """Complete the parameters of a model with its defaults."""
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
