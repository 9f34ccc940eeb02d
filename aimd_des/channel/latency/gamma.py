"""Gamma latency beside a fixed part."""

from dataclasses import dataclass
from typing import ClassVar

from aimd_des.channel.latency.base import Parametrised
from aimd_des.channel.latency.kernels import Distribution, LatencyTable, latency_table
from aimd_des.channel.parameters import LONGEST, fit, scalar_or_row, take
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray

# Beyond the first, the power of a uniform number is 0; beyond the second, the test for acceptance
# loses the digits that it needs.
_SMALLEST_SHAPE, _LARGEST_SHAPE = 1e-6, 1e9


@built_in("latency", "gamma")
@brief
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

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.GAMMA, n_agents, self.shape, self.scale, self.shift)
