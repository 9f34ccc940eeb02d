"""Models by name: a scenario file may call functions that were registered here, and no others."""

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from typing import Any, TypeVar

from aimd_des.problem.problem import Problem
from aimd_des.scenario.named import MODELS
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import MODEL, Registered, enter

_Model = TypeVar("_Model", bound=Callable[..., Problem])


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
    own = function.__name__
    enter(own, Registered(MODEL, f"{function.__module__}.{own}", function))
    return function


def named_model(name: str) -> Callable[..., Problem]:
    """Find a registered model, and import its module."""
    return MODELS.find(name).make


def made_by(name: str, parameters: Mapping[str, Any]) -> Problem:
    """Let a model make a problem."""
    function = named_model(name)
    try:
        problem = function(**parameters)
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # all that it does not check itself
        cause = f"{type(error).__name__}: {error}".rstrip(": ")
        raise InputError(f"parameters: {name} makes no problem of them ({cause})") from error
    if not isinstance(problem, Problem):
        raise InputError.of(f"what {name} returns", problem, "a Problem")
    return problem


def takes_seed(name: str, given: Mapping[str, Any]) -> bool:
    """Tell whether a model gets the seed of the scenario."""
    return "seed" in signature(named_model(name)).parameters and "seed" not in given


def model_parameters(name: str, given: dict[str, Any], seed: int) -> dict[str, Any]:
    """Complete the parameters of a model with its defaults."""
    known = signature(named_model(name)).parameters
    for key in given:
        validation.known(f"parameters of {name}", key, known)
    defaults = {key: value.default for key, value in known.items() if value.default is not Parameter.empty}
    if "seed" in known:
        defaults["seed"] = seed
    return {key: given.get(key, defaults[key]) for key in known if key in given or key in defaults}
