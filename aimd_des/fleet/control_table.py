"""Which control units compiled code serves, and how it calls a probability of the user's own."""

from collections.abc import Callable
from typing import Any

import numpy as np

from aimd_des.engine.control_unit import ControlUnit, CrossingTable, SampledTable, table_of
from aimd_des.utils.compiled_call import caller, is_compiled

# Of total, limit, time, number of the look and resource.
_PROBABILITY = "float64(float64, float64, float64, int64, int64)"
call_probability = caller(_PROBABILITY)


def compiled_table(control_unit: ControlUnit) -> SampledTable | CrossingTable | None:
    """Return the table by which compiled code serves a control unit; None where its process has to run."""
    table = table_of(control_unit) if _speaks(type(control_unit)) else None
    own = table.probability if isinstance(table, SampledTable) else None
    return table if own is None or is_compiled(own) else None


def _speaks(kind: type) -> bool:
    """Tell whether a class gives its table no further up than its process."""
    # A class that is derived from one of ours and has a process of its own decides otherwise there.
    for cls in kind.__mro__:
        if "table" in vars(cls) or "process" in vars(cls):
            return "table" in vars(cls)
    return False


def compiled_probability(function: Callable[..., float]) -> Any:
    """Return a function of the user's own as compiled code can call it, by its address."""
    import numba

    @numba.cfunc(_PROBABILITY)  # type: ignore[untyped-decorator]
    def call(total: float, limit: float, time: float, look: int, resource: int) -> float:
        # Compiled code that calls this cannot take an exception: `nan` has the check of a process ask again.
        try:
            return function(total, limit, time, look, resource)
        except Exception:  # noqa: BLE001 - the only one that compiled code can catch
            return np.nan

    return call
