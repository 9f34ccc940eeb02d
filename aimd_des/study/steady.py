"""One long run: where its start-up ends, and how far the mean of what follows may be off."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import pandas as pd

from aimd_des import checks
from aimd_des.checks import FloatArray
from aimd_des.errors import InputError
from aimd_des.results import Result
from aimd_des.study.intervals import Interval, mean_interval

__all__ = ["BatchMeans", "batch_means", "mser", "steady_state"]

# Looks may lie so much farther apart in one place than in another: whole steps cannot be spread evenly.
_MOST_UNEVEN = 2.5
_FEWEST = 10


@dataclass(frozen=True)
class BatchMeans:
    """The mean of a series whose values depend on those before.

    Attributes
    ----------
    interval : Interval
        From the means of the batches, as if these were independent.
    correlation : float
        Between the means of neighbouring batches.  Clearly above 0 (two over the square root of the number of
        batches is what luck does), batches are too short, and so is the interval.
    """

    interval: Interval
    correlation: float


def mser(series: npt.ArrayLike, batch: int = 5) -> int | None:
    """Find how many values at the start of a series to leave out, since they still remember the start.

    Parameters
    ----------
    series : array_like, shape (q,)
        Values at equal distances.
    batch : int
        How many values are averaged before the search, which makes it robust.

    Returns
    -------
    int or None
        A multiple of the batch; None where no point in the first half is best, as with a series that is
        too short to have settled.

    Raises
    ------
    InputError
        If the series has fewer than ten batches, or a value is not finite.

    Notes
    -----
    MSER-5 of White, Cobb and Spratt (Proc. Winter Simulation Conference 2000, 755): the cut d at which
    the squared standard error of the rest, sum (y - mean)^2 / (n - d)^2, is least.
    """
    values = checks.array("series", series, ("n_times",))
    size = checks.integer("batch", batch, low=1)
    count = len(values) // size
    if count < _FEWEST:
        raise InputError.of("length of series", len(values), f"{_FEWEST * size} or more")
    means = values[: count * size].reshape(count, size).mean(axis=1)
    centred = (means - means.mean())[::-1]  # sums from the end, of small numbers
    kept = np.arange(1.0, count + 1.0)
    spread = np.cumsum(centred**2) - np.cumsum(centred) ** 2 / kept
    score = (np.maximum(spread, 0.0) / kept**2)[::-1]  # by the number of batches that are left out
    half = count // 2
    best = int(np.argmin(score[: half + 1]))
    return None if best == half else best * size


def batch_means(
    series: npt.ArrayLike, batches: int = 20, confidence: float = 0.95, *, leave_out: int = 0
) -> BatchMeans:
    """Estimate the mean of one long series whose values depend on those before.

    Parameters
    ----------
    series : array_like, shape (q,)
        Values at equal distances.
    batches : int
        Into how many parts it is cut, 2 or more; 10 to 30 is usual.
    confidence : float
        Between 0 and 1.
    leave_out : int
        How many values at the start are left out, see `mser`.

    Returns
    -------
    BatchMeans
        What does not fill a batch is left out at the start.

    Raises
    ------
    InputError
        If an argument is outside its range, or there are fewer values than batches.

    Notes
    -----
    Law, Simulation Modeling and Analysis, section 9.5.3.
    """
    values = checks.array("series", series, ("n_times",))
    parts = checks.integer("batches", batches, low=2)
    start = checks.integer("leave_out", leave_out, low=0)
    size = (len(values) - start) // parts
    if size < 1:
        raise InputError.of(
            "length of series", len(values), f"{parts + start} or more: a value for each batch"
        )
    means = values[len(values) - size * parts :].reshape(parts, size).mean(axis=1)
    return BatchMeans(mean_interval(means, confidence), _correlation(means))


def _correlation(means: FloatArray) -> float:
    centred = means - means.mean()
    power = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0


def steady_state(
    result: Result,
    warm_up: float | Literal["mser"] = "mser",
    batches: int = 20,
    confidence: float = 0.95,
) -> pd.DataFrame:
    """Estimate mean total demand over the capacity, the start of the run left out.

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
        Index resource; columns warm_up, utilisation, standard_error, low, high, correlation.  All are
        NaN where `mser` finds the run too short.

    Raises
    ------
    InputError
        If the problem changed while the run went on, totals were not recorded evenly, or too few of them.
    """
    times, totals = _even_looks(result)
    rows = []
    for j, capacity in enumerate(result.problem.capacity):
        series = totals[:, j] / capacity
        if warm_up == "mser":
            cut = mser(series)
        else:
            start = checks.number("warm_up", warm_up, low=0.0, high=result.until, high_open=True)
            cut = int(np.searchsorted(times, start))
        if cut is None:
            rows.append([np.nan] * 6)
            continue
        found = batch_means(series, batches, confidence, leave_out=cut)
        own = found.interval
        begun = float(times[cut]) if warm_up == "mser" else float(warm_up)
        rows.append([begun, own.mean, own.standard_error, own.low, own.high, found.correlation])
    columns = ["warm_up", "utilisation", "standard_error", "low", "high", "correlation"]
    names = pd.Index(result.problem.resource_names, name="resource")
    return pd.DataFrame(rows, index=names, columns=columns)


def _even_looks(result: Result) -> tuple[FloatArray, FloatArray]:
    """Take the totals; the look at the end is left out where it comes early."""
    if len(result.history) > 1:
        remedy = "result.pieces has the exact mean over each piece"
        raise InputError.of("number of pieces", len(result.history), "1: the problem may not change", remedy)
    seen = result.observations
    times, totals = seen.demand_times, seen.total_demand
    gaps = np.diff(times)
    if len(gaps) > 1 and gaps[-1] < np.median(gaps):
        times, totals, gaps = times[:-1], totals[:-1], gaps[:-1]
    if len(gaps) < _FEWEST or gaps.max() > _MOST_UNEVEN * gaps.min():
        remedy = "record them with a period and without a tail: Recording(demand=10.0, tail=0)"
        raise InputError.of("number of evenly recorded totals", len(times), f"more than {_FEWEST}", remedy)
    return times, totals
