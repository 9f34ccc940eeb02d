"""Calls from kernels of functions that were compiled apart from them, by their addresses."""

import sys
from collections.abc import Callable
from typing import Any

from aimd_des.utils.errors import InputError
from aimd_des.utils.jit import note


def caller(signature: str) -> Any:
    """Return what calls a function of a signature in compiled code: of its address and a tuple of arguments.

    The signature is in Numba's words.  Pointers among the arguments are given as integers, such as
    ``array.ctypes.data``.
    """

    def call(address: int, arguments: tuple[Any, ...]) -> Any:
        """Call what is at an address: compiled code has a call of machine code here."""
        raise NotImplementedError(f"address {address} of {arguments}: only compiled code can call it")

    def teach() -> None:
        from aimd_des.utils.instructions import enter_address

        enter_address(call, signature)

    note(teach)
    return call


#: Of what is taken into a loop over agents.  Divisions give inf or not a number, as in arrays, and raise
#: nothing: a loop that may be left has no vectors.
IN_ROWS: dict[str, Any] = {"error_model": "numpy", "forceinline": True}


def is_compiled(function: object) -> bool:
    """Tell whether a user has decorated a function with `numba.njit`: then Numba is imported."""
    return isinstance(function, getattr(sys.modules.get("numba.core.dispatcher"), "Dispatcher", ()))


def options_of(function: Any) -> dict[str, Any]:
    """Return the options with which the user has decorated a function."""
    return {name: chosen for name, chosen in function.targetoptions.items() if name != "nopython"}


def compiled_for_rows(function: Any, argument: str, form: str, make: Callable[[Any], Any]) -> Any:
    """Compile a function of the user's for a loop over agents, which `make` writes around it."""
    name = getattr(function, "__name__", repr(function))
    if not is_compiled(function):
        raise InputError.of(f"{argument} {name}", function, "a function decorated with numba.njit")
    import numba

    try:
        return make(numba.njit(**{**options_of(function), **IN_ROWS})(function.py_func))
    except numba.core.errors.NumbaError as error:
        cause = next(line for line in str(error).splitlines() if line.strip())
        raise InputError(f"{name}({form}) of numbers cannot be compiled ({cause})") from error


#: Numbers in an array, in the words of signatures.
NUMBERS = "CPointer(float64)"

#: Of a function of an agent and two arrays, the second of which it may write.
OF_AN_AGENT = f"void(int64, {NUMBERS}, {NUMBERS})"
call_of_agent = caller(OF_AN_AGENT)
