"""Which control units compiled code serves, and how it calls a probability of the user's own."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

from aimd_des.engine.control_unit import ControlUnit, CrossingTable, SampledTable, table_of


def compiled_table(control_unit: ControlUnit) -> SampledTable | CrossingTable | None:
    """Return the table by which compiled code serves a control unit; None where its process has to run."""
    table = table_of(control_unit) if _speaks(type(control_unit)) else None
    own = table.probability if isinstance(table, SampledTable) else None
    return table if own is None or isinstance(own, Dispatcher) else None


def _speaks(kind: type) -> bool:
    """Tell whether a class gives its table no further up than its process."""
    # A class that is derived from one of ours and has a process of its own decides otherwise there.
    for cls in kind.__mro__:
        if "table" in vars(cls) or "process" in vars(cls):
            return "table" in vars(cls)
    return False


def compiled_probability(function: Callable[..., float]) -> Any:
    """Return a function of the user's own as compiled code can call it, by its address."""

    @numba.cfunc("float64(float64, float64, float64, int64, int64)")  # type: ignore[untyped-decorator]
    def call(total: float, limit: float, time: float, look: int, resource: int) -> float:
        # Compiled code that calls this cannot take an exception: `nan` has the check of a process ask again.
        try:
            return function(total, limit, time, look, resource)
        except Exception:  # noqa: BLE001 - the only one that compiled code can catch
            return np.nan

    return call


@intrinsic  # type: ignore[untyped-decorator]  # numba has no type information
def call_probability(
    typingctx: Any,  # noqa: ARG001
    address: Any,  # noqa: ARG001
    total: Any,  # noqa: ARG001
    limit: Any,  # noqa: ARG001
    time: Any,  # noqa: ARG001
    look: Any,  # noqa: ARG001
    resource: Any,  # noqa: ARG001
) -> Any:
    """Call a compiled probability: double(double total, double limit, double time, int64 look, int64 j)."""
    word, number = types.int64, types.float64
    signature = number(word, number, number, number, word, word)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = [context.get_value_type(kind) for kind in signature.args[1:]]
        kind = ir.FunctionType(ir.DoubleType(), kinds).as_pointer()
        return builder.call(builder.inttoptr(args[0], kind), args[1:])

    return signature, codegen
