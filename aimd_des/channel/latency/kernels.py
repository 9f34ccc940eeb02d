"""The latencies of one broadcast as compiled code draws them: every formula stands here, and only here.

With u the uniform number of the copy and z the normal number that it stands for:

    constant     value
    uniform      low + (high - low) * u
    exponential  -mean * log(1 - u)
    lognormal    median * exp(sigma * z)
    Pareto       minimum * (1 - u)**(-1 / shape)
    empirical    scale * (value number floor(u * n_values))
    own          quantile(u, ...), a function of the user's

and a gamma number by rejection (G. Marsaglia and W. W. Tsang, "A simple method for generating gamma
variables", ACM Transactions on Mathematical Software 26, 2000): with d = shape - 1/3, z normal and
v = (1 + z / sqrt(9 d))**3, the candidate d * v is accepted with probability at least 0.95.  A shape
below 1 is drawn as shape + 1 and multiplied by u**(1 / shape).  Attempt k of an agent has addresses
of its own, so that what it gets depends on no other agent.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.channel.latency.compiled_quantile import call_quantile
from aimd_des.utils.jit import deferred, formula, kernel, routine
from aimd_des.utils.locked_arrays import each
from aimd_des.utils.portable_math import exp, log, log_normal, standard_normal
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key, uniform_at, uniforms_row
from aimd_des.utils.validation import FloatArray

# Far from the numbers of any attempt.
_POWER = 1 << 31


class Distribution(IntEnum):
    """How latencies are distributed."""

    CONSTANT = 0
    UNIFORM = 1
    EXPONENTIAL = 2
    LOGNORMAL = 3
    PARETO = 4
    EMPIRICAL = 5
    GAMMA = 6
    OWN = 7


# Plain numbers, as kernels take them.
_CONSTANT, _UNIFORM, _EXPONENTIAL, _LOGNORMAL, _PARETO, _EMPIRICAL, _GAMMA, _OWN = (
    int(distribution) for distribution in Distribution
)


@record
class LatencyTable(NamedTuple):
    """A model of latency for compiled code."""

    distribution: int  # of `Distribution`
    # (n,): its parameters in the order in which the model's constructor has them (of a lognormal one: median
    # and sigma; of an empirical one: scale); parameters that are not needed are 0.
    first: FloatArray
    second: FloatArray
    third: FloatArray
    values: FloatArray  # (v,): measured latencies, ascending; empty for other distributions
    quantile: int  # address of the user's own function, compiled for rows; 0 for other distributions


def latency_table(
    distribution: Distribution,
    n_agents: int,
    *parameters: npt.ArrayLike,
    values: npt.ArrayLike = (),
    quantile: int = 0,
) -> LatencyTable:
    """Lay out a model for compiled code."""
    given = (*parameters, 0.0, 0.0, 0.0)[:3]
    first, second, third = (each(parameter, (n_agents,)) for parameter in given)
    measured = np.array(values, dtype=np.float64)
    return LatencyTable(int(distribution), first, second, third, measured, quantile)


@kernel
def _exponential_row(mean: FloatArray, out: FloatArray) -> None:
    for i in range(out.shape[0]):
        # 1 - u is exact and never 0; 0 - log keeps a latency of zero from being -0.0.
        out[i] = mean[i] * (0.0 - log_normal(1.0 - out[i]))


@deferred
def _other_row(table: LatencyTable, out: FloatArray) -> None:
    """Turn uniform numbers into latencies of a distribution that is neither exponential nor constant."""
    distribution, first, second = table.distribution, table.first, table.second
    count = table.values.shape[0]
    for i in range(out.shape[0]):
        u = out[i]
        if distribution == _UNIFORM:
            # Never above the longest: the largest u makes the product a last bit less than the width.
            out[i] = first[i] + (second[i] - first[i]) * u
        elif distribution == _LOGNORMAL:
            out[i] = first[i] * exp(second[i] * standard_normal(u))
        elif distribution == _PARETO:
            out[i] = second[i] * exp(log(1.0 - u) / -first[i])
        else:
            # The product may round up to the number of values.
            out[i] = first[i] * table.values[min(int(u * count), count - 1)]


@routine
def quantile_row(table: LatencyTable, out: FloatArray) -> None:
    """Turn uniform numbers into latencies: the larger the number, the longer the latency."""
    distribution, first, second = table.distribution, table.first, table.second
    if distribution == _CONSTANT:
        for i in range(out.shape[0]):
            out[i] = first[i]
    elif distribution == _EXPONENTIAL:
        _exponential_row(first, out)
    elif distribution == _OWN:
        rows = out.ctypes.data, first.ctypes.data, second.ctypes.data, table.third.ctypes.data
        call_quantile(table.quantile, (out.shape[0], *rows))
    else:
        _other_row(table, out)


@formula
def _candidate(d: float, normal: float, chance: float) -> float:
    """Return a gamma number over its scale, or -1 if this attempt is rejected."""
    z = standard_normal(normal)
    root = 1.0 + z / math.sqrt(9.0 * d)
    cube = root * root * root
    if root > 0.0 and log(1.0 - chance) < 0.5 * z * z + d * (1.0 - cube + log(cube)):
        return d * cube
    return -1.0


@deferred
def _gamma_row(
    table: LatencyTable, key: Key, resource: int, number: int, lane: int, out: FloatArray, spare: FloatArray
) -> None:
    uniforms_row(key, resource, number, lane, out)
    uniforms_row(key, resource, number, lane + 1, spare)
    for i in range(out.shape[0]):
        shape = table.first[i]
        d = (shape + 1.0 if shape < 1.0 else shape) - 1.0 / 3.0
        value = _candidate(d, out[i], spare[i])
        attempt = 0
        while value < 0.0:
            attempt += 1
            normal = uniform_at(key, resource, number, lane + 2 * attempt, i)
            value = _candidate(d, normal, uniform_at(key, resource, number, lane + 2 * attempt + 1, i))
        if shape < 1.0:
            value = value * exp(log(1.0 - uniform_at(key, resource, number, lane + _POWER, i)) / shape)
        out[i] = table.third[i] + table.second[i] * value


@formula
def is_improper(table: LatencyTable, drawn: FloatArray, found: FloatArray) -> bool:
    """Tell whether a function of the user's has given what is no latency; `found` has what it gave then."""
    wrong = False
    if table.distribution == _OWN:
        for i in range(drawn.shape[0]):
            wrong |= not drawn[i] >= 0.0  # not a number is none, too
        for i in range(drawn.shape[0] if wrong else 0):
            found[i] = drawn[i]
    return wrong


@kernel
def latency_row(
    table: LatencyTable, key: Key, resource: int, number: int, lane: int, out: FloatArray, spare: FloatArray
) -> None:
    """Draw the latencies of one broadcast."""
    if table.distribution == _GAMMA:
        _gamma_row(table, key, resource, number, lane, out, spare)
    else:
        if table.distribution != _CONSTANT:
            uniforms_row(key, resource, number, lane, out)
        quantile_row(table, out)
