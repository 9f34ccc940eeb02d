"""An intervention of one's own: agents leave one after the other, and come back in the same order."""

from dataclasses import dataclass

from aimd_des import InputError, Problem, checks, interventions
from aimd_des.lowlevel import EventKind, ProcessGenerator, System, part


@part("intervention")
@dataclass(frozen=True)
class Exodus:
    """The first agents leave, one after the other, and come back.

    Parameters
    ----------
    at : float
        When the first one leaves, at least 0, in units of time.
    count : int
        How many leave.
    gap : float
        From one to the next, at least 0, in units of time.
    stay : float
        How long each is away, greater than 0, in units of time.
    """

    at: float
    count: int
    gap: float = 10.0
    stay: float = 50.0

    def __post_init__(self) -> None:
        checks.number("Exodus.at", self.at, low=0.0)
        checks.integer("Exodus.count", self.count, low=1)
        checks.number("Exodus.gap", self.gap, low=0.0)
        checks.number("Exodus.stay", self.stay, low=0.0, low_open=True)

    def check(self, problem: Problem) -> None:
        """Refuse to take all agents away."""
        if self.count >= problem.n_agents:
            raise InputError.of(
                "Exodus.count", self.count, f"less than the number of agents, {problem.n_agents}"
            )

    def process(self, system: System) -> ProcessGenerator:
        """Take agents away, and bring them back."""
        leaving = [(self.at + k * self.gap, interventions.leave, k) for k in range(self.count)]
        coming = [(time + self.stay, interventions.join, agent) for time, _, agent in leaving]
        for time, act, agent in sorted(leaving + coming, key=lambda change: change[0]):
            yield system.env.at(time, EventKind.INTERVENE)
            act(system, agent)
