"""A user's own quantile function in compiled code: called by its address, one row of links at a time."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from aimd_des.utils.errors import InputError

__all__ = ["MOST_PARAMETERS", "address_of", "call_quantile"]

#: A table of latencies has as many rows.
MOST_PARAMETERS = 3


@intrinsic  # type: ignore[untyped-decorator]  # numba has no type information
def call_quantile(
    typingctx: Any,  # noqa: ARG001
    address: Any,  # noqa: ARG001
    count: Any,  # noqa: ARG001
    out: Any,  # noqa: ARG001
    first: Any,  # noqa: ARG001
    second: Any,  # noqa: ARG001
    third: Any,  # noqa: ARG001
) -> Any:
    """Call void(int64 count, double* out, double* first, double* second, double* third)."""
    # Addresses travel as integers: a function pointer in a table would be part of the table's type.
    signature = types.void(*[types.int64] * 6)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        word, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [word, *[pointer] * 4]).as_pointer()
        places = [builder.inttoptr(place, pointer) for place in args[2:]]
        builder.call(builder.inttoptr(args[0], kind), [args[1], *places])
        return context.get_dummy_value()

    return signature, codegen


def address_of(quantile: Callable[..., Any], n_parameters: int) -> int:
    """Compile a quantile function for rows; 0 where numba is told to compile nothing."""
    if numba.config.DISABLE_JIT:
        return 0
    name = getattr(quantile, "__name__", repr(quantile))
    if not isinstance(quantile, Dispatcher):
        raise InputError.of(f"quantile {name}", quantile, "a function decorated with numba.njit")
    try:
        return int(_callback(quantile, n_parameters).address)
    except NumbaError as error:
        cause = next(line for line in str(error).splitlines() if line.strip())
        form = ", ".join(("u", *("first", "second", "third")[:n_parameters]))
        raise InputError(f"{name}({form}) of numbers cannot be compiled ({cause})") from error


@lru_cache(maxsize=64)
def _callback(quantile: Any, n_parameters: int) -> Any:
    # The cache keeps the callback alive, without which its address would mean nothing.
    forms: tuple[Callable[..., Any], ...] = (
        lambda u, first, second, third: quantile(u),
        lambda u, first, second, third: quantile(u, first),
        lambda u, first, second, third: quantile(u, first, second),
        quantile,
    )
    one = numba.njit(forms[n_parameters])
    pointer = "CPointer(float64)"

    @numba.cfunc(f"void(int64, {pointer}, {pointer}, {pointer}, {pointer})")  # type: ignore[untyped-decorator]
    def call(count: int, out: Any, first: Any, second: Any, third: Any) -> None:
        for i in range(count):
            out[i] = one(out[i], first[i], second[i], third[i])

    return call
