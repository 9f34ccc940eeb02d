"""A loss of one's own: the link of an agent is down for a part of each period, as a satellite's is."""

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.lowlevel import Draws, lost_table, part


@numba.njit
def lost(u: float, time: float, period: float, length: float, offset: float) -> bool:  # noqa: ARG001
    """Say whether a copy is lost that is sent at a time; no chance decides, so u is not read."""
    return (time - offset) % period < length


@part("loss")
@dataclass(frozen=True)
class PeriodicOutage:
    """Loss of all copies that are sent during outages, which come at regular times.

    Parameters
    ----------
    period : float
        From the begin of one outage to the next, greater than 0, in units of time.
    length : float
        How long each is, at least 0, in units of time.
    staggered : bool
        Whether the outages of the agents are spread evenly over the period, or all at once.
    """

    period: float
    length: float
    staggered: bool = True

    def __post_init__(self) -> None:
        checks.number("PeriodicOutage.period", self.period, low=0.0, low_open=True)
        checks.number("PeriodicOutage.length", self.length, low=0.0)

    def start(self, n_agents: int) -> "_Outages":
        """Begin a run."""
        return _Outages(self, self.offset(n_agents))

    def table(self, n_agents: int) -> Any:
        """Let compiled code draw the same; without this method a fleet calls `draw`, more slowly."""
        return lost_table(lost, n_agents, self.period, self.length, self.offset(n_agents))

    def offset(self, n_agents: int) -> npt.NDArray[np.float64]:
        """Say when the first outage of each agent begins, shape (n,)."""
        return self.period * np.arange(n_agents) / n_agents if self.staggered else np.zeros(n_agents)


@dataclass(frozen=True, eq=False)
class _Outages:
    """The outages of one run."""

    model: PeriodicOutage
    offset: npt.NDArray[np.float64]

    def draw(self, draws: Draws) -> npt.NDArray[np.bool_]:
        """Say of each agent's copy whether it is lost, shape (n,)."""
        since = (draws.time - self.offset) % self.model.period
        return np.asarray(since < self.model.length)
