"""Whether demand has run away from the capacity: one criterion, for Python, command line and report.

Demand that is a little above the capacity in the mean says little alone: a control unit that samples lets it
overshoot, and still holds it.  It has run away where the control unit signals at nearly every opportunity, or
in long series, and demand stays high all the same.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aimd_des.results.run_data import Signals
from aimd_des.utils.validation import BoolArray, FloatArray

# Of the second half of a run: mean demand over the capacity, the part of the opportunities to signal, of
# which there must be so many for that to mean anything, and signals in a row.  Far above the capacity less is
# enough: where all agents grow by several capacities in a step one look in ten sees little left.
_MEAN = 1.05
_SHARE = 0.95
_TWICE, _HALF = 2.0, 0.5
_LEAST = 20
_SERIES = 100
# Times of signals are sums; so much may be rounding.
_ROUNDING = 1e-9


class Opportunities(NamedTuple):
    """When a control unit may signal."""

    number: float  # how often in the part of the run that is judged
    spacing: float  # longest time between two opportunities of which both are used


def run_away(
    signals: Signals,
    mean: FloatArray,
    until: float,
    opportunities: Opportunities,
    since: float | None = None,
) -> BoolArray:
    """Judge the second half of a run, or all of it from a time on."""
    start = 0.5 * until if since is None else since
    away = np.zeros(len(mean), dtype=np.bool_)
    for j in np.flatnonzero(mean > _MEAN).tolist():
        times = signals.time[(signals.resource == j) & (signals.time >= start)]
        share = len(times) / opportunities.number if opportunities.number >= _LEAST else 0.0
        apart = np.flatnonzero(np.diff(times) > opportunities.spacing * (1.0 + _ROUNDING))
        ends = np.concatenate(([-1], apart, [len(times) - 1]))
        often = share >= _SHARE or (share >= _HALF and mean[j] > _TWICE)
        away[j] = often or np.diff(ends).max() > _SERIES
    return away


def overload_words(
    names: Sequence[str], mean: FloatArray, away: BoolArray, part: str = "second half of the run"
) -> str:
    """Say which capacities do not hold demand."""
    where = ", ".join(f"{names[j]} ({mean[j]:.3g} of it)" for j in np.flatnonzero(away).tolist())
    return (
        f"demand has run away from the capacity of {where}, in the mean of the {part}:"
        " signals come too late, are lost, or take too little"
    )
