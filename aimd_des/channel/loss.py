"""Which copies of a signal never arrive."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.channel.draws import Draws
from aimd_des.streams import Purpose

__all__ = ["Bernoulli", "Loss", "LossProcess"]

BoolArray = npt.NDArray[np.bool_]


class LossProcess(Protocol):
    """The losses of one run; it may remember what was before."""

    def draw(self, draws: Draws) -> BoolArray:
        """Return whether each agent's copy is lost, shape (n,); broadcasts come in the order of time."""
        ...


@runtime_checkable
class Loss(Protocol):
    """A model of loss, which starts afresh with every run."""

    def start(self, n_agents: int) -> LossProcess:
        """Begin a run with n agents."""
        ...


@dataclass(frozen=True, eq=False)
class Bernoulli:
    """Every copy is lost with a probability of its own, independent of all others.

    Parameters
    ----------
    probability : float or array_like, shape (n,)
        Probability of loss for all agents or for each, from 0 to 1.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    probability: npt.ArrayLike

    def __post_init__(self) -> None:
        clean = checks.per_agent("loss", self.probability, low=0.0, high=1.0)
        object.__setattr__(self, "probability", clean)

    def start(self, n_agents: int) -> "Bernoulli":
        """Begin a run: independent losses remember nothing.

        Parameters
        ----------
        n_agents : int
            n.

        Returns
        -------
        Bernoulli
            Itself.

        Raises
        ------
        InputError
            If there is a probability for each agent and their number is not n.
        """
        checks.fits("loss", self.probability, n_agents)
        return self

    def draw(self, draws: Draws) -> BoolArray:
        """Return whether each agent's copy is lost.

        Parameters
        ----------
        draws : Draws
            The broadcast's random numbers.

        Returns
        -------
        ndarray of bool, shape (n,)
            True where the copy is lost.
        """
        if not np.any(self.probability):
            return np.zeros(draws.n_agents, dtype=np.bool_)
        return np.less(draws.uniforms(Purpose.LOSS), self.probability)
