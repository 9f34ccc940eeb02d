"""One run in progress: what the control unit, the channel, the agents and observers share."""

from collections.abc import Generator
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import simpy

from aimd_des import streams
from aimd_des.channel import Broadcast, Channel
from aimd_des.channel.draws import Draws
from aimd_des.checks import FloatArray
from aimd_des.clock import Clock
from aimd_des.environment import Kind, OrderedEnvironment
from aimd_des.population import law_of, observe, start, total_demand
from aimd_des.problem import Problem
from aimd_des.streams import Purpose

__all__ = ["Agent", "ProcessGenerator", "System"]

ProcessGenerator = Generator[simpy.Event, Any, Any]

# Rows of response draws kept at hand; one that is gone is drawn again, to the same bits.
_ROWS_KEPT = 256


class Agent(Protocol):
    """Anything that takes part in the sharing."""

    def receive(self, resource: int, number: int) -> None:
        """Take note of a capacity signal for resource j that arrives now; b is its number."""
        ...

    def process(self) -> ProcessGenerator:
        """Live: the SimPy process of the agent."""
        ...


class System:
    """What the parts of one run share.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many.
    channel : Channel
        Carries the broadcasts.
    clock : Clock
        The agents' clock.
    seed : int
        The run's seed.

    Attributes
    ----------
    env : OrderedEnvironment
        Decides when something happens.
    state, law : State, Law
        State of all agents and parameters of their rule, as arrays of shape (m, n).
    agents : list of Agent
        The agents in the order of their index.
    sent : list of Broadcast
        All signals so far.
    delivered, lost : ndarray of int, shape (m,)
        Copies that arrived and that were lost.
    """

    def __init__(self, problem: Problem, channel: Channel, clock: Clock, seed: int) -> None:
        self.env = OrderedEnvironment()
        self.problem = problem
        self.channel = channel
        self.clock = clock
        self.keys = {purpose: streams.key(seed, purpose) for purpose in Purpose}
        self.law = law_of(problem)
        self.state = start(problem.n_resources, problem.n_agents)
        self.agents: list[Agent] = []
        self.sent: list[Broadcast] = []
        self.delivered = np.zeros(problem.n_resources, dtype=np.int64)
        self.lost = np.zeros(problem.n_resources, dtype=np.int64)
        self._numbers = [0] * problem.n_resources
        self.response_draws = lru_cache(_ROWS_KEPT)(self._response_draws)

    def _response_draws(self, resource: int, number: int) -> list[float]:
        """Draw what decides how each agent responds to broadcast b of resource j."""
        row = streams.uniforms(self.keys[Purpose.RESPONSE], resource, number, self.problem.n_agents)
        return [float(draw) for draw in row]

    def total_demand(self) -> FloatArray:
        """Sum the demand of all agents as it is now.

        Returns
        -------
        ndarray, shape (m,)
            In units of the resources.
        """
        total = np.empty(self.problem.n_resources)
        total_demand(self.state, self.law, float(self.clock.next_tick(self.env.now)), total)
        return total

    def allocations(self) -> tuple[FloatArray, FloatArray]:
        """Read demand and average of every agent as they are now.

        Returns
        -------
        demand, average : ndarray, shape (m, n)
            In units of the resources.
        """
        demand, average = np.empty_like(self.state.demand), np.empty_like(self.state.demand)
        observe(self.state, self.law, float(self.clock.next_tick(self.env.now)), demand, average)
        return demand, average

    def broadcast(self, resource: int) -> None:
        """Send a capacity signal for resource j to all agents, now.

        Parameters
        ----------
        resource : int
            j.
        """
        n = self.problem.n_agents
        signal = Broadcast(resource, self.env.now, self._numbers[resource])
        self._numbers[resource] += 1
        self.sent.append(signal)
        arrival = self.channel.transmit(signal, Draws(self.keys, resource, signal.number, n))
        first_order = self.env.reserve(n)
        times, group = np.unique(arrival, return_inverse=True)
        for position, time in enumerate(times):
            receivers = np.flatnonzero(group == position)
            if np.isinf(time):
                self.lost[resource] += len(receivers)
            else:
                landing = _Landing(self, signal, receivers.tolist())
                self.env.call_at(float(time), Kind.DELIVER, landing, first_order + int(receivers[0]))


class _Landing:
    """Copies of one broadcast that arrive at the same instant."""

    __slots__ = ("receivers", "signal", "system")

    def __init__(self, system: System, signal: Broadcast, receivers: list[int]) -> None:
        self.system = system
        self.signal = signal
        self.receivers = receivers

    def __call__(self, event: simpy.Event) -> None:
        """Hand the signal to its receivers, in the order of their index."""
        signal, agents = self.signal, self.system.agents
        self.system.delivered[signal.resource] += len(self.receivers)
        for agent in self.receivers:
            agents[agent].receive(signal.resource, signal.number)
