"""The random numbers of one broadcast: each has the address (purpose, resource, broadcast, agent)."""

from collections.abc import Mapping
from dataclasses import dataclass

from aimd_des import streams
from aimd_des.checks import FloatArray
from aimd_des.streams import Key, Purpose

__all__ = ["Draws"]

# Lanes of a second copy are kept apart from those of the first.
_LANES_PER_COPY = 1 << 32


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
    time : float
        When the broadcast leaves the control unit, in units of time.
    n_agents : int
        n.
    copy : int
        0 for the copies that every broadcast makes, 1 for duplicates.
    """

    keys: Mapping[Purpose, Key]
    resource: int
    number: int
    time: float
    n_agents: int
    copy: int = 0

    def uniforms(self, purpose: Purpose, attempt: int = 0) -> FloatArray:
        """Draw one uniform number for each agent.

        Parameters
        ----------
        purpose : Purpose
            What for; the same purpose gives the same numbers again.
        attempt : int
            Which of several numbers, for methods that need more than one.

        Returns
        -------
        ndarray, shape (n,)
            On [0, 1).
        """
        lane = self.copy * _LANES_PER_COPY + attempt
        return streams.uniforms(self.keys[purpose], self.resource, self.number, self.n_agents, lane)
