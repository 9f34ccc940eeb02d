"""A user's own quantile function in compiled code: called by its address, one row of links at a time."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from aimd_des.channel.parameters import MOST_PARAMETERS, form_of
from aimd_des.utils.compiled_call import IN_ROWS, NUMBERS, caller, compiled_for_rows

# Of a number of links, their uniform numbers, which become latencies, and their parameters.
_OF_LINKS = f"void(int64, {', '.join([NUMBERS] * (1 + MOST_PARAMETERS))})"
call_quantile = caller(_OF_LINKS)


def address_of(quantile: Callable[..., Any], n_parameters: int) -> int:
    """Compile a quantile function for rows; 0 where numba is told to compile nothing."""
    import numba

    return 0 if numba.config.DISABLE_JIT else int(_callback(quantile, n_parameters).address)


# The cache keeps the callback alive, without which its address would mean nothing.
@cache
def _callback(quantile: Any, n_parameters: int) -> Any:
    import numba

    def make(own: Any) -> Any:
        @numba.njit(**IN_ROWS)  # type: ignore[untyped-decorator]  # numba has no type information
        def one(u: float, first: float, second: float, third: float) -> Any:
            return own(u, *(first, second, third)[:n_parameters])

        @numba.cfunc(_OF_LINKS)  # type: ignore[untyped-decorator]
        def call(count: int, out: Any, first: Any, second: Any, third: Any) -> None:
            # Compiled code that calls this cannot take an exception: what is not a number is refused there.
            try:
                for i in range(count):
                    out[i] = one(out[i], first[i], second[i], third[i])
            except Exception:  # noqa: BLE001 - the only one that compiled code can catch
                out[0] = np.nan

        return call

    return compiled_for_rows(quantile, "quantile", form_of(("u",), n_parameters), make)
