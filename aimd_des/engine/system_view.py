"""What can be read off the agents of a run in progress, at any time and without changing anything."""

import math
import warnings
from collections.abc import Callable
from functools import cached_property

import numpy as np

from aimd_des.dynamics.clocks import AgentClocks
from aimd_des.dynamics.demand import demand_at
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.dynamics.totals import average_of, observe, observe_totals, piece, total_of, totals
from aimd_des.engine.environment import OrderedEnvironment
from aimd_des.problem.lookup import agent_index, resource_index
from aimd_des.problem.problem import Problem
from aimd_des.utils.deprecation import renamed
from aimd_des.utils.direct_calls import direct
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.validation import FloatArray


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
    parameters : AgentParameters
        Parameters of their rule.
    tick_weight : float
        1 where agents tick, 0 in continuous time.

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
        parameters: AgentParameters,
        tick_weight: float,
    ) -> None:
        self.problem = problem
        self.env, self.clocks, self.state, self.parameters, self.tick_weight = (
            env,
            clocks,
            state,
            parameters,
            tick_weight,
        )
        # Kept, since looks are many.
        self._now, self._values = np.empty(1), piece(problem.n_resources)
        self._total_of: Callable[..., float] | None = None
        self._observe_totals: Callable[..., None] | None = None

    # Made when they are read: a fleet needs neither.
    @cached_property
    def rows(self) -> State:
        """Views of the rows of the state."""
        return State(*([memoryview(row) for row in array] for array in self.state))  # type: ignore[arg-type]

    @cached_property
    def _lines(self) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        state = self.state
        return list(zip(state.demand, self.parameters.increase, state.anchor, strict=True))

    @property
    def law(self) -> AgentParameters:
        """The old name of `parameters`."""
        warnings.warn(renamed("System.law", "System.parameters"), DeprecationWarning, stacklevel=2)
        return self.parameters

    def settle(self) -> None:
        """Bring agents that are advanced together to where events have come; reading does it, too."""
        raise NotImplementedError  # `System` knows which agents are advanced together

    def clock_time(self, agent: int | None = None) -> float:
        """Return the time up to which ticks lie in the past: now, or just after where agents have acted.

        Parameters
        ----------
        agent : int, optional
            i; default: all agents.

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
        j = resource_index(self.problem, resource)
        self.settle()
        given = (*self._lines[j], self.moments(), self.tick_weight)
        if self._total_of is None:
            self._total_of = direct(total_of, *given)
        return self._total_of(*given)

    def totals(self) -> FloatArray:
        """Sum the demand of all agents for every resource as it is now.

        Returns
        -------
        ndarray, shape (m,)
            In units of the resources.
        """
        self.settle()
        total = np.empty(len(self.parameters.limit))
        totals(self.state, self.parameters, self.moments(), self.tick_weight, total)
        return total

    def observe_totals(self, demand: FloatArray, average: FloatArray) -> None:
        """Sum demand and averages of all agents as they are now.

        Parameters
        ----------
        demand, average : ndarray, shape (m,)
            Receive the sums, in units of the resources.
        """
        self.settle()
        whole = (self.state, self.parameters, self.moments(), self.tick_weight)
        given = (*whole, self._values, demand, average)
        if self._observe_totals is None:
            self._observe_totals = direct(observe_totals, *given)
        self._observe_totals(*given)

    def allocations(self) -> tuple[FloatArray, FloatArray]:
        """Read demand and average of every agent as they are now.

        Returns
        -------
        demand, average : ndarray, shape (m, n)
            In units of the resources.
        """
        demand, average = np.empty_like(self.state.demand), np.empty_like(self.state.demand)
        self.observe_allocations(demand, average)
        return demand, average

    def observe_allocations(self, demand: FloatArray, average: FloatArray) -> None:
        """Read demand and average of every agent as they are now into arrays that are there.

        Parameters
        ----------
        demand, average : ndarray, shape (m, n)
            Receive the numbers, in units of the resources.
        """
        self.settle()
        observe(self.state, self.parameters, self.moments(), self.tick_weight, demand, average)

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
        return demand_at(
            self.rows.demand[j][i], float(self.parameters.increase[j, i]), since, self.tick_weight
        )

    @described_like(demand)
    def average(self, agent: str | int, resource: str | int) -> float:
        """Read one agent's long-term average of one resource as it is now."""
        i, j = agent_index(self.problem, agent), resource_index(self.problem, resource)
        self.settle()
        return float(average_of(self.state, self.parameters, j, i, self.moment(i), self.tick_weight))
