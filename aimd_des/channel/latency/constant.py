"""The same latency for every broadcast."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des.channel.latency.base import Parametrised
from aimd_des.channel.latency.kernels import Distribution, LatencyTable, latency_table
from aimd_des.channel.parameters import LONGEST, scalar_or_row
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray


@built_in("latency", "constant")
@brief
@dataclass(frozen=True, eq=False)
class Constant(Parametrised):
    """The same latency for every broadcast.

    Parameters
    ----------
    value : float or array_like, shape (n,)
        Latency of all agents or of each, at least 0, in units of time.
    """

    value: npt.ArrayLike

    def __post_init__(self) -> None:
        # Named as the channel's argument: mostly it is given there, as a bare number.
        object.__setattr__(self, "value", validation.per_agent("latency", self.value, low=0.0, high=LONGEST))

    @property
    def mean(self) -> float | FloatArray:
        """The value itself, in units of time."""
        return scalar_or_row(self.value)

    @property
    def variance(self) -> float | FloatArray:
        """Zero."""
        return scalar_or_row(np.zeros(np.shape(self.value)))

    def check(self, n_agents: int) -> None:
        """Refuse a latency for each agent where their number is not n."""
        validation.fits("latency", self.value, n_agents)

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.CONSTANT, n_agents, self.value)
