"""One run in progress: what the control unit, the channel, the agents and observers share."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des import streams
from aimd_des.channel import Broadcast, Channel
from aimd_des.checks import FloatArray
from aimd_des.clock import AgentClocks, Clocks
from aimd_des.environment import OrderedEnvironment
from aimd_des.log import Entry, EventLog
from aimd_des.population import State, law_of, observe, start, total_of, totals
from aimd_des.problem import Problem
from aimd_des.response import CONTINUOUS, DISCRETE, accumulated_at, demand_at, time_average
from aimd_des.streams import Key, Purpose
from aimd_des.transport import Agent, Carrier, Signal

__all__ = ["System"]

# Rows of response draws kept at hand; one that is gone is drawn again, to the same bits.
_ROWS_KEPT = 256


class _ResponseDraws(dict[Signal, list[float]]):
    """What decides how each agent responds to a signal; drawn when it is first asked for."""

    def __init__(self, key: Key, n_agents: int) -> None:
        super().__init__()
        self.key = key
        self.n_agents = n_agents

    def __missing__(self, signal: Signal) -> list[float]:
        if len(self) == _ROWS_KEPT:
            del self[next(iter(self))]
        row = streams.uniforms(self.key, signal.resource, signal.number, self.n_agents, signal.copy)
        draws: list[float] = row.tolist()
        self[signal] = draws
        return draws


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
    agents : list of Agent
        The agents in the order of their index.
    clocks : AgentClocks or None
        The agents' clocks; None for continuous agents.
    grain : float
        Grain of time of the agents' rule.
    sent : list of Broadcast
        All signals so far.
    delivered, lost, duplicated : ndarray of int, shape (m, n)
        Copies by what becomes of them; duplicates that arrive are counted apart.
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
        self.agents: list[Agent] = []
        self.sent: list[Broadcast] = []
        self.on_response: list[Callable[[float, int, float], None]] = []
        self.on_intervention: list[Callable[[float, int, float], None]] = []
        self.delivered, self.lost, self.duplicated = np.zeros((3, m, n), dtype=np.int64)
        self._carrier = Carrier(self.env, self.agents, log)
        self._numbers = [0] * m
        self._now = np.empty(1)
        draws = _ResponseDraws(self.keys[Purpose.RESPONSE], n)
        self.response_draws: Callable[[Signal], list[float]] = draws.__getitem__

    def clock_time(self) -> float:
        """Return the time up to which ticks lie in the past: now, or just after where agents have acted.

        Returns
        -------
        float
            For `AgentClocks.next_tick` and `next_ticks`.
        """
        now = float(self.env.now)
        return math.nextafter(now, math.inf) if self.env.agents_have_acted else now

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
        total = np.empty(self.problem.n_resources)
        totals(self.state, self.law, self.moments(), self.grain, total)
        return total

    def allocations(self) -> tuple[FloatArray, FloatArray]:
        """Read demand and average of every agent as they are now.

        Returns
        -------
        demand, average : ndarray, shape (m, n)
            In units of the resources.
        """
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
        at, state = (resource, agent), self.state
        since = self._moment(agent) - float(state.anchor[at])
        return demand_at(float(state.demand[at]), float(self.law.increase[at]), since, self.grain)

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
        at, state, moment = (resource, agent), self.state, self._moment(agent)
        increase, since = float(self.law.increase[at]), moment - float(state.anchor[at])
        held, folded = float(state.demand[at]), float(state.accumulated[at])
        return time_average(accumulated_at(folded, held, increase, since, self.grain), moment, self.grain)

    def set_demand(self, agent: int, resource: int, demand: float) -> None:
        """Set one agent's demand for one resource, from which it grows on.

        Parameters
        ----------
        agent, resource : int
            i and j.
        demand : float
            At least 0, in units of the resource.
        """
        at, state, moment = (resource, agent), self.state, self._moment(agent)
        before = self.demand(agent, resource)
        # A tick folds in the demand at hand, so what is set now stands just before the next tick.
        since = moment - self.grain - float(state.anchor[at])
        increase, held = float(self.law.increase[at]), float(state.demand[at])
        state.accumulated[at] = accumulated_at(
            float(state.accumulated[at]), held, increase, since, self.grain
        )
        state.demand[at], state.anchor[at] = demand, moment - self.grain
        if self.log is not None:
            self.log.add((self.env.now, Entry.CHANGE, resource, agent, -1, demand - before))
        for tell in self.on_intervention:
            tell(self.env.now, resource, demand - before)

    @property
    def in_flight(self) -> npt.NDArray[np.int64]:
        """Copies that are neither lost nor will have arrived by the end, shape (m, n)."""
        return np.array(self._numbers)[:, None] - self.delivered - self.lost

    def broadcast(self, resource: int, delay: float = 0.0) -> None:
        """Send a capacity signal for one resource to all agents.

        Parameters
        ----------
        resource : int
            j.
        delay : float
            How long after now it leaves the control unit, in units of time.
        """
        now = self.env.now
        signal = Broadcast(resource, self._numbers[resource], now)
        self._numbers[resource] += 1
        self.sent.append(signal)
        copies = self.link.transmit(signal, now + delay)
        lost = copies.arrival == math.inf
        arrives = copies.arrival < self.until
        self.lost[resource] += lost
        self.delivered[resource] += arrives
        if self.log is not None:
            self.log.add((now, Entry.SIGNAL, resource, -1, signal.number, self.total(resource)))
            for agent in np.flatnonzero(lost).tolist():
                self.log.add((now, Entry.LOST, resource, agent, signal.number, 0.0))
        self._send(Signal(resource, signal.number), copies.arrival, arrives)
        if copies.second is not None:
            twice = copies.second < self.until
            self.duplicated[resource] += twice
            self._send(Signal(resource, signal.number, 1), copies.second, twice)

    def _send(self, signal: Signal, arrival: FloatArray, arrives: np.ndarray[Any, Any]) -> None:
        first_order = self.env.reserve(len(arrival))
        receivers = arrival.argsort(kind="stable")[: np.count_nonzero(arrives)]
        if len(receivers):
            times = arrival[receivers].tolist()
            self._carrier.send(signal, times, receivers.tolist(), first_order)
