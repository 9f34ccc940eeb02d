"""What every model of latency does, and what those with parameters share."""

from typing import ClassVar, Protocol, runtime_checkable

from aimd_des.channel.draws import Draws
from aimd_des.channel.parameters import fit
from aimd_des.checks import FloatArray
from aimd_des.streams import Purpose

__all__ = ["Inverted", "Latency", "Parametrised"]


@runtime_checkable
class Latency(Protocol):
    """A model of latency: one number for each agent and broadcast, independent of all others."""

    def check(self, n_agents: int) -> None:
        """Refuse parameters that are given for each agent and do not number n."""
        ...

    def draw(self, draws: Draws) -> FloatArray:
        """Return the latency of each agent's copy, shape (n,), at least 0, in units of time."""
        ...


class Parametrised:
    """A model whose parameters are one for all agents or one for each."""

    _each: ClassVar[tuple[str, ...]]

    def check(self, n_agents: int) -> None:
        """Refuse parameters that are given for each agent and do not number n.

        Parameters
        ----------
        n_agents : int
            n.

        Raises
        ------
        InputError
            Naming both lengths.
        """
        fit(self, self._each, n_agents)


class Inverted(Parametrised):
    """A model that turns one uniform number into a latency by its quantile function.

    The larger the number, the longer the latency: two such models with the same seed are late for
    the same agents and broadcasts, which makes comparisons between them sharp.
    """

    def _quantile(self, uniform: FloatArray) -> FloatArray:
        raise NotImplementedError

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
        return self._quantile(draws.uniforms(Purpose.LATENCY))
