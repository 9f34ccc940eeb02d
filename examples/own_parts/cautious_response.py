"""A response rule of one's own: agents above their average respond more often, and the reverse."""

from typing import Literal

import numba

from aimd_des import responses
from aimd_des.lowlevel import part


@numba.njit
def level(normalization: float, slope: float, average: float, demand: float) -> float:
    """Give the response probability, by what the signal has found in place of the average."""
    return normalization * slope * demand / (average * average)


@part("response")
def cautious(cut: Literal["drawn", "fractional", "full"] = "drawn") -> responses.CustomResponse:
    """Respond the more often the more is held.

    Parameters
    ----------
    cut : str
        What becomes of demand, as with `CustomResponse`.
    """
    return responses.CustomResponse(level, cut=cut)
