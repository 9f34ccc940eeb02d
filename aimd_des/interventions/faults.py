"""Faults of what is between the agents: the control unit goes down, the channel is partitioned."""

from collections.abc import Iterator
from dataclasses import dataclass

from aimd_des.engine.planned_changes import Change, Memory
from aimd_des.engine.system import System
from aimd_des.interventions.actions import cut_off, fail, reconnect, recover
from aimd_des.interventions.bookkeeping import BeginsAt
from aimd_des.problem.lookup import Agents, agent_indices
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in


@dataclass(frozen=True)
class _Fault(BeginsAt):
    """What begins at some time, and is over after a while."""

    at: float
    duration: float

    def __post_init__(self) -> None:
        super().__post_init__()
        name = f"{type(self).__name__}.duration"
        object.__setattr__(self, "duration", validation.number(name, self.duration, low=0.0, low_open=True))


@built_in("intervention", "failover")
@dataclass(frozen=True)
class Failover(_Fault):
    """The control unit goes down, and after a while another one takes over.

    Signals that are on their way arrive; those that would leave meanwhile, after their sensing delay, are
    lost.  Where faults overlap, it is down until the last of them is over.  The new unit knows of no
    hold-off, and begins with the shortest where hold-offs adapt: one that senses crossings does so at once,
    one that samples at its next sampling instant.

    Parameters
    ----------
    at : float
        When it goes down, at least 0.
    duration : float
        For how long no control unit senses, greater than 0.
    """

    def check(self, problem: Problem) -> None:
        """Accept any problem."""

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Let the control unit fail, and be replaced."""
        yield self.at, lambda: fail(system)
        yield self.at + self.duration, lambda: recover(system)


@built_in("intervention", "partition")
@dataclass(frozen=True)
class Partition(_Fault):
    """The channel is partitioned, and heals: signals that leave meanwhile are lost on some agents.

    Signals that are on their way when it begins arrive.  Where partitions overlap, an agent hears again when
    the last of them that cuts it off is over.

    Parameters
    ----------
    at : float
        When it begins, at least 0.
    duration : float
        How long it lasts, greater than 0.
    agents : str, int or sequence of these, optional
        Which agents are cut off; default: all.
    """

    agents: Agents | None = None

    def check(self, problem: Problem) -> None:
        """Refuse what does not fit a problem."""
        self._indices(problem)

    def _indices(self, problem: Problem) -> list[int]:
        return list(range(problem.n_agents)) if self.agents is None else agent_indices(problem, self.agents)

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Cut agents off, and reconnect them."""
        agents = self._indices(system.problem)
        yield self.at, lambda: cut_off(system, agents)
        yield self.at + self.duration, lambda: reconnect(system, agents)
