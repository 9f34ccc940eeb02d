"""The random numbers of one broadcast: each has the address (purpose, resource, broadcast, agent)."""

from collections.abc import Mapping
from dataclasses import dataclass

from aimd_des.utils import rng
from aimd_des.utils.rng import Key, Purpose
from aimd_des.utils.validation import FloatArray

#: Lanes of a second copy are kept apart from those of the first.
LANES_PER_COPY = 1 << 32

#: Each of several models of loss draws from its own lanes; those of the first are what it would have alone.
LANES_PER_PART = 1 << 16


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
    part : int
        Which of several models of loss.
    """

    keys: Mapping[Purpose, Key]
    resource: int
    number: int
    time: float
    n_agents: int
    copy: int = 0
    part: int = 0

    def lane(self, attempt: int) -> int:
        """Return where the numbers of an attempt stand.

        Parameters
        ----------
        attempt : int
            Which of several numbers, for methods that need more than one.

        Returns
        -------
        int
            The lane of `rng.uniforms_row`.
        """
        return self.copy * LANES_PER_COPY + self.part * LANES_PER_PART + attempt

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
        key, lane = self.keys[purpose], self.lane(attempt)
        return rng.uniforms(key, self.resource, self.number, self.n_agents, lane)
