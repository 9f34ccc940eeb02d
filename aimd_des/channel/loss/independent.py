"""Losses that remember nothing: of single copies, and of whole broadcasts."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des.channel.loss.kernels import Cause, TabledLoss, loss_table
from aimd_des.channel.parameters import scalar_or_row
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray


@built_in("loss", "bernoulli")
@brief
@dataclass(frozen=True, eq=False)
class Bernoulli:
    """Every copy is lost with a probability of its own, independent of all others.

    Parameters
    ----------
    probability : float or array_like, shape (n,)
        Probability of loss for all agents or for each, from 0 to 1.
    """

    probability: npt.ArrayLike

    def __post_init__(self) -> None:
        # Named as the channel's argument: mostly it is given there, as a bare number.
        clean = validation.per_agent("loss", self.probability, low=0.0, high=1.0)
        object.__setattr__(self, "probability", clean)

    @property
    def mean(self) -> float | FloatArray:
        """Share of copies that are lost: the probability."""
        return scalar_or_row(self.probability)

    def start(self, n_agents: int) -> TabledLoss:
        """Begin a run: independent losses remember nothing."""
        validation.fits("loss", self.probability, n_agents)
        cause = Cause.CHANCE if np.any(self.probability) else Cause.NOTHING
        return TabledLoss(loss_table(cause, n_agents, self.probability))


@built_in("loss", "common")
@brief
@dataclass(frozen=True, eq=False)
class CommonMode:
    """A whole broadcast is lost, for all agents at once, independent of all other broadcasts.

    Parameters
    ----------
    probability : float
        Probability that a broadcast is lost, from 0 to 1.
    """

    probability: float

    def __post_init__(self) -> None:
        clean = validation.number("CommonMode.probability", self.probability, low=0.0, high=1.0)
        object.__setattr__(self, "probability", clean)

    @property
    def mean(self) -> float:
        """Share of copies that are lost: the probability."""
        return self.probability

    def start(self, n_agents: int) -> TabledLoss:
        """Begin a run: independent losses remember nothing."""
        return TabledLoss(loss_table(Cause.COMMON, n_agents, self.probability))
