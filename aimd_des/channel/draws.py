"""The random numbers of one broadcast: each has the address (purpose, resource, broadcast, agent)."""

from dataclasses import dataclass

from aimd_des import streams
from aimd_des.checks import FloatArray
from aimd_des.streams import Key, Purpose

__all__ = ["Draws"]


@dataclass(frozen=True)
class Draws:
    """What the models of latency and loss draw from.

    Parameters
    ----------
    keys : mapping of Purpose to Key
        The run's keys.
    resource : int
        j.
    number : int
        b, the broadcast's number among those for resource j.
    n_agents : int
        n.
    """

    keys: dict[Purpose, Key]
    resource: int
    number: int
    n_agents: int

    def uniforms(self, purpose: Purpose) -> FloatArray:
        """Draw one uniform number for each agent.

        Parameters
        ----------
        purpose : Purpose
            What for; the same purpose gives the same numbers again.

        Returns
        -------
        ndarray, shape (n,)
            On [0, 1).
        """
        return streams.uniforms(self.keys[purpose], self.resource, self.number, self.n_agents)
