"""What travels and to whom: the bit, those who take part, and copies on their way."""

from collections.abc import Generator, Sequence
from typing import Any, NamedTuple, Protocol

import simpy

from aimd_des.environment import Kind, OrderedEnvironment, Reminder
from aimd_des.log import Entry, EventLog

__all__ = ["Agent", "Flight", "ProcessGenerator", "Signal"]

ProcessGenerator = Generator[simpy.Event, Any, Any]


class Signal(NamedTuple):
    """What arrives at an agent: one bit.  That it arrives is the 1; silence is the 0.

    Attributes
    ----------
    resource : int
        j: which of the m one-bit signals is set.
    number, copy : int
        The address of the agent's draw, and of entries in the log: no agent decides by them.
    """

    resource: int
    number: int
    copy: int = 0


class Agent(Protocol):
    """Anything that takes part in the sharing."""

    def receive(self, signal: Signal) -> None:
        """Take note of a capacity signal that arrives now."""
        ...

    def process(self) -> ProcessGenerator:
        """Live: the SimPy process of the agent."""
        ...


class Flight:
    """The copies of one broadcast on their way: one reminder, for the next of them to land.

    Parameters
    ----------
    env : OrderedEnvironment
        Decides when they land.
    agents : sequence of Agent
        All agents.
    log : EventLog, optional
        Where landings are written.
    signal : Signal
        What is on its way.
    times : list of float
        When copies land, ascending and before the end of the run.
    receivers : list of int
        To whom; in the order of their index where times are equal.
    first_order : int
        The first of n order numbers that are set aside for these copies.
    """

    __slots__ = (
        "agents",
        "env",
        "first_order",
        "log",
        "position",
        "receivers",
        "reminder",
        "signal",
        "times",
    )

    def __init__(
        self,
        env: OrderedEnvironment,
        agents: Sequence[Agent],
        log: EventLog | None,
        signal: Signal,
        times: list[float],
        receivers: list[int],
        first_order: int,
    ) -> None:
        self.env = env
        self.agents = agents
        self.log = log
        self.signal = signal
        self.times = times
        self.receivers = receivers
        self.first_order = first_order
        self.position = 0
        self.reminder = Reminder(env, self.land)
        self.reminder.at(times[0], Kind.DELIVER, first_order + receivers[0])

    def land(self, event: simpy.Event) -> None:
        """Hand the signal to receivers one by one, for as long as nothing else comes in between.

        Parameters
        ----------
        event : simpy.Event
            The reminder.
        """
        times, receivers, log, signal = self.times, self.receivers, self.log, self.signal
        position, advance = self.position, self.env.advance
        while True:
            agent = receivers[position]
            if log is not None:
                entry = (signal.resource, agent, signal.number, float(signal.copy))
                log.add((times[position], Entry.DELIVER, *entry))
            self.agents[agent].receive(signal)
            position += 1
            if position == len(times):
                return
            if not advance(times[position], Kind.DELIVER, self.first_order + receivers[position]):
                break
        self.position = position
        self.reminder.at(times[position], Kind.DELIVER, self.first_order + receivers[position])
