"""Parameters of models, one for all agents or one for each: taken in, and counted."""

from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["LONGEST", "fit", "model_of", "refuse", "scalar_or_row", "take"]

# Times above this are refused: so far below the largest double, no draw can overflow to infinity,
# which is how a lost copy is written.
LONGEST = 1e100

_EXAMPLES = {"latency": "Exponential(0.5)", "loss": "Bernoulli(0.1)"}


def take(model: object, *names: str, **bounds: Any) -> None:
    """Check parameters of a frozen model and put the clean values in their place.

    Parameters
    ----------
    model : object
        The model, in its constructor.
    *names : str
        Its parameters with these bounds; refused as "Model.name".
    **bounds
        As for `validation.per_agent`.

    Raises
    ------
    InputError
        If a value is outside its range.
    """
    for name in names:
        clean = validation.per_agent(f"{type(model).__name__}.{name}", getattr(model, name), **bounds)
        object.__setattr__(model, name, clean)


def model_of(field: str, given: Any, kind: type, plain: Callable[[Any], Any]) -> Any:
    """Return a model of latency or loss as it is, or make the plain one of numbers.

    Parameters
    ----------
    field : str
        The name under which the user gave it.
    given : object
        What was given.
    kind : type
        `Latency` or `Loss`.
    plain : callable
        Makes the model of a number, or of one for each agent; refuses those that are none.

    Returns
    -------
    Latency or Loss
        A model.

    Raises
    ------
    InputError
        If it is neither numbers nor a model.
    """
    if isinstance(given, Real | np.ndarray) or validation.axes(given):
        return plain(given)
    name = kind.__name__.lower()
    allowed = f"a number, one for each agent, or a model of {name} such as {name}.{_EXAMPLES[name]}"
    return validation.instance(field, given, kind, allowed)


def fit(model: object, names: tuple[str, ...], n_agents: int | None = None) -> None:
    """Refuse arrays that have not one value for each agent.

    Parameters
    ----------
    model : object
        The model.
    names : tuple of str
        Its parameters that may be arrays.
    n_agents : int, optional
        n; where it is not known yet, arrays are held to the length of the first.

    Raises
    ------
    InputError
        Naming both lengths.
    """
    for name in names:
        value = getattr(model, name)
        if np.ndim(value):
            n_agents = len(value) if n_agents is None else n_agents
            validation.fits(f"{type(model).__name__}.{name}", value, n_agents)


def refuse(model: object, name: str, wrong: npt.ArrayLike, allowed: str) -> None:
    """Refuse a parameter where it does not go with another one.

    Parameters
    ----------
    model : object
        The model, in its constructor.
    name : str
        The parameter.
    wrong : array_like of bool
        Where, for all agents or for each.
    allowed : str
        What is allowed, to be read after "must be".

    Raises
    ------
    InputError
        Naming the first element that is wrong, if there is one.
    """
    found = np.flatnonzero(wrong)
    if len(found):
        values = getattr(model, name)
        place = f"[{found[0]}]" if np.ndim(values) else ""
        shown = float(values[found[0]] if place else values)
        raise InputError.of(f"{type(model).__name__}.{name}{place}", shown, allowed)


def scalar_or_row(value: Any) -> float | FloatArray:
    """Return a number where all agents share it, else an array that cannot be written to.

    Parameters
    ----------
    value : array_like
        A scalar, or an array of shape (n,).

    Returns
    -------
    float or ndarray of shape (n,)
        The same numbers.
    """
    row = np.array(value, dtype=np.float64)
    if not row.ndim:
        return float(row)
    row.setflags(write=False)
    return row
