"""Agents answer the copies that are due, in dense passes: each its own in the order of time.

Agents touch each other only through the control unit, so between two looks their order does not matter.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from aimd_des.agents.crowd import Crowd
from aimd_des.agents.flights import DUE, LATER
from aimd_des.agents.radix import move, raise_due, release, time_of
from aimd_des.compiled import formula, kernel
from aimd_des.gradients import gradient_at
from aimd_des.response import accumulated_at, demand_at, response_probability, time_average

__all__ = ["LAST", "settle"]

#: Above every order number, and the bits of every time.
LAST = (1 << 63) - 1

_ALL_ANSWERS = 2


@intrinsic  # type: ignore[untyped-decorator]  # numba has no type information
def _call_gradient(typingctx: Any, address: Any, agent: Any, average: Any, gradient: Any) -> Any:  # noqa: ARG001
    """Call a compiled gradient: void(int64 agent, double* average, double* gradient)."""
    signature = types.void(types.int64, types.int64, types.int64, types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        word, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [word, pointer, pointer]).as_pointer()
        places = [builder.inttoptr(place, pointer) for place in args[2:]]
        builder.call(builder.inttoptr(args[0], kind), [args[1], *places])
        return context.get_dummy_value()

    return signature, codegen


@formula
def _marginal_cost(crowd: Crowd, agent: int, resource: int, moment: float, average: float) -> float:
    """Return grad_j f_i at the agent's averages, of which that of the resource itself is known."""
    averages = crowd.scratch.average
    if crowd.coupled:
        state, increase = crowd.state, crowd.law.increase
        for j in range(averages.shape[0]):
            folded = accumulated_at(
                state.accumulated[j, agent],
                state.demand[j, agent],
                increase[j, agent],
                moment - state.anchor[j, agent],
                crowd.grain,
            )
            averages[j] = time_average(folded, moment, crowd.grain)
    else:
        averages[resource] = average
    if crowd.gradient != 0:
        gradient = crowd.scratch.gradient
        _call_gradient(crowd.gradient, agent, averages.ctypes.data, gradient.ctypes.data)
        return float(gradient[resource])
    return gradient_at(crowd.table, averages, resource, agent)


@formula
def _report(crowd: Crowd, block: int, place: int, change: float) -> None:
    """Note an answer for those who want to know of it."""
    answers, flights = crowd.answers, crowd.flights
    row = answers.count[0]
    answers.key[row] = flights.key[block, place]
    answers.rank[row] = flights.rank[block, place]
    answers.agent[row] = flights.agent[block, place]
    answers.resource[row] = flights.resource[block, place]
    answers.change[row] = change
    answers.count[0] = row + 1


@formula
def _answer(crowd: Crowd, block: int, place: int) -> None:
    """Let an agent answer a copy: Algorithm 2, the branch S = 1."""
    flights, state, law, grain = crowd.flights, crowd.state, crowd.law, crowd.grain
    i, j = flights.agent[block, place], flights.resource[block, place]
    ticking = grain > 0.0
    moment = flights.moment[block, place] if ticking else time_of(flights.key[block, place])
    if ticking and state.anchor[j, i] == moment:
        return  # the latch was set already: this tick's signal has been answered
    held, increase = state.demand[j, i], law.increase[j, i]
    since = moment - state.anchor[j, i]
    folded = accumulated_at(state.accumulated[j, i], held, increase, since, grain)
    average = time_average(folded, moment, grain)
    present = demand_at(held, increase, since, grain)
    gradient = _marginal_cost(crowd, i, j, moment, average)
    probability = response_probability(law.normalization[j], gradient, average)
    if flights.uniform[block, place] < probability:
        kept = present * law.decrease[j, i]
        state.demand[j, i], state.accumulated[j, i], state.anchor[j, i] = kept, folded, moment
        state.responses[j, i] += 1
        state.saturated[j, i] += probability > 1.0
        if crowd.hearing > 0:
            _report(crowd, block, place, kept - present)
    else:
        # A tick that holds is a tick without growth; a continuous agent just grows on.
        if ticking:
            state.demand[j, i], state.accumulated[j, i], state.anchor[j, i] = present, folded, moment
        if crowd.hearing == _ALL_ANSWERS:
            _report(crowd, block, place, np.nan)


@formula
def _find_first(crowd: Crowd, queue: int) -> None:
    """Find the earliest copy of every agent among those that are due."""
    flights, scratch = crowd.flights, crowd.scratch
    ticking = crowd.grain > 0.0
    block = flights.head[queue, DUE]
    while block >= 0:
        for place in range(flights.filled[block]):
            i, key, rank = flights.agent[block, place], flights.key[block, place], flights.rank[block, place]
            arrival = flights.arrival[block, place] if ticking else 0.0
            earlier = key < scratch.first_key[i]
            if key == scratch.first_key[i]:
                same = arrival == scratch.first_arrival[i]
                earlier = rank < scratch.first_rank[i] if same else arrival < scratch.first_arrival[i]
            if earlier:
                scratch.first_key[i], scratch.first_rank[i] = key, rank
                scratch.first_arrival[i] = arrival
        block = flights.following[block]


@formula
def _answer_first(crowd: Crowd, queue: int) -> None:
    """Let every agent answer the earliest of its copies that are due; the others wait for the next round."""
    flights, scratch = crowd.flights, crowd.scratch
    block = flights.head[queue, DUE]
    while block >= 0:
        for place in range(flights.filled[block]):
            i = flights.agent[block, place]
            if flights.rank[block, place] == scratch.first_rank[i]:
                scratch.first_key[i] = LAST
                _answer(crowd, block, place)
                flights.aloft[0] -= 1
            else:
                move(flights, queue, LATER, block, place)
        block = release(flights, block)
    flights.head[queue, DUE], flights.tail[queue, DUE] = flights.head[queue, LATER], flights.tail[queue, LATER]
    flights.head[queue, LATER] = flights.tail[queue, LATER] = -1


@kernel
def settle(crowd: Crowd, first: int, last: int, time: float, limit: int) -> None:
    """Let all agents answer the copies that are due.

    Parameters
    ----------
    crowd : Crowd
        The agents.
    first, last : int
        In which queues: from the first to the one before the last.
    time : float
        What is due before is due.
    limit : int
        What is due at this very time is due if its order number (of discrete agents: the agent's index)
        is below this.
    """
    for queue in range(first, last):
        raise_due(crowd.flights, queue, time, limit)
        while crowd.flights.head[queue, DUE] >= 0:
            _find_first(crowd, queue)
            _answer_first(crowd, queue)
