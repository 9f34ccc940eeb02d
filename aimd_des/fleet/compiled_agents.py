"""All standard agents of a run as arrays, advanced by compiled code between the events of SimPy."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.custom_response import check_returned, with_address
from aimd_des.dynamics.loss_compensation import ESTIMATED
from aimd_des.engine.delivery import Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.observers import ConstantPieces, LinearPieces
from aimd_des.engine.system import System
from aimd_des.fleet.absent_agents import forget
from aimd_des.fleet.arrays import (
    ALL_ANSWERS,
    NO_ANSWERS,
    RESPONSES,
    Answers,
    ClockArrays,
    CopyAccount,
    FleetAgents,
    IntArray,
    response_buffers,
)
from aimd_des.fleet.broadcast_rows import (
    broadcast_rows,
    copies_in_rows,
    places_behind,
    resumed_rows,
    rows_state,
    serves,
)
from aimd_des.fleet.enqueue_kernel import enqueue
from aimd_des.fleet.event_entries import EventEntries, turn_limit
from aimd_des.fleet.in_flight import PIECE, copies_state, empty_copies, enlarge, resumed_copies, room
from aimd_des.fleet.observer_kernels import FleetOvershoot
from aimd_des.fleet.pending_totals import pending_totals
from aimd_des.fleet.response_kernels import settle
from aimd_des.fleet.row_queue import spill
from aimd_des.problem.costs import Costs, compiled_gradient, cost_table
from aimd_des.results.event_log import Entry
from aimd_des.utils import validation
from aimd_des.utils.compiled_call import OF_AN_AGENT
from aimd_des.utils.direct_calls import Direct
from aimd_des.utils.errors import InputError
from aimd_des.utils.returned_values import said_by
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray

BoolArray = npt.NDArray[np.bool_]

# Broadcasts in flight for which there is space at first; it grows where there are more.
_BROADCASTS = 4

# Answers that are reported to observers together: at least, for each agent and resource, and at most.
_TOLD = (1 << 12, 1 << 8, 1 << 16)


def told_at_once(system: System) -> int:
    """Say how many answers are reported to observers together: a run of few agents takes little memory."""
    least, each, most = _TOLD
    return min(max(each * system.state.demand.size, least), most)


class CompiledAgents:
    """The standard agents of a run in compiled code: what an `AgentProcess` each would do, event for event.

    Copies that have arrived are answered when agents are read, each agent's in the order of time.

    Attributes
    ----------
    members : ndarray of bool, shape (n,)
        Which agents are part of it.
    agents, integrals : FleetAgents, FleetOvershoot
        What compiled code works on.
    """

    def __init__(
        self,
        system: System,
        absent: Collection[int] = (),
        overshoot: ConstantPieces | LinearPieces | None = None,
    ) -> None:
        problem = system.problem
        n, m = problem.n_agents, problem.n_resources
        self.system = system
        self.members = np.ones(n, dtype=np.bool_)
        self.members[list(absent)] = False
        # Kept as long as the run: addresses mean nothing without them.
        self._gradient = _compiled_gradient(problem.costs)
        response = with_address(system.response, system.parameters.response, PIECE)
        ticking, numbered = system.clocks is not None, system.parameters.compensation.rule == ESTIMATED
        # What calls a function for each derivative has no rows of derivatives.
        rows = broadcast_rows(self._gradient is None and serves(system), m, n, ticking=ticking)
        # All that is in rows may have to go to the queues.
        space = _BROADCASTS * n + copies_in_rows(rows)
        copies = empty_copies(space, m if problem.costs.separable else 1, ticking, numbered)
        account = system.transmitter
        clocks = (np.empty(0), np.empty(0), np.empty(0)) if system.clocks is None else system.clocks.rows
        # State, law and account are the arrays of the run itself.  Compiled code writes state and account,
        # and only when it settles; all other code that reads or writes them settles first.
        self.agents = FleetAgents(
            state=system.state,
            parameters=system.parameters._replace(response=response),
            members=self.members,
            table=cost_table(problem.costs),
            gradient=_address(self._gradient),
            coupled=not problem.costs.separable,
            clocks=ClockArrays(
                *clocks, system.keys[Purpose.CLOCK], system.clocks is None or system.clocks.common
            ),
            tick_weight=system.tick_weight,
            until=system.until,
            key=system.keys[Purpose.RESPONSE],
            copies=copies,
            rows=rows,
            account=CopyAccount(system.conditions.away, account.delivered, account.lost, account.duplicated),
            room=room(copies) - copies_in_rows(rows),
            answers=_answers(0),
            reported=NO_ANSWERS,
            buffers=response_buffers(m, n),
            pending=pending_totals(PIECE),
        )
        self.overshoot = overshoot
        self.integrals = self._integrals(overshoot)
        self._settle = Direct(settle)
        # What `reached` was at the last settling; and the latest event, by which `forget` tells copies that
        # have arrived from others even where `reached` has been forgotten since.
        self._settled = self._position = system.env.reached
        system.conditions.on_costs.append(self._reprice)
        system.conditions.on_channel.append(self._leave_rows)
        self._entries = EventEntries(m, ticking=ticking)
        system.parts["fleet"] = self

    def state(self) -> dict[str, Any]:
        """Return what is on its way, and what listeners have still to be told of; nothing is copied."""
        answers = self.agents.answers
        held = int(answers.held[0])
        told = (answers.key, answers.rank, answers.agent, answers.resource, answers.change)
        return {
            "copies": copies_state(self.agents.copies),
            "rows": rows_state(self.agents.rows),
            "answers": [column[:held] for column in told],
            "settled": self._settled,
            "position": self._position,
            "entries": self._entries.state(),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        agents, kept = self.agents, state["rows"]
        ticking, numbered = agents.copies.moment.size > 0, agents.copies.number.size > 0
        copies, rows = resumed_copies(agents.copies, state["copies"], ticking, numbered), agents.rows
        if kept["enabled"] and rows.enabled:
            rows = resumed_rows(rows, kept)
        elif kept["enabled"]:
            # Another channel or response, with which there are no rows: copies go to the queues.
            spare = resumed_rows(broadcast_rows(True, *agents.state.demand.shape, ticking=ticking), kept)
            for resource in range(len(spare.serving)):
                spill(agents._replace(copies=copies, rows=spare), resource)
        else:
            rows = rows._replace(enabled=False)
        self.agents = agents._replace(copies=copies, rows=rows, room=room(copies) - copies_in_rows(rows))
        self.listen()
        self._take_answers(state["answers"])
        self._settled, self._position = tuple(state["settled"]), tuple(state["position"])
        self._entries.resume(state["entries"])

    def _take_answers(self, told: Sequence[IntArray | FloatArray]) -> None:
        answers = self.agents.answers
        own = (answers.key, answers.rank, answers.agent, answers.resource, answers.change)
        for column, rows in zip(own, told, strict=True):
            column[: len(rows)] = rows
        answers.held[0] = len(told[0])

    def _integrals(self, overshoot: ConstantPieces | LinearPieces | None) -> FleetOvershoot:
        """Let compiled code work on what the observer has."""
        m = self.system.problem.n_resources
        # Where nothing is observed in compiled code, arrays of its own keep the types of kernels the same.
        lines = overshoot if isinstance(overshoot, LinearPieces) else None
        steps = overshoot if isinstance(overshoot, ConstantPieces) else None
        return FleetOvershoot(
            lines=False,
            steps=False,
            capacity=self.agents.parameters.capacity,
            slope=self.system.conditions.growth,
            running=lines.running if lines else np.zeros((m, 6)),
            peak=steps.peak if steps else np.zeros(m),
            above=steps.above if steps else np.zeros(m),
            excess=steps.excess if steps else np.zeros(m),
            used=steps.used if steps else np.zeros(m),
            measured=steps.measured if steps else np.zeros(1),
            tick=steps.tick if steps else np.zeros(1, dtype=np.int64),
            order=np.zeros(0, dtype=np.int64),
            spare=np.zeros(0, dtype=np.int64),
        )

    def listen(self) -> None:
        """Keep answers from now on if there is a listener, in compiled code or outside."""
        listeners = self.system.on_response
        # If only the overshoot listens, answers are folded into it in compiled code.  If others listen, too,
        # all are told, answer by answer in the order of events.
        own = isinstance(self.overshoot, LinearPieces) and listeners == [self.overshoot.changed]
        reported = ALL_ANSWERS if self.system.log is not None else RESPONSES if listeners else NO_ANSWERS
        if reported != self.agents.reported or (own and reported == RESPONSES) != self.integrals.lines:
            self.integrals = self.integrals._replace(lines=own and reported == RESPONSES)
            self.agents = self.agents._replace(reported=reported)
            self._make_room_for_answers()

    def _make_room_for_answers(self) -> None:
        if self.agents.reported != NO_ANSWERS:
            # All copies in flight may be answered at one look, on top of the answers not told of yet: none
            # where compiled code folds them in.
            waiting = 0 if self.integrals.lines else told_at_once(self.system)
            space = self.agents.room + copies_in_rows(self.agents.rows) + waiting
            answers = _answers(space)
            for new, old in zip(answers, self.agents.answers, strict=True):
                new[: len(old)] = old
            self.agents = self.agents._replace(answers=answers)
            if self.integrals.lines:
                order, spare = np.zeros((2, space), dtype=np.int64)
                self.integrals = self.integrals._replace(order=order, spare=spare)

    def send(self, signal: Signal, arrival: FloatArray, first_order: int) -> None:
        """Put the members' copies of a broadcast on their way."""
        self.listen()
        self.make_room(1)
        enqueue(self.agents, *signal, arrival, first_order, *self.system.env.acted)
        if self.system.log is not None:
            # Copies are answered in any order, and some never; their landings are entered apart.
            arrives = self.members & (arrival < self.system.until)
            self._entries.send(signal, arrival, arrives, first_order)
        # What is sent now is ahead of this event, even if it arrives at this instant.
        self.system.env.forget_reached()

    def make_room(self, rows: int) -> None:
        """Make space for more copies where there is too little."""
        self.agents = self.agents._replace(rows=places_behind(self.agents.rows))
        copies = self.agents.copies
        needed = int(copies.in_flight[0]) + rows * len(self.members)
        if needed > self.agents.room:
            # Twice as much, so that what is copied over a run is in proportion to what is sent.
            in_rows = copies_in_rows(self.agents.rows)
            copies = enlarge(copies, 2 * needed + in_rows)
            self.agents = self.agents._replace(copies=copies, room=room(copies) - in_rows)
            self._make_room_for_answers()

    def settle(self) -> None:
        """Let the members answer all copies that are due before what happens now."""
        # Every reader asks for it, many of them in one event: only the first has something to do.
        reached = self.system.env.reached
        if reached != self._settled:
            self._settled = reached
            time, kind, order = reached
            # Below 0 there was no event since something was sent, which is answered after the present one.
            if time >= 0.0:
                self._position = reached
                self.flush()
                own = EventKind.ACT if self.agents.tick_weight else EventKind.DELIVER
                queues = 0, len(self.agents.copies.base)
                limit = turn_limit(kind, order, own)
                self._settle((self.agents, self.integrals), *queues, float(time), limit)
                if self.agents.reported != NO_ANSWERS and not self.integrals.lines:
                    self._tell(reached)
        check_returned(self.system.response, self.agents.parameters.response)
        if self._gradient is not None:
            field = said_by(self.system.conditions.costs, "gradient")
            validation.number(field, self.agents.buffers.gradient[-1])

    def forget(self, agent: int, *, lost: bool) -> None:
        """Drop a member's copies that have arrived by now."""
        # Continuous agents have answered what has arrived: nothing of theirs waits.
        if self.members[agent] and self.agents.tick_weight:
            time, kind, order = self._position
            forget(self.agents, agent, time, turn_limit(kind, order, EventKind.DELIVER), lost)

    def _reprice(self, costs: Costs) -> None:
        """Take in new private costs."""
        # They are set after settling: copies that were due before are answered at the old ones.
        self._gradient = _compiled_gradient(costs)
        self._leave_rows()
        self.agents = self.agents._replace(table=cost_table(costs), gradient=_address(self._gradient))

    def _leave_rows(self) -> None:
        """Let copies go to the queues where rows do not serve from now on."""
        rows = self.agents.rows
        if rows.enabled and (self._gradient is not None or not serves(self.system)):
            for resource in range(len(rows.serving)):
                spill(self.agents, resource)
            self.agents = self.agents._replace(rows=rows._replace(enabled=False))

    def flush(self) -> None:
        """Have changes folded in that come before those of the members."""
        if self.integrals.lines and isinstance(self.overshoot, LinearPieces):
            self.overshoot.flush()

    def _tell(self, reached: tuple[float, int, int]) -> None:
        """Tell of the answers since the last time, in the order of events."""
        agents, log, listeners = self.agents, self.system.log, self.system.on_response
        entries = self._entries.take(agents.answers, reached, agents.account.away)
        responses = entries[entries[:, 1] == Entry.RESPOND]
        time, resource, change = responses[:, 0], responses[:, 2].astype(np.int64), 0.0 - responses[:, 5]
        if isinstance(self.overshoot, LinearPieces) and listeners == [self.overshoot.changed]:
            self.overshoot.changed_often(time, resource, change)
        elif listeners:
            for response in zip(time.tolist(), resource.tolist(), change.tolist(), strict=True):
                for tell in listeners:
                    tell(*response)
        # Not by `add`, which settles first: these entries are what settling has brought forth.
        if log is not None:
            log.extend(entries)


def _answers(space: int) -> Answers:
    key, rank, agent, resource, interval = np.empty((5, space), dtype=np.int64)
    return Answers(key, rank, agent, resource, np.empty(space), np.zeros(1, dtype=np.int64), interval)


def _compiled_gradient(costs: Costs) -> Any:
    """Return the gradient of costs as compiled code can call it; None where they have a table."""
    if cost_table(costs).n_agents:
        return None
    gradient = compiled_gradient(costs)
    if gradient is None:
        raise InputError.of(
            "agents",
            "Fleet",
            f"AgentProcess with {type(costs).__name__} that have no table and no compiled gradient",
            "give them table() or compiled_gradient(), of CustomCosts decorate the gradient with numba.njit,"
            " or choose agents=AgentProcess",
        )
    return _callback(gradient, costs.n_resources)


def _address(callback: Any) -> int:
    return 0 if callback is None else int(callback.address)


@lru_cache(maxsize=16)
def _callback(gradient: Callable[..., Any], m: int) -> Any:
    import numba

    # Compiled code is given the address alone: kernels need not be compiled again for each function.
    @numba.cfunc(OF_AN_AGENT)  # type: ignore[untyped-decorator]
    def call(agent: int, average: Any, out: Any) -> None:
        # Compiled code that calls this cannot take an exception: what is written last is refused by `settle`.
        try:
            values = gradient(agent, numba.carray(average, (m,)))
            for j in range(m):
                out[j] = values[j]
        except Exception:  # noqa: BLE001 - the only one that compiled code can catch
            out[0] = np.nan
        for j in range(m):
            if not math.isfinite(out[j]):
                out[m] = out[j]

    return call
