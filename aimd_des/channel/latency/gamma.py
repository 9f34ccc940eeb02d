"""Gamma latency beside a fixed part.

Drawn by rejection (G. Marsaglia and W. W. Tsang, "A simple method for generating gamma variables",
ACM Transactions on Mathematical Software 26, 2000): with d = shape - 1/3, z normal and
v = (1 + z / sqrt(9 d))**3, the candidate d * v is accepted with probability at least 0.95.  A shape
below 1 is drawn as shape + 1 and multiplied by u**(1 / shape).  Attempt k of an agent has addresses
of its own, so that what it gets depends on no other agent.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aimd_des.channel.draws import Draws
from aimd_des.channel.latency.base import Parametrised
from aimd_des.channel.parameters import LONGEST, fit, scalar_or_row, take
from aimd_des.checks import FloatArray
from aimd_des.compiled import kernel
from aimd_des.elementary import exps, log, logs, standard_normal
from aimd_des.streams import Purpose

__all__ = ["ShiftedGamma"]

# Beyond the first, the power of a uniform number is 0; beyond the second, the test for acceptance
# loses the digits that it needs.
_SMALLEST_SHAPE, _LARGEST_SHAPE = 1e-6, 1e9

# Far from the numbers of any attempt.
_POWER = 1 << 31

# No gamma number is negative.
_WAITING = -1.0


@dataclass(frozen=True, eq=False)
class ShiftedGamma(Parametrised):
    """A fixed part, such as propagation, and a gamma distributed one, such as waiting in queues.

    Parameters
    ----------
    shape : float or array_like, shape (n,)
        From 1e-6 to 1e9; with 1 the random part is exponential.
    scale : float or array_like, shape (n,)
        Mean of the random part over its shape, at least 0, in units of time.
    shift : float or array_like, shape (n,)
        The fixed part, at least 0, in units of time.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    shape: float | FloatArray
    scale: float | FloatArray
    shift: float | FloatArray = 0.0
    _each: ClassVar = ("shape", "scale", "shift")

    def __post_init__(self) -> None:
        take(self, "shape", low=_SMALLEST_SHAPE, high=_LARGEST_SHAPE)
        take(self, "scale", "shift", low=0.0, high=LONGEST)
        fit(self, self._each)

    @property
    def mean(self) -> float | FloatArray:
        """Shift + shape * scale, in units of time."""
        return scalar_or_row(self.shift + self.shape * self.scale)

    @property
    def variance(self) -> float | FloatArray:
        """Shape * scale**2, in squared units of time."""
        return scalar_or_row(self.shape * (self.scale * self.scale))

    def draw(self, draws: Draws) -> FloatArray:
        """Return the latency of each agent's copy.

        Parameters
        ----------
        draws : Draws
            The broadcast's random numbers.

        Returns
        -------
        ndarray, shape (n,)
            In units of time.
        """
        shape = np.broadcast_to(self.shape, (draws.n_agents,))
        small = shape < 1.0
        standard = _gamma(np.where(small, shape + 1.0, shape), draws)
        if small.any():
            power = exps(logs(1.0 - draws.uniforms(Purpose.LATENCY, _POWER)) / shape)
            standard = np.where(small, standard * power, standard)
        return self.shift + self.scale * standard


def _gamma(shape: FloatArray, draws: Draws) -> FloatArray:
    """Draw with scale 1 and a shape of at least 1 for each agent."""
    d = shape - 1.0 / 3.0
    value = np.full(len(shape), _WAITING)
    attempt = 0
    waiting = len(shape)
    while waiting:
        normal = draws.uniforms(Purpose.LATENCY, 2 * attempt)
        chance = draws.uniforms(Purpose.LATENCY, 2 * attempt + 1)
        waiting = _accept(d, normal, chance, value)
        attempt += 1
    return value


@kernel
def _accept(d: FloatArray, normal: FloatArray, chance: FloatArray, value: FloatArray) -> int:
    """Make one attempt for every agent that waits; return how many still do."""
    waiting = 0
    for i in range(value.shape[0]):
        if value[i] == _WAITING:
            z = standard_normal(normal[i])
            root = 1.0 + z / math.sqrt(9.0 * d[i])
            cube = root * root * root
            if root > 0.0 and log(1.0 - chance[i]) < 0.5 * z * z + d[i] * (1.0 - cube + log(cube)):
                value[i] = d[i] * cube
            else:
                waiting += 1
    return waiting
