"""A whole number that LLVM knows nothing of, where what it would make of the number is slower."""

from typing import Any, TypeVar

from aimd_des.utils.jit import instruction

_Number = TypeVar("_Number", bound=Any)


@instruction
def opaque(number: _Number) -> _Number:
    """Return an integer of 64 bits unchanged.

    A loop in which this stands is taken turn by turn: LLVM makes no vectors of several turns.
    """
    return number
