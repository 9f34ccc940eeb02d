"""A user's own loss in compiled code: called by its address, one row of links at a time."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from aimd_des.channel.parameters import MOST_PARAMETERS, form_of
from aimd_des.utils.compiled_call import IN_ROWS, NUMBERS, caller, compiled_for_rows
from aimd_des.utils.errors import InputError

# Of a number of links and a time: their uniform numbers, their parameters, what is kept for them, and whether
# each loses its copy, to which it is added.
_OF_LINKS = f"void(int64, float64, {', '.join([NUMBERS] * (2 + MOST_PARAMETERS))}, CPointer(uint8))"
call_lost = caller(_OF_LINKS)


def address_of(lost: Callable[..., Any], n_parameters: int, columns: int) -> int:
    """Compile a loss for rows; 0 where numba is told to compile nothing."""
    import numba

    return 0 if numba.config.DISABLE_JIT else int(_callback(lost, n_parameters, columns).address)


# The cache keeps the callback alive, without which its address would mean nothing.
@cache
def _callback(lost: Any, n_parameters: int, columns: int) -> Any:
    import numba

    told = 2 + n_parameters

    def make(own: Any) -> Any:
        @numba.njit(**IN_ROWS)  # type: ignore[untyped-decorator]  # numba has no type information
        def one(u: float, time: float, first: float, second: float, third: float, memory: Any) -> Any:
            given = (u, time, first, second, third)[:told]
            return own(*given, memory) if columns > 0 else own(*given)

        @numba.cfunc(_OF_LINKS)  # type: ignore[untyped-decorator]
        def call(
            count: int, time: float, uniform: Any, first: Any, second: Any, third: Any, memory: Any, out: Any
        ) -> None:
            kept = numba.carray(memory, (count, columns))
            # Compiled code that calls this cannot take an exception: it finds a draw that is none.
            try:
                for i in range(count):
                    out[i] |= np.uint8(one(uniform[i], time, first[i], second[i], third[i], kept[i]))
            except Exception:  # noqa: BLE001 - the only one that compiled code can catch
                uniform[0] = np.nan

        returned = next(iter(one.overloads.values())).signature.return_type
        if returned != numba.types.boolean:
            raise InputError.of(f"what {lost.__name__}({form}) returns", str(returned), "a bool")
        return call

    form = form_of(("u", "time"), n_parameters, *["memory"] * (columns > 0))
    return compiled_for_rows(lost, "lost", form, make)
