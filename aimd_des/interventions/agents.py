"""Agents that come, go, crash and come back, and that need more for a while; prices that change."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count

from aimd_des.engine.planned_changes import Change, Memory, Planned
from aimd_des.engine.system import System
from aimd_des.interventions.actions import join, leave
from aimd_des.interventions.bookkeeping import BeginsAt
from aimd_des.interventions.prices import checked_costs, redraw, weigh
from aimd_des.problem.costs import Costs
from aimd_des.problem.lookup import Agents, agent_indices
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in


class _OfAgents:
    """What interventions on agents share: the agents must exist."""

    agents: Agents

    def check(self, problem: Problem) -> None:
        """Refuse what does not fit a problem.

        Parameters
        ----------
        problem : Problem
            The agents that share.

        Raises
        ------
        InputError
            If there is no such agent, one is named twice, or none is named.
        """
        agent_indices(problem, self.agents)


@dataclass(frozen=True)
class _ForATime(BeginsAt, _OfAgents):
    """What begins at some time and is over at a later one, or never."""

    agents: Agents
    at: float
    until: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.until is not None:
            name = f"{type(self).__name__}.until"
            until = validation.number(name, self.until, low=self.at, low_open=True)
            object.__setattr__(self, "until", until)


class _Away(_ForATime):
    """What takes agents away."""

    @property
    def span(self) -> tuple[float, float]:
        """From when to when the agents are away."""
        return self.at, math.inf if self.until is None else self.until


@built_in("intervention", "join")
@dataclass(frozen=True)
class Join(_OfAgents, Planned):
    """Agents are not there at first and join the run at some time.

    Parameters
    ----------
    agents : str, int or sequence of these
        Names, or i.
    at : float
        When, greater than 0.
    """

    agents: Agents
    at: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", validation.number("Join.at", self.at, low=0.0, low_open=True))

    @property
    def span(self) -> tuple[float, float]:
        """From when to when the agents are away."""
        return 0.0, self.at

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Keep the agents away until then."""
        return _away(system, self.agents, 0.0, self.at, anew=True)


@built_in("intervention", "absence")
@dataclass(frozen=True)
class Absence(_Away):
    """Agents leave, and may come back with their average as it was.

    Parameters
    ----------
    agents : str, int or sequence of these
        Names, or i.
    at : float
        When they leave, at least 0: what they hold is released in that instant.
    until : float, optional
        When they come back, later than that; default: never.
    """

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Let the agents go, and come back."""
        return _away(system, self.agents, self.at, self.until, anew=False)


@built_in("intervention", "crash")
@dataclass(frozen=True)
class Crash(_Away):
    """Agents crash: what they hold is released, and if they come back they have forgotten their average.

    Parameters
    ----------
    agents : str, int or sequence of these
        Names, or i.
    at : float
        When they crash, at least 0.
    until : float, optional
        When they come back, later than that; default: never.
    """

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Let the agents crash, and come back."""
        return _away(system, self.agents, self.at, self.until, anew=True)


def _away(system: System, agents: Agents, at: float, until: float | None, *, anew: bool) -> Iterator[Change]:
    indices = agent_indices(system.problem, agents)

    def go() -> None:
        for agent in indices:
            leave(system, agent)

    def come_back() -> None:
        for agent in indices:
            join(system, agent, anew=anew)

    yield at, go
    if until is not None:
        yield until, come_back


@built_in("intervention", "unusual_activity")
@dataclass(frozen=True)
class UnusualActivity(_ForATime):
    """Agents see something unusual and need more for a while: their private costs are scaled.

    Parameters
    ----------
    agents : str, int or sequence of these
        Names, or i.
    at : float
        When it begins, at least 0.
    until : float, optional
        When it is over, later than that; default: never.
    weight : float
        What their costs are multiplied by, greater than 0: below 1 they hold more.  Those of activities at
        the same time are multiplied.
    """

    weight: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        clean = validation.number("UnusualActivity.weight", self.weight, low=0.0, low_open=True)
        object.__setattr__(self, "weight", clean)

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Scale the costs, and put them back."""
        own = memory["name"]
        yield self.at, lambda: weigh(system, self.agents, self.weight, by=own)
        if self.until is not None:
            yield self.until, lambda: weigh(system, self.agents, 1.0, by=own)


@dataclass(frozen=True, eq=False)
class Prices(Planned):
    """The private costs of all agents are drawn anew at given intervals.

    Parameters
    ----------
    every : float
        The interval, greater than 0: the k-th costs hold from k * every on.
    draw : callable
        ``draw(k)`` returns the k-th costs, k = 1, 2, ..., of the same shape as the problem's, and as
        separable.  It must give the same costs whenever it is called with the same k.
    """

    every: float
    draw: Callable[[int], Costs]

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "every", validation.number("Prices.every", self.every, low=0.0, low_open=True)
        )
        if not callable(self.draw):
            raise InputError.of("Prices.draw", self.draw, "a function of the number of the draw")

    @property
    def begins(self) -> float:
        """When it first changes something, in units of time."""
        return self.every

    def check(self, problem: Problem) -> None:
        """Refuse what does not fit a problem."""
        checked_costs(problem, self.draw(1))

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Change the costs again and again."""

        def renew(k: int) -> None:
            redraw(system, self.draw(k), (str(memory["name"]), k))

        for k in count(1):
            yield k * self.every, partial(renew, k)
