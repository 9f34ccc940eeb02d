"""Logarithm, exponential and normal quantile that give the same bits on every machine.

Mathematical libraries differ in the last bit from one machine to the next, and a bit in a latency
may change the order of two arrivals, and with it a whole run.  These functions are made of
IEEE + - * / and square root, which are rounded correctly everywhere, and of the exponent of a
number, which is exact.  They are good to 1 unit in the last place, the quantile to 8.

    log    x = 2**k * (1 + f), s = f / (2 + f):  k * log 2 + 2 * artanh(s)
    exp    x = k * log 2 + r, |r| <= log(2) / 2:  2**k * exp(r), from the series of r * coth(r / 2)

W. J. Cody and W. Waite, "Software Manual for the Elementary Functions", 1980; M. J. Wichura,
"Algorithm AS 241: The percentage points of the normal distribution", Applied Statistics 37, 1988.
"""

import math

import numpy as np
import numpy.typing as npt

from aimd_des.utils.jit import formula, instruction, kernel
from aimd_des.utils.validation import FloatArray

# log 2 in two parts. The first has 20 bits to spare, so that its product with an exponent is exact.
_LOG2_HIGH, _LOG2_LOW = float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33")
_PER_LOG2 = 1.4426950408889634
_ROOT_HALF = 0.7071067811865476

# How many bits a fraction has.
_BITS = 52
_SCALE = float(1 << _BITS)

# Numbers below it have fewer bits.
_SMALLEST = float.fromhex("0x1p-1022")

# Beyond these, exp is inf or 0 in double precision.
_EXP_HIGHEST, _EXP_LOWEST = 709.782712893384, -745.1332191019412

# Half the width of a cell of the uniform numbers, which are multiples of 2**-53.
_HALF_CELL = 2.0**-54


@instruction
def _split_normal(x: float) -> tuple[float, float]:
    """Return the fraction, from 1/2 to 1, and the exponent of a number of at least 2**-1022."""
    return math.frexp(x)


@instruction
def _floor(x: float) -> float:
    """Return the largest whole number that is not above a number."""
    return float(math.floor(x))


@instruction
def _power_of_two(exponent: float) -> float:
    """Return 2**k for a whole number k from -1022 to 1023."""
    return math.ldexp(1.0, int(exponent))


@formula
def _log_of(fraction: float, exponent: float) -> float:
    """Return the logarithm of fraction * 2**exponent, where the fraction is from 1/2 to 1."""
    small = fraction < _ROOT_HALF
    fraction, exponent = 2.0 * fraction if small else fraction, exponent - 1.0 if small else exponent
    f = fraction - 1.0
    s = f / (2.0 + f)
    z = s * s
    # 2 * artanh(s) = 2 * s + s * tail; ten terms reach beyond the last bit, for z < 0.0295.
    tail = 2.0 / 17.0 + z * (2.0 / 19.0 + z * (2.0 / 21.0))
    tail = 2.0 / 11.0 + z * (2.0 / 13.0 + z * (2.0 / 15.0 + z * tail))
    tail = z * (2.0 / 3.0 + z * (2.0 / 5.0 + z * (2.0 / 7.0 + z * (2.0 / 9.0 + z * tail))))
    # 2 * s is written as f - (half - s * half), so that its rounding is small beside f.
    half = 0.5 * f * f
    low = s * (half + tail) + exponent * _LOG2_LOW
    return exponent * _LOG2_HIGH - ((half - low) - f)


@formula
def log(x: float) -> float:
    """Return the natural logarithm.

    Parameters
    ----------
    x : float
        At least 0; the logarithm of 0 is -inf.

    Returns
    -------
    float
        Within 1 unit in the last place; nan where x is negative or nan.
    """
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else (x if x > 0.0 else math.nan)
    # Of a number below 2**-1022 the fraction has other bits.
    normal = x >= _SMALLEST
    fraction, exponent = _split_normal(x if normal else x * _SCALE)
    return _log_of(fraction, exponent if normal else exponent - _BITS)


@formula
def log_normal(x: float) -> float:
    """Return the natural logarithm of a normal number, in a form that compilers can vectorise."""
    fraction, exponent = _split_normal(x)
    return _log_of(fraction, exponent)


@formula
def log1p(x: float) -> float:
    """Return log(1 + x) without loss where x is small.

    Parameters
    ----------
    x : float
        At least -1.

    Returns
    -------
    float
        Within 2 units in the last place.
    """
    sum_ = 1.0 + x
    if sum_ == 1.0 or not -1.0 < x < math.inf:
        return x if sum_ == 1.0 else log(sum_)
    return log(sum_) + (x - (sum_ - 1.0)) / sum_


@formula
def exp(x: float) -> float:
    """Return the exponential.

    Parameters
    ----------
    x : float
        Any number.

    Returns
    -------
    float
        Within 1 unit in the last place; inf above 709.78 and 0 below -745.13; nan where x is nan.
    """
    if not _EXP_LOWEST <= x <= _EXP_HIGHEST:
        return math.inf if x > 0.0 else (0.0 if x < 0.0 else x)
    k = _floor(x * _PER_LOG2 + 0.5)
    high, low = x - k * _LOG2_HIGH, k * _LOG2_LOW
    r = high - low
    z = r * r
    # r * coth(r / 2) - 2 has Bernoulli numbers in its series; the next term is below the last bit.
    tail = 1.0 / 23950080.0 + z * (-691.0 / 653837184000.0 + z * (1.0 / 37362124800.0))
    tail = z * (1.0 / 6.0 + z * (-1.0 / 360.0 + z * (1.0 / 15120.0 + z * (-1.0 / 604800.0 + z * tail))))
    c = r - tail
    # exp(r) = 1 + r + r * c / (2 - c), added up with the rounding errors of both sums.
    rest = r * c / (2.0 - c) - low
    partial = high + rest
    value = 1.0 + partial
    value += ((1.0 - value) + partial) + ((high - partial) + rest)
    # Two factors: 2**1024 is no number, and results below 2**-1022 must be rounded once only.
    first = _floor(0.5 * k)
    return value * _power_of_two(first) * _power_of_two(k - first)


@formula
def expm1(x: float) -> float:
    """Return exp(x) - 1 without loss where x is small.

    Parameters
    ----------
    x : float
        Any number.

    Returns
    -------
    float
        Within 3 units in the last place.
    """
    power = exp(x)
    if power == 1.0 or not -40.0 < x < _EXP_HIGHEST:
        return x if power == 1.0 else power - 1.0
    # The rounding error of the power is in its logarithm too, and cancels (W. Kahan).
    return (power - 1.0) * (x / log(power))


@formula
def _central(q: float) -> float:
    """Return the quantile at 0.5 + q, |q| <= 0.425."""
    r = 0.180625 - q * q
    above = 2.5090809287301226727e3 * r + 3.3430575583588128105e4
    above = ((above * r + 6.7265770927008700853e4) * r + 4.5921953931549871457e4) * r
    above = ((above + 1.3731693765509461125e4) * r + 1.9715909503065514427e3) * r
    above = (above + 1.3314166789178437745e2) * r + 3.3871328727963666080e0
    below = 5.2264952788528545610e3 * r + 2.8729085735721942674e4
    below = ((below * r + 3.9307895800092710610e4) * r + 2.1213794301586595867e4) * r
    below = ((below + 5.3941960214247511077e3) * r + 6.8718700749205790830e2) * r
    below = (below + 4.2313330701600911252e1) * r + 1.0
    return q * above / below


@formula
def _near_tail(r: float) -> float:
    """Return minus the quantile at exp(-(r + 1.6)**2), for r up to 3.4."""
    above = 7.74545014278341407640e-4 * r + 2.27238449892691845833e-2
    above = ((above * r + 2.41780725177450611770e-1) * r + 1.27045825245236838258e0) * r
    above = ((above + 3.64784832476320460504e0) * r + 5.76949722146069140550e0) * r
    above = (above + 4.63033784615654529590e0) * r + 1.42343711074968357734e0
    below = 1.05075007164441684324e-9 * r + 5.47593808499534494600e-4
    below = ((below * r + 1.51986665636164571966e-2) * r + 1.48103976427480074590e-1) * r
    below = ((below + 6.89767334985100004550e-1) * r + 1.67638483018380384940e0) * r
    below = (below + 2.05319162663775882187e0) * r + 1.0
    return above / below


@formula
def _far_tail(r: float) -> float:
    """Return minus the quantile at exp(-(r + 5)**2), for r above 0."""
    above = 2.01033439929228813265e-7 * r + 2.71155556874348757815e-5
    above = ((above * r + 1.24266094738807843860e-3) * r + 2.65321895265761230930e-2) * r
    above = ((above + 2.96560571828504891230e-1) * r + 1.78482653991729133580e0) * r
    above = (above + 5.46378491116411436990e0) * r + 6.65790464350110377720e0
    below = 2.04426310338993978564e-15 * r + 1.42151175831644588870e-7
    below = ((below * r + 1.84631831751005468180e-5) * r + 7.86869131145613259100e-4) * r
    below = ((below + 1.48753612908506148525e-2) * r + 1.36929880922735805310e-1) * r
    below = (below + 5.99832206555887937690e-1) * r + 1.0
    return above / below


@formula
def standard_normal(uniform: float) -> float:
    """Return the normal number with mean 0 and variance 1 that a uniform number stands for.

    It is the quantile at the middle of the cell [u, u + 2**-53) of the unit interval, so that 0
    gives a number too, and u and 1 - 2**-53 - u give opposite ones.

    Parameters
    ----------
    uniform : float
        A multiple of 2**-53 on [0, 1), as streams give them.

    Returns
    -------
    float
        From -8.3 to 8.3, within 8 units in the last place.
    """
    q = (uniform - 0.5) + _HALF_CELL
    if -0.425 <= q <= 0.425:
        return _central(q)
    tail = uniform + _HALF_CELL if q < 0.0 else (1.0 - uniform) - _HALF_CELL
    r = math.sqrt(-log(tail))
    size = _near_tail(r - 1.6) if r <= 5.0 else _far_tail(r - 5.0)
    return -size if q < 0.0 else size


@kernel
def _log_row(row: FloatArray) -> None:
    for i in range(row.shape[0]):
        row[i] = log(row[i])


@kernel
def _exp_row(row: FloatArray) -> None:
    for i in range(row.shape[0]):
        row[i] = exp(row[i])


def logs(values: npt.ArrayLike) -> FloatArray:
    """Return the natural logarithm of every element.

    Parameters
    ----------
    values : array_like
        At least 0, of any shape.

    Returns
    -------
    ndarray
        What `log` gives, of the same shape.
    """
    out = np.array(values, dtype=np.float64, order="C")
    _log_row(out.reshape(-1))
    return out


def exps(values: npt.ArrayLike) -> FloatArray:
    """Return the exponential of every element.

    Parameters
    ----------
    values : array_like
        Of any shape.

    Returns
    -------
    ndarray
        What `exp` gives, of the same shape.
    """
    out = np.array(values, dtype=np.float64, order="C")
    _exp_row(out.reshape(-1))
    return out
