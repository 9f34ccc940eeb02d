"""Means of independent replications, and how far they may be off: Student's intervals, alone and in pairs."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


@dataclass(frozen=True)
class Interval:
    """A mean and its confidence interval.

    Attributes
    ----------
    mean : float
        In the unit of the values.
    standard_error : float
        Of the mean; NaN where there is one value only.
    low, high : float
        Ends of the interval; without bound where there is one value only.
    count : int
        How many values.
    confidence : float
        Probability with which such an interval holds the truth.
    """

    mean: float
    standard_error: float
    low: float
    high: float
    count: int
    confidence: float

    @property
    def half_width(self) -> float:
        """Half of the length of the interval, in the unit of the values."""
        return (self.high - self.low) / 2.0


def quantile(confidence: float, degrees: npt.ArrayLike) -> FloatArray:
    """Compute how many standard errors an interval reaches to either side."""
    from scipy import special  # slow to import

    level = validation.number("confidence", confidence, low=0.0, high=1.0, low_open=True, high_open=True)
    free = np.asarray(degrees, dtype=np.float64)
    known = np.where(free > 0.0, free, 1.0)
    # What scipy.stats.t.ppf calls, without its checks of shapes, which take most of its time.
    return np.where(free > 0.0, special.stdtrit(known, (1.0 + level) / 2.0), np.inf)


def mean_interval(values: npt.ArrayLike, confidence: float = 0.95) -> Interval:
    """Estimate a mean from independent replications.

    Parameters
    ----------
    values : array_like, shape (r,)
        One number for each replication.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    Interval
        By Student's t with r - 1 degrees of freedom.

    Raises
    ------
    InputError
        If there is no value, or one is not finite: leave out runs without a number yourself, and say so.
    """
    sample = validation.array("values", values, ("n_replications",))
    if len(sample) == 0:
        raise InputError.of("number of values", 0, "1 or more")
    count = len(sample)
    error = float(sample.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    return _around(float(sample.mean()), error, count - 1, count, confidence)


@described_like(mean_interval)
def paired_difference(values: npt.ArrayLike, baseline: npt.ArrayLike, confidence: float = 0.95) -> Interval:
    """Estimate the difference of two means from replications with the same random numbers.

    Parameters
    ----------
    values, baseline : array_like, shape (r,)
        One number for each replication; those at the same place had the same seed.

    Returns
    -------
    Interval
        Of values less baseline, by Student's t on the differences.

    Raises
    ------
    InputError
        If lengths differ, there is no value, or one is not finite.
    """
    first = validation.array("values", values, ("n_replications",))
    second = validation.array("baseline", baseline, ("n_replications",))
    if len(first) != len(second):
        raise InputError.of("length of baseline", len(second), f"{len(first)}, the length of values")
    return mean_interval(first - second, confidence)


@described_like(paired_difference)
def difference(values: npt.ArrayLike, baseline: npt.ArrayLike, confidence: float = 0.95) -> Interval:
    """Estimate the difference of two means from replications that have nothing in common.

    Parameters
    ----------
    values, baseline : array_like, shapes (r,) and (q,)
        One number for each replication.

    Returns
    -------
    Interval
        Of values less baseline; `count` is the smaller number of replications.

    Raises
    ------
    InputError
        If there is no value, or one is not finite.

    Notes
    -----
    By Welch: Biometrika 34 (1947) 28, with his degrees of freedom.
    """
    one, other = mean_interval(values, confidence), mean_interval(baseline, confidence)
    count = min(one.count, other.count)
    own, its = one.standard_error**2, other.standard_error**2
    error = math.sqrt(own + its)
    free = math.nan
    if error > 0.0:
        free = (own + its) ** 2 / (own**2 / (one.count - 1) + its**2 / (other.count - 1))
    elif count > 1:
        free = one.count + other.count - 2
    return _around(one.mean - other.mean, error, free, count, confidence)


def _around(mean: float, error: float, degrees: float, count: int, confidence: float) -> Interval:
    reach = float(quantile(confidence, 0.0 if math.isnan(degrees) else degrees))
    off = reach * error if count > 1 else math.inf
    return Interval(mean, error, mean - off, mean + off, count, confidence)
