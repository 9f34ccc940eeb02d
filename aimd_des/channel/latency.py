"""How long the copies of a signal are on their way."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.channel.draws import Draws
from aimd_des.checks import FloatArray

__all__ = ["Constant", "Latency"]


class Latency(Protocol):
    """A model of latency: one number for each agent and broadcast."""

    def draw(self, draws: Draws) -> FloatArray:
        """Return the latency of each agent's copy, shape (n,), at least 0, in units of time."""
        ...


@dataclass(frozen=True, eq=False)
class Constant:
    """The same latency for every broadcast.

    Parameters
    ----------
    value : float or array_like, shape (n,)
        Latency of all agents or of each, at least 0, in units of time.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    value: npt.ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", checks.per_agent("latency", self.value, low=0.0))

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

        Raises
        ------
        InputError
            If there is a value for each agent and their number is not n.
        """
        checks.fits("latency", self.value, draws.n_agents)
        return np.full(draws.n_agents, self.value)
