"""Calls from kernels of functions that were compiled apart from them, by their addresses."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["call_compiled"]


@intrinsic  # type: ignore[untyped-decorator]  # numba has no type information
def call_compiled(typingctx: Any, address: Any, number: Any, first: Any, second: Any) -> Any:  # noqa: ARG001
    """Call a compiled function: void(int64 number, double* first, double* second)."""
    # Addresses travel as integers: a function pointer among a kernel's arguments would be part of its type,
    # and every function would compile the kernel anew.
    signature = types.void(types.int64, types.int64, types.int64, types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        word, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [word, pointer, pointer]).as_pointer()
        places = [builder.inttoptr(place, pointer) for place in args[2:]]
        builder.call(builder.inttoptr(args[0], kind), [args[1], *places])
        return context.get_dummy_value()

    return signature, codegen
