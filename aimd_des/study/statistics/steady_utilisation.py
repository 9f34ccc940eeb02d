"""Mean utilisation of one run without its start: exact, from the averages that it recorded."""

from typing import Literal

import numpy as np
import pandas as pd

from aimd_des.results.result import Result
from aimd_des.study.statistics.steady_state import batch_means, mser
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

# Looks may lie so much farther apart in one place than in another: whole steps cannot be spread evenly.
_MOST_UNEVEN = 2.5
# How far apart two integrals of the same may be, relatively: 1e7 additions, each rounded by 1e-16.
_ROUNDING = 1e-9
_EXACT_INSTEAD = (
    "begin a piece at the warm-up with a CapacityStep to the capacity that there is, and read the exact mean"
    " off result.pieces"
)


def steady_utilisation(
    result: Result,
    warm_up: float | Literal["mser"] = "mser",
    batches: int = 20,
    confidence: float = 0.95,
) -> pd.DataFrame:
    """Compute mean total demand over the capacity, the start of the run left out.

    Parameters
    ----------
    result : Result
        A run with totals recorded at equal distances.
    warm_up : float or "mser"
        How many units of time are left out; "mser" finds it for each resource.
    batches : int
        For the interval, see `batch_means`.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    DataFrame
        Index resource; columns warm_up (the first look at or after it), utilisation (over all from there to
        the end), standard_error, low, high, correlation (of neighbouring batches).  All are NaN where `mser`
        finds the run too short.

    Raises
    ------
    InputError
        If an argument is outside its range, or the problem changed during the run. If averages are not
        over all of the past, or agents tick at other times than 0, 1, 2, ... If the run did not integrate
        overshoot, which these are checked against. If totals were not recorded evenly, or too few of
        them.

    Notes
    -----
    Where averages are over all of the past, t times their sum A(t) is the integral of total demand. So
    the mean over (w, T] is exactly (T A(T) - w A(w)) / (T - w), and likewise between two recorded times.
    Discrete agents average over ticks 0 to k, where k is the next one; what counts at k has been held
    since the tick before. So (k + 1) A is the integral up to k, and the part beyond the recorded time is
    taken off.
    """
    parts = validation.integer("batches", batches, low=2)
    times, integrals = _integrals(result)
    ends = _even(times)
    lengths = np.diff(times[:ends])
    start = None if warm_up == "mser" else _start(times[: ends - 1], warm_up, result.until)
    rows = []
    for j, capacity in enumerate(result.problem.capacity):
        series = np.diff(integrals[:ends, j]) / lengths / capacity
        cut = mser(series) if start is None else start
        if cut is None:
            rows.append([np.nan] * 6)
            continue
        if len(series) - cut < parts:
            remedy = "record totals more often: Recording(demand=...) with a shorter period"
            allowed = f"{parts} or more, one for each batch"
            raise InputError.of("number of totals after the warm-up", len(series) - cut, allowed, remedy)
        found = batch_means(series, parts, confidence, leave_out=cut)
        begun, used = float(times[cut]), float(integrals[-1, j] - integrals[cut, j])
        mean = used / (result.until - begun) / capacity
        off = found.interval.half_width
        error = found.interval.standard_error
        rows.append([begun, mean, error, mean - off, mean + off, found.correlation])
    columns = ["warm_up", "utilisation", "standard_error", "low", "high", "correlation"]
    names = pd.Index(result.problem.resource_names, name="resource")
    return pd.DataFrame(rows, index=names, columns=columns)


def _start(begins: FloatArray, warm_up: float, until: float) -> int:
    start = validation.number("warm_up", warm_up, low=0.0, high=until, high_open=True)
    return int(np.searchsorted(begins, start))


def _integrals(result: Result) -> tuple[FloatArray, FloatArray]:
    """Integrate total demand from 0 to each look; the first is at 0, where nothing has been held."""
    if len(result.history) > 1:
        remedy = "result.pieces has the exact mean over each piece"
        raise InputError.of("number of pieces", len(result.history), "1: the problem may not change", remedy)
    seen = result.observations
    times = seen.demand_times[:, None]
    if result.dynamics == "continuous":
        integrals = times * seen.total_average
    else:
        ticks = np.ceil(times)
        integrals = (ticks + 1.0) * seen.total_average - (ticks - times) * seen.total_demand
    if not seen.stretches:
        remedy = "run it with Recording(overshoot=True)"
        raise InputError.of("exact integrals of the run", "missing", "there to check against", remedy)
    # A result does not tell how its agents average, nor what clocks they have: this does.
    exact = seen.stretches[0].used
    if not np.allclose(integrals[-1], exact, rtol=_ROUNDING, atol=0.0):
        off = float(np.nanmax(np.abs(integrals[-1] - exact) / exact))
        allowed = (
            "averages over all of the past, of agents that are continuous or tick together at 0, 1, 2, ..."
        )
        raise InputError.of("deviation of averages from the integral", off, allowed, _EXACT_INSTEAD)
    if seen.demand_times[0] == 0.0:
        return seen.demand_times, integrals
    return np.concatenate(([0.0], seen.demand_times)), np.vstack((np.zeros(integrals.shape[1]), integrals))


def _even(times: FloatArray) -> int:
    """Count the samples that lie evenly; the one at the end is left out where it comes early."""
    gaps = np.diff(times)
    if len(gaps) > 1 and gaps[-1] < np.median(gaps):
        gaps = gaps[:-1]
    ratio = float(gaps.max() / gaps.min())
    if ratio > _MOST_UNEVEN:
        remedy = "record them with a period and without a tail: Recording(demand=10.0, tail=0)"
        raise InputError.of(
            "longest over shortest time between totals", ratio, f"at most {_MOST_UNEVEN}", remedy
        )
    return len(gaps) + 1
