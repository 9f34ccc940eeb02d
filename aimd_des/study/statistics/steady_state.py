"""One long run: where its start-up ends, and how far the mean of what follows may be off."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des.study.statistics.intervals import Interval, mean_interval
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

# Fewer batches than these say nothing about where a start ends.
_FEWEST = 10


@dataclass(frozen=True)
class BatchMeans:
    """The mean of a series whose values depend on those before.

    Attributes
    ----------
    interval : Interval
        From the means of the batches, as if these were independent.
    correlation : float
        Between the means of neighbouring batches.  Clearly above 0 (random error is up to two over the square
        root of the number of batches), batches are too short, and so is the interval.
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
    The cut d at which the squared standard error of the rest, sum (y - mean)^2 / (n - d)^2, is least: White,
    Simulation 69 (1997) 323; over means of five, MSER-5, White, Cobb and Spratt, Proc. Winter Simulation
    Conference 2000, 755.  Near the end of a series the sum is small by chance, so only the first half counts.
    """
    values = validation.array("series", series, ("n_times",))
    size = validation.integer("batch", batch, low=1)
    count = len(values) // size
    if count < _FEWEST:
        raise InputError.of(
            "length of series", len(values), f"{_FEWEST * size} or more", "look more often, or run longer"
        )
    means = values[: count * size].reshape(count, size).mean(axis=1)
    # From where the series ends up sums stay small, and are 0 where it does not move.
    centred = (means - np.median(means[count // 2 :]))[::-1]
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
    values = validation.array("series", series, ("n_times",))
    parts = validation.integer("batches", batches, low=2)
    start = validation.integer("leave_out", leave_out, low=0)
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
