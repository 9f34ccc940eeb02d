r"""The sum S = sum_i |X_i| of jointly normal variates: its mean, and the interval that holds 95 % of it.

For normal variates with the covariances c_ij, moments of products of functions are series in c_ij,

    E prod_i f_i(X_i) = exp(sum_{i<j} c_ij d_i d_j) prod_i E f_i,

d_i being the derivative by the mean of X_i.  For |x| these derivatives of the mean are erf and a bell curve

    d = E sign(X) = erf(b / (s sqrt 2)),   h = 2 phi(b / s) / s,

and variances and third moments of one |X_i| are known.  So the first three cumulants of S are sums over
agents, pairs and triples, here up to c**2 for two and to the products of two or three c for three.  The
interval is that of a gamma variate with these cumulants, shifted.  Beside draws it errs by up to a tenth of
the standard deviation of S with five agents, and by a hundredth from twenty on.
"""

import math

import numpy as np
from scipy.special import erf, gammaincinv

from aimd_des.utils.validation import FloatArray

_OUTSIDE = 0.025
_NORMAL = 1.959964  # the quantile of the standard normal distribution that belongs to it
# With less skewness a gamma variate is a normal one to all digits that matter.
_SKEWED = 1e-3


def absolute_mean(mean: FloatArray, spread: FloatArray) -> FloatArray:
    """Compute the mean absolute value of normal variates."""
    safe = np.where(spread > 0.0, spread, 1.0)
    ratio = mean / safe
    value = spread * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) + mean * erf(ratio / np.sqrt(2.0))
    return np.where(spread > 0.0, value, np.abs(mean))


def absolute_interval(
    mean: FloatArray, variance: FloatArray, shared: FloatArray | None, common: FloatArray | float = 0.0
) -> tuple[float, float]:
    """Say between which bounds S is.

    `shared` are the covariances, (n, n), with 0 on the diagonal; besides, all are off together by one normal
    variate times `common`, (n,), which is small.
    """
    varied = variance > 0.0
    center, second, third = float(np.abs(mean[~varied]).sum()), 0.0, 0.0
    if varied.any():
        among = None if shared is None else shared[np.ix_(varied, varied)]
        first, second, third = _cumulants(mean[varied], variance[varied], among)
        center += first
    signs = np.where(varied, erf(mean / np.sqrt(2.0 * np.where(varied, variance, 1.0))), np.sign(mean))
    width = math.sqrt(max(second, 0.0) + float((signs * common).sum()) ** 2)
    if width == 0.0:
        return center, center
    skewness = third / width**3
    if abs(skewness) < _SKEWED:
        return center - _NORMAL * width, center + _NORMAL * width
    shape = 4.0 / skewness**2
    bounds = (gammaincinv(shape, [_OUTSIDE, 1.0 - _OUTSIDE]) - shape) / math.sqrt(shape)
    low, high = sorted((center + math.copysign(width, skewness) * bounds).tolist())
    return max(low, 0.0), high


def _cumulants(b: FloatArray, variance: FloatArray, shared: FloatArray | None) -> tuple[float, float, float]:
    """Compute the first three cumulants of S."""
    s = np.sqrt(variance)
    ratio = b / s
    bell = np.exp(-0.5 * ratio**2) / np.sqrt(2.0 * np.pi)
    d, h = erf(ratio / np.sqrt(2.0)), 2.0 * bell / s
    first = absolute_mean(b, s)
    square = variance + b**2
    cube = s**3 * (2.0 * bell * (ratio**2 + 2.0) + (ratio**3 + 3.0 * ratio) * d)
    second = float((square - first**2).sum())
    third = float((cube - 3.0 * first * square + 2.0 * first**3).sum())
    if shared is not None:
        squared = shared**2
        second += float(d @ shared @ d + 0.5 * h @ squared @ h)
        # Of (|X_i| - E|X_i|)**2: its mean derivatives are these.
        once, twice = 2.0 * (b - first * d), 2.0 * (1.0 - first * h)
        third += 3.0 * float(once @ shared @ d + 0.5 * twice @ squared @ h)
        third += 3.0 * float(h @ ((shared @ d) ** 2 - squared @ d**2))
        ring = shared * h
        third += float(((ring @ ring) * ring.T).sum())
    return float(first.sum()), second, third
