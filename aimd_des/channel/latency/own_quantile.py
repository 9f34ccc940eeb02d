"""A user's own quantile function in compiled code: called by its address, one row of links at a time."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from aimd_des.utils.compiled_call import caller
from aimd_des.utils.errors import InputError

#: A table of latencies has as many rows.
MOST_PARAMETERS = 3


# Of a number of links, their uniform numbers, which become latencies, and their parameters.
_OF_LINKS = types.void(types.int64, *[types.CPointer(types.float64)] * 4)
call_quantile = caller(_OF_LINKS)


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

    @numba.cfunc(_OF_LINKS)  # type: ignore[untyped-decorator]
    def call(count: int, out: Any, first: Any, second: Any, third: Any) -> None:
        for i in range(count):
            out[i] = one(out[i], first[i], second[i], third[i])

    return call
