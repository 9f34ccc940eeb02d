"""All standard agents of a run as arrays, advanced by compiled code between the events of SimPy."""

import math
from collections.abc import Callable, Collection
from functools import lru_cache
from heapq import heappop, heappush
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from numba.core.dispatcher import Dispatcher

from aimd_des.agents.crowd import Answers, Crowd, Rhythm, Scratch, accept
from aimd_des.agents.flights import enlarge, room, take_off
from aimd_des.agents.settling import LAST, settle_all
from aimd_des.checks import FloatArray
from aimd_des.costs import CustomCosts
from aimd_des.environment import Kind
from aimd_des.errors import InputError
from aimd_des.gradients import cost_table
from aimd_des.log import Entry, LogEntry
from aimd_des.streams import Purpose
from aimd_des.system import System
from aimd_des.transport import Signal

__all__ = ["Fleet"]

BoolArray = npt.NDArray[np.bool_]

# Broadcasts in flight for which there is space at first.
_FLIGHTS = 4

# Answers of which somebody is told in one go.
_TOLD_AT_ONCE = 1 << 16

_NOBODY, _RESPONSES, _ALL = 0, 1, 2


class Fleet:
    """The standard agents of a run: what `Camera` processes do, event for event, at the speed of compiled code.

    Nothing happens in a fleet when a copy arrives.  Only when somebody looks, the copies that have
    arrived by then are answered, each agent's in the order of time.

    Parameters
    ----------
    system : System
        The run in progress.
    absent : collection of int
        Agents that are no part of it.

    Attributes
    ----------
    members : ndarray of bool, shape (n,)
        Who is part of it.

    Raises
    ------
    InputError
        If costs are functions that cannot be called by compiled code.
    """

    def __init__(self, system: System, absent: Collection[int] = ()) -> None:
        problem = system.problem
        n, m = problem.n_agents, problem.n_resources
        self.system = system
        self.members = np.ones(n, dtype=np.bool_)
        self.members[list(absent)] = False
        gradient = _compiled_gradient(problem.costs)
        ticking = system.clocks is not None
        rhythm = (np.empty(0), np.empty(0), np.empty(0)) if system.clocks is None else system.clocks.rows
        self.crowd = Crowd(
            state=system.state,
            law=system.law,
            members=self.members,
            table=cost_table(problem.costs),
            gradient=0 if gradient is None else gradient.address,
            coupled=not problem.costs.separable,
            rhythm=Rhythm(*rhythm, system.keys[Purpose.CLOCK]),
            grain=system.grain,
            until=system.until,
            key=system.keys[Purpose.RESPONSE],
            flights=take_off(_FLIGHTS * n, m if problem.costs.separable else 1, ticking),
            answers=_answers(0),
            hearing=_NOBODY,
            scratch=Scratch(
                first_key=np.full(n, LAST),
                first_arrival=np.zeros(n),
                first_rank=np.zeros(n, dtype=np.int64),
                uniform=np.zeros(n),
                average=np.zeros(m),
                gradient=np.zeros(m),
            ),
        )
        self._settled = system.env.reached
        # With a log: copies that have not landed yet, and what signal the copies from an order number on are of.
        self._landing: list[tuple[float, int, LogEntry]] = []
        self._signals: dict[int, Signal] = {}

    def listen(self) -> None:
        """Keep answers from now on if somebody wants to know of them."""
        hearing = _ALL if self.system.log is not None else _RESPONSES if self.system.on_response else _NOBODY
        if hearing != self.crowd.hearing:
            space = 0 if hearing == _NOBODY else room(self.crowd.flights) + _TOLD_AT_ONCE
            self.crowd = self.crowd._replace(hearing=hearing, answers=_answers(space))

    def send(self, signal: Signal, arrival: FloatArray, first_order: int) -> None:
        """Put the members' copies of a broadcast on their way.

        Parameters
        ----------
        signal : Signal
            The bit.
        arrival : ndarray, shape (n,)
            When copies arrive; inf where they are lost.
        first_order : int
            The first of n order numbers that are set aside for these copies.
        """
        self.listen()
        self.make_room(1)
        accept(self.crowd, *signal, arrival, first_order, *self.system.env.acted)
        if self.system.log is not None:
            self._signals[first_order] = signal
            for agent in np.flatnonzero(self.members & (arrival < self.system.until)).tolist():
                time, order = float(arrival[agent]), first_order + agent
                entry = (time, Entry.DELIVER, signal.resource, agent, signal.number, float(signal.copy))
                heappush(self._landing, (time, order, entry))
        # What is sent now is ahead of this event, even if it arrives at this instant.
        self.system.env.forget_reached()

    def make_room(self, rows: int) -> None:
        """Make space for more copies where there is too little.

        Parameters
        ----------
        rows : int
            For how many copies of each agent.
        """
        flights = self.crowd.flights
        needed = int(flights.aloft[0]) + rows * len(self.members)
        if needed > room(flights):
            larger = enlarge(flights, 2 * needed)
            self.crowd = self.crowd._replace(flights=larger)
            if self.crowd.hearing != _NOBODY:
                answers = _answers(room(larger) + _TOLD_AT_ONCE)
                for new, old in zip(answers, self.crowd.answers, strict=True):
                    new[: len(old)] = old
                self.crowd = self.crowd._replace(answers=answers)

    def settle(self) -> None:
        """Let the members answer all copies that are due before what happens now."""
        reached = self.system.env.reached
        if reached != self._settled:
            self._settled = reached
            time, kind, order = reached
            if time >= 0.0:
                settle_all(self.crowd, time, _limit(kind, order, Kind.ACT if self.crowd.grain else Kind.DELIVER))
                self._tell(reached)

    def _tell(self, reached: tuple[float, int, int]) -> None:
        """Tell of the answers since the last time, in the order of events."""
        answers = self.crowd.answers
        count = int(answers.count[0]) if self.crowd.hearing != _NOBODY else 0
        answers.count[:] = 0
        told: list[tuple[float, int, int, int, LogEntry]] = []
        while self._landing and (self._landing[0][0], Kind.DELIVER, self._landing[0][1]) < reached:
            time, order, entry = heappop(self._landing)
            told.append((time, Kind.DELIVER, order, -1, entry))
        rows = zip(*(column[:count].tolist() for column in (_times(answers.key), *answers[1:5])), strict=True)
        for time, rank, agent, resource, change in rows:
            signal = self._signals.get(rank - agent)
            number = -1 if signal is None else signal.number
            held = math.isnan(change)
            # A demand that falls to what it was falls by 0.0, not -0.0.
            answer: LogEntry = (time, Entry.HOLD, resource, agent, number, 0.0)
            if not held:
                answer = (time, Entry.RESPOND, resource, agent, number, 0.0 - change)
            turn = (Kind.ACT, agent) if self.crowd.grain else (Kind.DELIVER, rank)
            told.append((time, *turn, resource, answer))
        told.sort()
        log, listeners = self.system.log, self.system.on_response
        for time, _, _, _, entry in told:
            if entry[1] == Entry.RESPOND:
                for tell in listeners:
                    tell(time, entry[2], 0.0 - entry[5])
        if log is not None:
            log.extend([entry for *_, entry in told])


def _times(keys: npt.NDArray[np.int64]) -> FloatArray:
    return keys.view(np.float64)


def _limit(kind: int, order: int, own: Kind) -> int:
    """Return the order below which what is of a kind of its own comes before (kind, order)."""
    return LAST if kind > own else order if kind == own else 0


def _answers(space: int) -> Answers:
    whole = (np.empty(space, dtype=np.int64) for _ in range(4))
    return Answers(*whole, np.empty(space), np.zeros(1, dtype=np.int64))


def _compiled_gradient(costs: Any) -> Any:
    """Return the user's gradient as compiled code can call it; None where costs are of a built-in family."""
    if cost_table(costs).n_agents:
        return None
    if not isinstance(costs, CustomCosts) or not isinstance(costs.agent_gradient, Dispatcher):
        raise InputError.of(
            "agents",
            "Fleet",
            "Camera with costs whose gradient is plain Python",
            "decorate the gradient with numba.njit, or choose agents=Camera",
        )
    return _callback(costs.agent_gradient, costs.n_resources)


@lru_cache(maxsize=16)
def _callback(gradient: Callable[..., Any], m: int) -> Any:
    @numba.cfunc("void(int64, CPointer(float64), CPointer(float64))")  # type: ignore[untyped-decorator]
    def call(agent, average, out):  # type: ignore[no-untyped-def]
        values = gradient(agent, numba.carray(average, (m,)))
        for j in range(m):
            out[j] = values[j]

    return call
