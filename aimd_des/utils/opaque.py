"""A whole number that LLVM knows nothing of, where what it would make of the number is slower."""

from typing import Any, TypeVar

from llvmlite import ir

from aimd_des.utils.jit import instruction

_Number = TypeVar("_Number", bound=Any)


def _unchanged(number: _Number) -> _Number:
    return number


@instruction(_unchanged)
def opaque(typingctx: Any, number: Any) -> Any:  # noqa: ARG001 - numba's calling convention
    """Return an integer of 64 bits unchanged.

    A loop in which this stands is taken turn by turn: LLVM makes no vectors of several turns.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        # Even empty assembly is left as it is: on every machine the number may become another.
        word = ir.IntType(64)
        return builder.asm(ir.FunctionType(word, [word]), "", "=r,0", [args[0]], side_effect=True)

    return number(number), codegen
