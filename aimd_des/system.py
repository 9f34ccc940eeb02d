"""One run in progress: what the control unit, the channel, the agents and observers share."""

import math
from collections.abc import Callable

import numpy as np

from aimd_des import checks, streams
from aimd_des.channel import Channel
from aimd_des.checks import FloatArray
from aimd_des.clock import AgentClocks, Clocks
from aimd_des.environment import OrderedEnvironment
from aimd_des.log import Entry, EventLog
from aimd_des.population import State, law_of, observe, observe_totals, start, total_of, totals
from aimd_des.problem import Problem
from aimd_des.response import CONTINUOUS, DISCRETE, accumulated_at, demand_at, time_average
from aimd_des.streams import Purpose
from aimd_des.transmission import Transmitter
from aimd_des.transport import Agent, Carrier, Collective, ResponseDraws, Signal

__all__ = ["System"]


class System:
    """What the parts of one run share.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many.
    channel : Channel
        Carries the broadcasts.
    clocks : Clocks, optional
        The clocks of discrete agents; continuous agents have none.
    seed : int
        The run's seed.
    until : float
        The end of the run.
    log : EventLog, optional
        Where every event is written.

    Attributes
    ----------
    env : OrderedEnvironment
        Decides when something happens.
    state, law : State, Law
        State of all agents and parameters of their rule, as arrays of shape (m, n).
    rows : State
        The same memory as views of rows, which hand out Python's numbers: several times faster
        than NumPy's, one at a time.
    agents : dict of int to Agent
        The agents that are processes of their own, by their index.
    clocks : AgentClocks or None
        The agents' clocks; None for continuous agents.
    grain : float
        Grain of time of the agents' rule.
    transmitter : Transmitter
        Sends the signals and keeps the account of them.
    collective : Collective or None
        The agents that are advanced together, if there are any.
    response_draws : callable
        Gives, for a signal, what decides how each agent responds to it: n uniform numbers.
    on_response, on_intervention : list of callable
        Called with (time, resource, change) when an agent has responded to a signal, and when a
        demand has been set from outside.
    """

    def __init__(
        self,
        problem: Problem,
        channel: Channel,
        clocks: Clocks | None,
        seed: int,
        until: float,
        log: EventLog | None = None,
    ) -> None:
        n, m = problem.n_agents, problem.n_resources
        self.env = OrderedEnvironment()
        self.problem = problem
        self.until = until
        self.log = log
        self.keys = {purpose: streams.key(seed, purpose) for purpose in Purpose}
        self.link = channel.open(n, self.keys)
        self.clocks: AgentClocks | None = (
            None if clocks is None else clocks.start(n, self.keys[Purpose.CLOCK])
        )
        self.grain = CONTINUOUS if clocks is None else DISCRETE
        self.law = law_of(problem)
        self.state = start(m, n, self.grain)
        self.rows = State(*([memoryview(row) for row in array] for array in self.state))  # type: ignore[arg-type]
        self.agents: dict[int, Agent] = {}
        self.on_response: list[Callable[[float, int, float], None]] = []
        self.on_intervention: list[Callable[[float, int, float], None]] = []
        self.collective: Collective | None = None
        carrier = Carrier(self.env, self.agents, log)
        self.transmitter = Transmitter(self.env, self.link, m, n, until, carrier, log)
        self._now = np.empty(1)
        draws = ResponseDraws(self.keys[Purpose.RESPONSE], n)
        self.response_draws: Callable[[Signal], list[float]] = draws.__getitem__

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

    def total(self, resource: int) -> float:
        """Sum the demand of all agents for one resource as it is now.

        Parameters
        ----------
        resource : int
            j.

        Returns
        -------
        float
            In units of the resource.
        """
        self.settle()
        state = self.state
        increase = self.law.increase[resource]
        return total_of(state.demand[resource], increase, state.anchor[resource], self.moments(), self.grain)

    def totals(self) -> FloatArray:
        """Sum the demand of all agents for every resource as it is now.

        Returns
        -------
        ndarray, shape (m,)
            In units of the resources.
        """
        self.settle()
        total = np.empty(self.problem.n_resources)
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

    def _moment(self, agent: int) -> float:
        if self.clocks is None:
            return float(self.env.now)
        return float(self.clocks.next_tick(agent, self.clock_time()))

    def demand(self, agent: int, resource: int) -> float:
        """Read one agent's demand for one resource as it is now.

        Parameters
        ----------
        agent, resource : int
            i and j.

        Returns
        -------
        float
            In units of the resource.
        """
        self.settle()
        held, anchor = self.rows.demand[resource][agent], self.rows.anchor[resource][agent]
        increase = float(self.law.increase[resource, agent])
        return demand_at(held, increase, self._moment(agent) - anchor, self.grain)

    def average(self, agent: int, resource: int) -> float:
        """Read one agent's long-term average of one resource as it is now.

        Parameters
        ----------
        agent, resource : int
            i and j.

        Returns
        -------
        float
            In units of the resource.
        """
        self.settle()
        rows, moment, increase = self.rows, self._moment(agent), float(self.law.increase[resource, agent])
        held, since = rows.demand[resource][agent], moment - rows.anchor[resource][agent]
        folded = accumulated_at(rows.accumulated[resource][agent], held, increase, since, self.grain)
        return time_average(folded, moment, self.grain)

    def set_demand(self, agent: int, resource: int, demand: float) -> None:
        """Set one agent's demand for one resource, from which it grows on.

        Parameters
        ----------
        agent, resource : int
            i and j.
        demand : float
            At least 0, in units of the resource.

        Raises
        ------
        InputError
            If there is no such agent or resource, or the demand is negative or not finite.
        """
        checks.integer("agent", agent, low=0, high=self.problem.n_agents - 1)
        checks.integer("resource", resource, low=0, high=self.problem.n_resources - 1)
        demand = checks.number("demand", demand, low=0.0)
        rows, moment, before = self.rows, self._moment(agent), self.demand(agent, resource)
        held, folded, anchor = rows.demand[resource], rows.accumulated[resource], rows.anchor[resource]
        # A tick folds in the demand at hand, so what is set now stands just before the next tick.
        since, increase = moment - self.grain - anchor[agent], float(self.law.increase[resource, agent])
        folded[agent] = accumulated_at(folded[agent], held[agent], increase, since, self.grain)
        held[agent], anchor[agent] = demand, moment - self.grain
        if self.log is not None:
            self.log.add((self.env.now, Entry.CHANGE, resource, agent, -1, demand - before))
        for tell in self.on_intervention:
            tell(self.env.now, resource, demand - before)

    def settle(self) -> None:
        """Bring agents that are advanced together to where events have come; reading does it, too."""
        if self.collective is not None:
            self.collective.settle()

    def join(self, collective: Collective) -> None:
        """Let agents that are advanced together take part.

        Parameters
        ----------
        collective : Collective
            There is one at most.
        """
        self.collective = self.transmitter.collective = collective
        self.env.tracking = True
        if self.log is not None:
            self.log.lead(collective.settle)

    def broadcast(self, resource: int, delay: float = 0.0) -> None:
        """Send a capacity signal for one resource to all agents.

        Parameters
        ----------
        resource : int
            j.
        delay : float
            How long after now it leaves the control unit, at least 0 and in units of time.

        Raises
        ------
        InputError
            If there is no such resource, the delay is negative or not finite, or the channel says
            anything but a time for each agent that is not before the departure.
        """
        if not (0 <= resource < self.problem.n_resources and 0.0 <= delay < math.inf):
            checks.integer("resource", resource, low=0, high=self.problem.n_resources - 1)
            checks.number("delay", delay, low=0.0)
        self.settle()
        self.transmitter.send(resource, self.env.now, delay, self.total)
