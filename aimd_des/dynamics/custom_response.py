"""A response of the user's own: a function that gives the probability, plain for processes or compiled."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, Literal, get_args

import numpy as np

from aimd_des.dynamics.responses import (
    ASKED,
    INPUTS,
    OF_ANSWERS,
    OWN,
    OWN_COLUMNS,
    Response,
    ResponseParameters,
    response_parameters,
)
from aimd_des.utils import returned_values, validation
from aimd_des.utils.compiled_call import is_compiled, options_of
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_MEMORY = "memory"

# In place of a comparison with infinity, of which LLVM makes several instructions on bits.
_LARGEST = float(np.finfo(np.float64).max)
_MOST_MEMORY = 100

# Compiled and plain code may differ in the last bits; where there is compiled code, processes call it, too.
_TOLERANCE = 1e-9

Cut = Literal["drawn", "fractional", "full"]


@dataclass(frozen=True, eq=False)
class CustomResponse:
    """The response probability is what a function of your own returns.

    Parameters
    ----------
    probability : callable
        Returns lambda, at least 0 and finite. It gets what its parameters name: ``normalization``
        (Gamma), ``slope`` (derivative of the private cost at the averages), ``average``, ``demand`` (at
        the signal), ``increase`` and ``decrease``. Other names are ``age`` (for how long the agent has
        been active), and ``agent`` and ``resource`` (indices, as floats). If numbers are kept, ``memory``
        is the last one.  Plain Python serves agents that are processes; `Fleet` and `run_synchronous`
        need it compiled by ``numba.njit``.  It is not called while the average is 0: lambda is 0 then.
    cut : {"drawn", "fractional", "full"}
        What becomes of demand: it is multiplied by beta with probability lambda; by 1 - (1 - beta) lambda; or
        by beta when the sum of lambda passes a whole number.
    memory : int
        How many numbers the function keeps for each agent and resource, 0 to 100: it gets an array of them,
        which begins with zeros and which it may write.

    Raises
    ------
    InputError
        If the function has other parameters, returns what is no finite number of at least 0, or returns
        another number when it is compiled: it is called at a few points.

    Examples
    --------
    >>> def halved(normalization, slope, average):
    ...     return 0.5 * normalization * slope / average
    >>> CustomResponse(halved).cut
    'drawn'
    """

    probability: Callable[..., float]
    cut: Cut = "drawn"
    memory: int = 0

    def __post_init__(self) -> None:
        name = type(self).__name__
        if not callable(self.probability):
            raise InputError.of(f"{name}.probability", self.probability, "a function that returns lambda")
        validation.choice(f"{name}.cut", self.cut, get_args(Cut))
        count = validation.integer(f"{name}.memory", self.memory, low=0, high=_MOST_MEMORY)
        object.__setattr__(self, "memory", count)
        _check(self)

    def parameters(self, tick_weight: float) -> ResponseParameters:
        """Return what the formulas need."""
        del tick_weight
        order = [INPUTS.index(name) for name in _parameters_of(self) if name != _MEMORY]
        return response_parameters(get_args(Cut).index(self.cut), OWN, self.memory, order)


def _parameters_of(response: CustomResponse) -> list[str]:
    return list(inspect.signature(_plain(response.probability)).parameters)


def _plain(function: Callable[..., float]) -> Callable[..., float]:
    return getattr(function, "py_func", function)


def _check(response: CustomResponse) -> None:
    """Hold a function against what it must be, on samples."""
    field, names = f"parameters of {type(response).__name__}.probability", _parameters_of(response)
    for name in names:
        if name not in (*INPUTS, _MEMORY):
            allowed = f"names of {', '.join(INPUTS)} or {_MEMORY}"
            raise InputError.of(field, name, allowed)
    if (_MEMORY in names) != (response.memory > 0) or _MEMORY in names[:-1]:
        raise InputError.of(
            field, tuple(names), "with 'memory' last where memory is above 0, and without it else"
        )
    parameters = response.parameters(0.0)
    compiled = called_plainly(response, parameters)
    plain = compiled
    if is_compiled(response.probability):
        plain = called_plainly(response, parameters, _plain(response.probability))
    for slope, average, demand, age in product((0.3, 2.0), (0.5, 4.0), (0.6, 5.0), (1.0, 1000.0)):
        values = (0.1, slope, average, demand, 0.01, 0.7, age, 0.0, 0.0)
        one, other = (call(values, np.zeros(response.memory)) for call in (compiled, plain))
        if abs(one - other) > _TOLERANCE * max(one, other):
            raise InputError.of(
                f"{type(response).__name__}.probability() compiled", one, f"{other!r}, as it returns plainly"
            )


#: Called with the values of all of `INPUTS` and the agent's own memory.
Caller = Callable[[Sequence[float], FloatArray], float]


def called_plainly(
    response: Response, parameters: ResponseParameters, function: Callable[..., float] | None = None
) -> Caller:
    """Return the user's function as processes call it."""
    own: Any = response
    chosen, order = function or own.probability, parameters.order.tolist()
    field = _said(response)

    def call(values: Sequence[float], memory: FloatArray) -> float:
        given = [values[place] for place in order]
        with returned_values.calling(field):
            returned = chosen(*given, memory) if parameters.columns else chosen(*given)
        # For every answer, since it costs little: what compiled code gets is checked by `check_returned`.
        return validation.number(field, returned, low=0.0)

    return call


def with_address(
    response: Response | None, parameters: ResponseParameters, at_once: int = 1
) -> ResponseParameters:
    """Let kernels call the user's function, if there is one, for one or for several answers at once."""
    if parameters.divisor != OWN:
        return parameters
    own: Any = response
    if not is_compiled(own.probability):
        raise InputError.of(
            f"{type(response).__name__}.probability",
            own.probability,
            "compiled by numba.njit for Fleet and run_synchronous",
            "decorate it with numba.njit, or choose agents=AgentProcess",
        )
    called = _callback(own.probability, len(parameters.order), parameters.columns)
    inputs, given = np.zeros((len(INPUTS), at_once)), np.zeros(at_once)
    return parameters._replace(address=called.address, inputs=inputs, given=given)


def check_returned(response: Response | None, parameters: ResponseParameters) -> None:
    """Refuse what the user's function has returned to kernels, which cannot refuse it themselves."""
    if parameters.divisor == OWN:
        validation.number(_said(response), parameters.wrong[0], low=0.0)


def _said(response: object) -> str:
    return f"{type(response).__name__}.probability()"


# The cache keeps the callback alive, without which its address would mean nothing.
@cache
def _callback(function: Any, count: int, columns: int) -> Any:
    import numba

    # As for gradients of costs: kernels get the address alone.  The options are the function's own, since it
    # must give processes, which call it one by one, the same bits.
    own = numba.njit(**{**options_of(function), "forceinline": True})(function.py_func)

    @numba.njit(forceinline=True)  # type: ignore[untyped-decorator]  # numba has no type information
    def ask(inputs: FloatArray, k: int, memory: FloatArray) -> float:
        # Written out: what is read of more places than the function has is left out again.
        first = (inputs[0, k], inputs[1, k], inputs[2, k], inputs[3, k], inputs[4, k])
        values = (*first, inputs[5, k], inputs[6, k], inputs[7, k], inputs[8, k])[:count]
        return float(own(*values, memory)) if columns > 0 else float(own(*values))

    @numba.cfunc(OF_ANSWERS)  # type: ignore[untyped-decorator]
    def call(number: int, at_once: int, inputs: Any, memory: Any, given: Any, wrong: Any) -> None:
        values = numba.carray(inputs, (len(INPUTS), at_once))
        kept = numba.carray(memory, (number, OWN_COLUMNS + columns))
        # Compiled code that calls this cannot take an exception.
        try:
            for k in range(number):
                if given[k] == ASKED:
                    returned = ask(values, k, kept[k, OWN_COLUMNS:])
                    if not 0.0 <= returned <= _LARGEST:
                        wrong[0] = returned
                    given[k] = returned if returned > 0.0 else 0.0  # not a number is 0, too
        except Exception:  # noqa: BLE001 - the only one that compiled code can catch
            wrong[0] = np.nan

    return call
