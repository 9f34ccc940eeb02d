"""Parameters of models, one for all agents or one for each: taken in, and counted."""

from collections.abc import Callable, Sequence
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

# Times above this are refused: so far below the largest double, no draw can overflow to infinity,
# which is how a lost copy is written.
LONGEST = 1e100

#: How many parameters a compiled function of the user's can have, besides what it is told.
MOST_PARAMETERS = 3

_EXAMPLES = {"latency": "Exponential(0.5)", "loss": "Bernoulli(0.1)"}


def take(model: object, *names: str, **bounds: Any) -> None:
    """Check parameters of a frozen model and put the clean values in their place."""
    for name in names:
        clean = validation.per_agent(f"{type(model).__name__}.{name}", getattr(model, name), **bounds)
        object.__setattr__(model, name, clean)


def model_of(field: str, given: Any, kind: type, plain: Callable[[Any], Any]) -> Any:
    """Return a model of latency or loss as it is, or make the plain one of numbers."""
    if isinstance(given, Real | np.ndarray) or validation.axes(given):
        return plain(given)
    name = kind.__name__.lower()
    allowed = f"a number, one for each agent, or a model of {name} such as {name}.{_EXAMPLES[name]}"
    return validation.instance(field, given, kind, allowed)


def fit(model: object, names: tuple[str, ...], n_agents: int | None = None) -> None:
    """Refuse arrays that have not one value for each agent."""
    for name in names:
        value = getattr(model, name)
        if np.ndim(value):
            n_agents = len(value) if n_agents is None else n_agents
            validation.fits(f"{type(model).__name__}.{name}", value, n_agents)


def refuse(model: object, name: str, wrong: npt.ArrayLike, allowed: str) -> None:
    """Refuse a parameter where it does not go with another one."""
    found = np.flatnonzero(wrong)
    if len(found):
        values = getattr(model, name)
        place = f"[{found[0]}]" if np.ndim(values) else ""
        shown = float(values[found[0]] if place else values)
        raise InputError.of(f"{type(model).__name__}.{name}{place}", shown, allowed)


def scalar_or_row(value: Any) -> float | FloatArray:
    """Return a number where all agents share it, else an array that cannot be written to."""
    row = np.array(value, dtype=np.float64)
    if not row.ndim:
        return float(row)
    row.setflags(write=False)
    return row


def rows_for(function: object, n_agents: int, parameters: Sequence[npt.ArrayLike]) -> Sequence[npt.ArrayLike]:
    """Take in the parameters of a compiled function of the user's."""
    if len(parameters) > MOST_PARAMETERS:
        field = f"parameters of {getattr(function, '__name__', 'the function')}"
        raise InputError.of(field, len(parameters), f"at most {MOST_PARAMETERS}")
    rows = [validation.per_agent(f"parameter {place}", given) for place, given in enumerate(parameters)]
    for place, row in enumerate(rows):
        validation.fits(f"parameter {place}", row, n_agents)
    return rows


def form_of(told: Sequence[str], n_parameters: int, *last: str) -> str:
    """Write down what a compiled function of the user's is called with."""
    return ", ".join((*told, *("first", "second", "third")[:n_parameters], *last))
