"""What every model of latency does, and what those with parameters share."""

from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from aimd_des.channel.latency.kernels import LatencyTable, latency_row
from aimd_des.channel.parameters import fit
from aimd_des.channel.random_draws import Draws
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray


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
    """A model whose parameters are one for all agents or one for each.

    Most turn one uniform number into a latency by the quantile function.  The larger the number, the
    longer the latency: two such models with the same seed are late for the same agents and broadcasts,
    which makes comparisons between them sharp.
    """

    _each: ClassVar[tuple[str, ...]]

    def check(self, n_agents: int) -> None:
        """Refuse parameters that are given for each agent and do not number n."""
        fit(self, self._each, n_agents)

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code.

        Parameters
        ----------
        n_agents : int
            n.

        Returns
        -------
        LatencyTable
            The distribution and its parameters.
        """
        raise NotImplementedError

    def draw(self, draws: Draws) -> FloatArray:
        """Return the latency of each agent's copy."""
        out, spare = np.empty((2, draws.n_agents))
        address = draws.keys[Purpose.LATENCY], draws.resource, draws.number, draws.lane(0)
        latency_row(self.table(draws.n_agents), *address, out, spare)
        return np.asarray(out)
