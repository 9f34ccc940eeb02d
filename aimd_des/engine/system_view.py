"""What can be read off the agents of a run in progress, at any time and without changing anything."""

import math

import numpy as np

from aimd_des.dynamics.clocks import AgentClocks
from aimd_des.dynamics.response import demand_at
from aimd_des.dynamics.state import Law, State
from aimd_des.dynamics.totals import average_of, observe, observe_totals, total_of, totals
from aimd_des.engine.environment import OrderedEnvironment
from aimd_des.problem.lookup import agent_index, resource_index
from aimd_des.problem.problem import Problem
from aimd_des.utils.validation import FloatArray

__all__ = ["Readings"]


class Readings:
    """The state of all agents, and where they are in their own time.

    Parameters
    ----------
    problem : Problem
        Whose agents and resources may be given by name.
    env : OrderedEnvironment
        Decides when something happens.
    clocks : AgentClocks, optional
        The clocks of discrete agents; continuous agents have none.
    state : State
        State of all agents, as arrays of shape (m, n).
    law : Law
        Parameters of their rule.
    grain : float
        Grain of time of that rule.

    Attributes
    ----------
    rows : State
        The same memory as views of rows, which hand out Python's numbers: several times faster
        than NumPy's, one at a time.
    """

    def __init__(
        self,
        problem: Problem,
        env: OrderedEnvironment,
        clocks: AgentClocks | None,
        state: State,
        law: Law,
        grain: float,
    ) -> None:
        self.problem = problem
        self.env, self.clocks, self.state, self.law, self.grain = env, clocks, state, law, grain
        self.rows = State(*([memoryview(row) for row in array] for array in state))  # type: ignore[arg-type]
        self._now = np.empty(1)  # kept, since `moments` is called at every look

    def settle(self) -> None:
        """Bring agents that are advanced together to where events have come; reading does it, too."""
        raise NotImplementedError  # `System` knows who is advanced together

    def clock_time(self, agent: int | None = None) -> float:
        """Return the time up to which ticks lie in the past: now, or just after where agents have acted.

        Parameters
        ----------
        agent : int, optional
            i; all agents unless given.

        Returns
        -------
        float
            For `AgentClocks.next_tick` and `next_ticks`.
        """
        # Ticks are counted before a time; the next number after now lets those at this very instant count.
        now = float(self.env.now)
        return math.nextafter(now, math.inf) if self.env.has_acted(agent) else now

    def moments(self) -> FloatArray:
        """Return where the agents are in their own time: the next tick, or the time.

        Returns
        -------
        ndarray, shape (n,), or (1,) where it is common to all
            Overwritten by the next call.
        """
        if self.clocks is not None:
            return self.clocks.next_ticks(self.clock_time())
        self._now[0] = self.env.now
        return self._now

    def total(self, resource: str | int) -> float:
        """Sum the demand of all agents for one resource as it is now.

        Parameters
        ----------
        resource : str or int
            Its name, or j.

        Returns
        -------
        float
            In units of the resource.

        Raises
        ------
        InputError
            If there is no such resource.
        """
        j, state = resource_index(self.problem, resource), self.state
        self.settle()
        return total_of(state.demand[j], self.law.increase[j], state.anchor[j], self.moments(), self.grain)

    def totals(self) -> FloatArray:
        """Sum the demand of all agents for every resource as it is now.

        Returns
        -------
        ndarray, shape (m,)
            In units of the resources.
        """
        self.settle()
        total = np.empty(len(self.law.limit))
        totals(self.state, self.law, self.moments(), self.grain, total)
        return total

    def observe_totals(self, demand: FloatArray, average: FloatArray) -> None:
        """Sum demand and averages of all agents as they are now.

        Parameters
        ----------
        demand, average : ndarray, shape (m,)
            Receive the sums, in units of the resources.
        """
        self.settle()
        observe_totals(self.state, self.law, self.moments(), self.grain, demand, average)

    def allocations(self) -> tuple[FloatArray, FloatArray]:
        """Read demand and average of every agent as they are now.

        Returns
        -------
        demand, average : ndarray, shape (m, n)
            In units of the resources.
        """
        self.settle()
        demand, average = np.empty_like(self.state.demand), np.empty_like(self.state.demand)
        observe(self.state, self.law, self.moments(), self.grain, demand, average)
        return demand, average

    def moment(self, agent: int) -> float:
        """Return where one agent is in its own time.

        Parameters
        ----------
        agent : int
            i.

        Returns
        -------
        float
            The index of its next tick or, of a continuous agent, the time.
        """
        # A discrete agent counts its ticks, since its demand and average are those of whole numbers of them.
        if self.clocks is None:
            return float(self.env.now)
        return float(self.clocks.next_tick(agent, self.clock_time()))

    def demand(self, agent: str | int, resource: str | int) -> float:
        """Read one agent's demand for one resource as it is now.

        Parameters
        ----------
        agent, resource : str or int
            Their names, or i and j.

        Returns
        -------
        float
            In units of the resource.

        Raises
        ------
        InputError
            If there is no such agent, or no such resource.
        """
        i, j = agent_index(self.problem, agent), resource_index(self.problem, resource)
        self.settle()
        # After settling: an answer that was due has begun a new line.
        since = self.moment(i) - self.rows.anchor[j][i]
        return demand_at(self.rows.demand[j][i], float(self.law.increase[j, i]), since, self.grain)

    def average(self, agent: str | int, resource: str | int) -> float:
        """Read one agent's long-term average of one resource as it is now.

        Parameters
        ----------
        agent, resource : str or int
            Their names, or i and j.

        Returns
        -------
        float
            In units of the resource.

        Raises
        ------
        InputError
            If there is no such agent, or no such resource.
        """
        i, j = agent_index(self.problem, agent), resource_index(self.problem, resource)
        self.settle()
        return float(average_of(self.state, self.law, j, i, self.moment(i), self.grain))
