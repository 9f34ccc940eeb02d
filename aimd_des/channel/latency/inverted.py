"""Latencies drawn by inversion: uniform, exponential, lognormal and Pareto."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from aimd_des.channel.latency.base import Parametrised
from aimd_des.channel.latency.kernels import Distribution, LatencyTable, latency_table
from aimd_des.channel.parameters import LONGEST, fit, refuse, scalar_or_row, take
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in
from aimd_des.utils.portable_math import expm1, exps, log1p
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray

# The largest uniform number is 1 - 2**-53: with this shape its latency is 2**530 times the minimum.
_SMALLEST_PARETO_SHAPE = 0.1

# Here the standard deviation is 6e48 times the mean, and the mean as many times the median.
_LARGEST_SIGMA = 15.0
_LARGEST_RATIO = 1e49


def _applied(function: Callable[[float], float], values: FloatArray) -> FloatArray:
    """Apply a formula to every element."""
    return np.array([function(value) for value in values.ravel().tolist()]).reshape(values.shape)


@built_in("latency", "uniform")
@brief
@dataclass(frozen=True, eq=False)
class Uniform(Parametrised):
    """Any latency between two bounds with equal probability.

    Parameters
    ----------
    low, high : float or array_like, shape (n,)
        Shortest and longest latency, at least 0 and not below `low`, in units of time.
    """

    low: float | FloatArray
    high: float | FloatArray
    _each: ClassVar = ("low", "high")

    def __post_init__(self) -> None:
        take(self, "low", "high", low=0.0, high=LONGEST)
        fit(self, self._each)
        refuse(self, "high", np.less(self.high, self.low), "at least Uniform.low")

    @property
    def mean(self) -> float | FloatArray:
        """(low + high) / 2, in units of time."""
        return scalar_or_row(0.5 * (self.low + self.high))

    @property
    def variance(self) -> float | FloatArray:
        """(high - low)**2 / 12, in squared units of time."""
        width = self.high - self.low
        return scalar_or_row(width * width / 12.0)

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.UNIFORM, n_agents, self.low, self.high)


@built_in("latency", "exponential")
@brief
@dataclass(frozen=True, eq=False)
class Exponential(Parametrised):
    """Latency without memory: often short, sometimes long.

    Parameters
    ----------
    mean : float or array_like, shape (n,)
        At least 0, in units of time.
    """

    mean: float | FloatArray
    _each: ClassVar = ("mean",)

    def __post_init__(self) -> None:
        take(self, "mean", low=0.0, high=LONGEST)

    @property
    def variance(self) -> float | FloatArray:
        """mean**2, in squared units of time."""
        return scalar_or_row(self.mean * self.mean)

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.EXPONENTIAL, n_agents, self.mean)


@built_in("latency", "lognormal")
@brief
@dataclass(frozen=True, eq=False)
class LogNormal(Parametrised):
    """Latency whose logarithm is normal: most are near the median, a few are much longer.

    Given by its own mean and standard deviation, not by those of its logarithm; see `from_median`
    for the other way.

    Parameters
    ----------
    mean : float or array_like, shape (n,)
        Greater than 0, in units of time.
    std : float or array_like, shape (n,)
        Standard deviation, at least 0, in units of time.

    Attributes
    ----------
    median : float or ndarray, shape (n,)
        mean / sqrt(1 + (std / mean)**2), in units of time.
    sigma : float or ndarray, shape (n,)
        Standard deviation of the logarithm, sqrt(log(1 + (std / mean)**2)).
    """

    mean: float | FloatArray
    std: float | FloatArray
    median: float | FloatArray = field(init=False, repr=False)
    sigma: float | FloatArray = field(init=False, repr=False)
    _each: ClassVar = ("mean", "std")

    def __post_init__(self) -> None:
        take(self, "mean", low=0.0, low_open=True, high=LONGEST)
        take(self, "std", low=0.0, high=LONGEST)
        fit(self, self._each)
        crowded = np.greater(self.std, _LARGEST_RATIO * self.mean)
        refuse(self, "std", crowded, f"at most {_LARGEST_RATIO:g} times LogNormal.mean")
        ratio = np.asarray(self.std / self.mean)
        object.__setattr__(self, "median", scalar_or_row(self.mean / np.sqrt(1.0 + ratio * ratio)))
        object.__setattr__(self, "sigma", scalar_or_row(np.sqrt(_applied(log1p, ratio * ratio))))

    @classmethod
    def from_median(cls, median: float | FloatArray, sigma: float | FloatArray) -> "LogNormal":
        """Make the model from its median and the standard deviation of its logarithm.

        Parameters
        ----------
        median : float or array_like, shape (n,)
            Greater than 0, in units of time.
        sigma : float or array_like, shape (n,)
            From 0 to 15; about 16 % of latencies are above median * exp(sigma).

        Returns
        -------
        LogNormal
            With mean median * exp(sigma**2 / 2).
        """
        middle = validation.per_agent("LogNormal.median", median, low=0.0, low_open=True, high=LONGEST)
        spread = np.asarray(validation.per_agent("LogNormal.sigma", sigma, low=0.0, high=_LARGEST_SIGMA))
        mean = middle * exps(0.5 * (spread * spread))
        std = mean * np.sqrt(_applied(expm1, spread * spread))
        return cls(scalar_or_row(mean), scalar_or_row(std))

    @property
    def variance(self) -> float | FloatArray:
        """std**2, in squared units of time."""
        return scalar_or_row(self.std * self.std)

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.LOGNORMAL, n_agents, self.median, self.sigma)


@built_in("latency", "pareto")
@brief
@dataclass(frozen=True, eq=False)
class Pareto(Parametrised):
    """Latency with a heavy tail: the probability to exceed x is (minimum / x)**shape.

    Parameters
    ----------
    shape : float or array_like, shape (n,)
        Tail exponent, at least 0.1; the mean is infinite up to 1, the variance up to 2.
    minimum : float or array_like, shape (n,)
        Shortest latency, greater than 0, in units of time.
    """

    shape: float | FloatArray
    minimum: float | FloatArray
    _each: ClassVar = ("shape", "minimum")

    def __post_init__(self) -> None:
        take(self, "shape", low=_SMALLEST_PARETO_SHAPE, high=LONGEST)
        take(self, "minimum", low=0.0, low_open=True, high=LONGEST)
        fit(self, self._each)

    @property
    def mean(self) -> float | FloatArray:
        """Shape * minimum / (shape - 1), in units of time; inf for a shape up to 1."""
        beyond = np.asarray(self.shape) - 1.0
        finite = np.where(beyond > 0.0, beyond, np.inf)
        return scalar_or_row(np.where(beyond > 0.0, self.minimum * (1.0 + 1.0 / finite), np.inf))

    @property
    def variance(self) -> float | FloatArray:
        """Shape * minimum**2 / ((shape - 1)**2 * (shape - 2)), squared time; inf for a shape up to 2."""
        shape = np.where(np.asarray(self.shape) > 2.0, self.shape, np.inf)
        spread = self.minimum / (shape - 1.0)
        finite = spread * spread * (1.0 + 2.0 / (shape - 2.0))
        return scalar_or_row(np.where(np.isfinite(shape), finite, np.inf))

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.PARETO, n_agents, self.shape, self.minimum)
