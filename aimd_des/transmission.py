"""How signals are sent: the account of every broadcast and of what becomes of its copies."""

import math
from array import array
from collections.abc import Callable, Sequence
from typing import overload

import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.channel import Broadcast, Link
from aimd_des.checks import FloatArray
from aimd_des.environment import OrderedEnvironment
from aimd_des.errors import InputError
from aimd_des.log import Entry, EventLog
from aimd_des.recording import Signals
from aimd_des.transport import Carrier, Collective, Signal

__all__ = ["SentSignals", "Transmitter"]

IntArray = npt.NDArray[np.int64]


class SentSignals(Sequence[Broadcast]):
    """The broadcasts of a run so far, in the order in which they were sent."""

    def __init__(self) -> None:
        self._time, self._resource, self._number = array("d"), array("q"), array("q")

    def append(self, broadcast: Broadcast) -> None:
        """Add one.

        Parameters
        ----------
        broadcast : Broadcast
            The latest.
        """
        self._time.append(broadcast.time)
        self._resource.append(broadcast.resource)
        self._number.append(broadcast.number)

    def extend(self, time: FloatArray, resource: IntArray, number: IntArray) -> None:
        """Add several.

        Parameters
        ----------
        time, resource, number : ndarray, shape (s,)
            As in `Broadcast`.
        """
        self._time.frombytes(time.tobytes())
        self._resource.frombytes(resource.tobytes())
        self._number.frombytes(number.tobytes())

    def __len__(self) -> int:
        return len(self._time)

    @overload
    def __getitem__(self, index: int) -> Broadcast: ...

    @overload
    def __getitem__(self, index: slice) -> list[Broadcast]: ...

    def __getitem__(self, index: int | slice) -> Broadcast | list[Broadcast]:
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        return Broadcast(self._resource[index], self._number[index], self._time[index])

    def signals(self) -> Signals:
        """Return all of them as arrays.

        Returns
        -------
        Signals
            Copies.
        """
        return Signals(np.array(self._time), np.array(self._resource), np.array(self._number))


class Transmitter:
    """Sends the signals of one run to all agents.

    Parameters
    ----------
    env : OrderedEnvironment
        The run's time.
    link : Link
        The channel in this run.
    n_resources : int
        m.
    cut : ndarray of bool, shape (n,)
        Agents to which nothing gets through at the moment.
    until : float
        The end of the run.
    carrier : Carrier
        Brings copies to agents that are processes.
    log : EventLog, optional
        Where broadcasts and losses are written.

    Attributes
    ----------
    sent : SentSignals
        All signals so far.
    numbers : ndarray of int, shape (m,)
        How many there were for each resource.
    delivered, lost, duplicated : ndarray of int, shape (m, n)
        Copies by what becomes of them; duplicates that arrive are counted apart.
    collective : Collective or None
        Takes the copies of agents that are advanced together.
    """

    def __init__(
        self,
        env: OrderedEnvironment,
        link: Link,
        n_resources: int,
        cut: npt.NDArray[np.bool_],
        until: float,
        carrier: Carrier,
        log: EventLog | None,
    ) -> None:
        self.env, self.link, self.until, self.carrier, self.log = env, link, until, carrier, log
        self.cut, self.n_agents = cut, len(cut)
        carrier.missed = self.missed
        self.sent = SentSignals()
        self.numbers = np.zeros(n_resources, dtype=np.int64)
        self.delivered, self.lost, self.duplicated = np.zeros((3, n_resources, len(cut)), dtype=np.int64)
        self.collective: Collective | None = None

    @property
    def in_flight(self) -> IntArray:
        """Copies that are neither lost nor will have arrived by the end, shape (m, n)."""
        return np.asarray(self.numbers[:, None] - self.delivered - self.lost)

    def send(self, resource: int, time: float, delay: float, total: Callable[[int], float]) -> None:
        """Broadcast a capacity signal.

        Parameters
        ----------
        resource : int
            j.
        time : float
            Of the look, or the crossing, that has caused it.
        delay : float
            How long after that it leaves, at least 0.
        total : callable
            Gives the total demand for a resource, for the log.

        Raises
        ------
        InputError
            If the channel says anything but a time for each agent that is not before the departure.
        """
        signal = Broadcast(resource, int(self.numbers[resource]), time)
        self.numbers[resource] += 1
        self.sent.append(signal)
        copies = self.link.transmit(signal, time + delay)
        self._check(copies.arrival, time + delay)
        arrival = self._through(copies.arrival)
        lost, arrives = arrival == math.inf, arrival < self.until
        self.lost[resource] += lost
        self.delivered[resource] += arrives
        if self.log is not None:
            self.log.add((time, Entry.SIGNAL, resource, -1, signal.number, total(resource)))
            for agent in np.flatnonzero(lost).tolist():
                self.log.add((time, Entry.LOST, resource, agent, signal.number, 0.0))
        self._carry(Signal(resource, signal.number), arrival, arrives)
        if copies.second is not None:
            self._check(copies.second, time + delay)
            second = self._through(copies.second)
            twice = second < self.until
            self.duplicated[resource] += twice
            self._carry(Signal(resource, signal.number, 1), second, twice)

    def _through(self, arrival: FloatArray) -> FloatArray:
        """Take out what does not get through at the moment."""
        return np.where(self.cut, math.inf, arrival) if self.cut.any() else arrival

    def _check(self, arrival: FloatArray, departure: float) -> None:
        """Refuse what a channel cannot mean; a minimum finds NaN, too."""
        if arrival.shape != (self.n_agents,) or not arrival.min() >= departure:
            checks.array("arrival", np.where(arrival == math.inf, departure, arrival), (self.n_agents,))
            raise InputError.of("arrival", float(arrival.min()), f"at least {departure!r}, the departure")

    def missed(self, signal: Signal, agent: int) -> None:
        """Take note that a copy has landed where nobody is: it is lost after all.

        Parameters
        ----------
        signal : Signal
            The bit.
        agent : int
            i.
        """
        if signal.copy:
            self.duplicated[signal.resource, agent] -= 1
        else:
            self.delivered[signal.resource, agent] -= 1
            self.lost[signal.resource, agent] += 1

    def _carry(self, signal: Signal, arrival: FloatArray, arrives: npt.NDArray[np.bool_]) -> None:
        first_order = self.env.reserve(self.n_agents)
        if self.collective is not None:
            self.collective.send(signal, arrival, first_order)
            arrival = np.where(self.collective.members, math.inf, arrival)
            arrives = arrives & ~self.collective.members
        receivers = arrival.argsort(kind="stable")[: np.count_nonzero(arrives)]
        if len(receivers):
            times = arrival[receivers].tolist()
            self.carrier.send(signal, times, receivers.tolist(), first_order)
