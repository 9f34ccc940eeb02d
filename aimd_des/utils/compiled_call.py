"""Calls from kernels of functions that were compiled apart from them, by their addresses."""

from collections.abc import Callable
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.core.typing import Signature
from numba.extending import intrinsic

from aimd_des.utils.errors import InputError


def caller(signature: Signature) -> Any:
    """Return what calls a function of a signature in compiled code: of its address and a tuple of arguments.

    Pointers among the arguments are given as integers, such as ``array.ctypes.data``.
    """
    kinds, returned = signature.args, signature.return_type
    given = types.Tuple([types.int64 if isinstance(kind, types.CPointer) else kind for kind in kinds])

    # Addresses travel as integers: a function pointer among a kernel's arguments would be part of its type,
    # and every function would compile the kernel anew.
    @intrinsic  # type: ignore[untyped-decorator]  # numba has no type information
    def call(typingctx: Any, address: Any, arguments: Any) -> Any:  # noqa: ARG001
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
            address, packed = args
            words = [context.get_value_type(kind) for kind in kinds]
            values = [builder.extract_value(packed, place) for place in range(len(kinds))]
            for place, kind in enumerate(kinds):
                if isinstance(kind, types.CPointer):
                    values[place] = builder.inttoptr(values[place], words[place])
            gives = ir.VoidType() if returned == types.void else context.get_value_type(returned)
            function = builder.inttoptr(address, ir.FunctionType(gives, words).as_pointer())
            result = builder.call(function, values)
            return context.get_dummy_value() if returned == types.void else result

        return returned(types.int64, given), codegen

    return call


#: Of what is taken into a loop over agents.  Divisions give inf or not a number, as in arrays, and raise
#: nothing: a loop that may be left has no vectors.
IN_ROWS: dict[str, Any] = {"error_model": "numpy", "forceinline": True}


def options_of(function: Dispatcher) -> dict[str, Any]:
    """Return the options with which the user has decorated a function."""
    return {name: chosen for name, chosen in function.targetoptions.items() if name != "nopython"}


def compiled_for_rows(function: Any, argument: str, form: str, make: Callable[[Any], Any]) -> Any:
    """Compile a function of the user's for a loop over agents, which `make` writes around it."""
    name = getattr(function, "__name__", repr(function))
    if not isinstance(function, Dispatcher):
        raise InputError.of(f"{argument} {name}", function, "a function decorated with numba.njit")
    try:
        return make(numba.njit(**{**options_of(function), **IN_ROWS})(function.py_func))
    except NumbaError as error:
        cause = next(line for line in str(error).splitlines() if line.strip())
        raise InputError(f"{name}({form}) of numbers cannot be compiled ({cause})") from error


NUMBERS = types.CPointer(types.float64)

#: Of a function of an agent and two arrays, the second of which it may write.
OF_AN_AGENT = types.void(types.int64, NUMBERS, NUMBERS)
call_of_agent = caller(OF_AN_AGENT)
