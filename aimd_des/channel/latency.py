"""How long the copies of a signal are on their way."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.channel.draws import Draws
from aimd_des.checks import FloatArray

__all__ = ["Constant", "Latency"]


@runtime_checkable
class Latency(Protocol):
    """A model of latency: one number for each agent and broadcast, independent of all others."""

    def check(self, n_agents: int) -> None:
        """Refuse parameters that are given for each agent and do not number n."""
        ...

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

    def check(self, n_agents: int) -> None:
        """Refuse a latency for each agent where their number is not n.

        Parameters
        ----------
        n_agents : int
            n.

        Raises
        ------
        InputError
            Naming both lengths.
        """
        checks.fits("latency", self.value, n_agents)

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
        return np.broadcast_to(np.asarray(self.value, dtype=np.float64), (draws.n_agents,))
