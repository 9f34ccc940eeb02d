"""Agents answer the copies that are due, in dense passes: each its own in the order of time.

Agents touch each other only through the control unit, so between two looks their order does not matter.
In every round each agent answers the earliest of its copies that are due, and most have no other.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from aimd_des.agents.crowd import LAST, Crowd
from aimd_des.agents.flights import BLOCK, DUE, LATER
from aimd_des.agents.radix import move, places, raise_due, release, time_of
from aimd_des.compiled import formula, kernel
from aimd_des.gradients import gradient_at, horner_step
from aimd_des.response import accumulated_at, demand_at, response_probability, time_average

__all__ = ["settle"]

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
def _report(crowd: Crowd, place: int, change: float) -> None:
    """Note an answer for those who want to know of it."""
    answers, flights = crowd.answers, crowd.flights
    row = answers.held[0]
    answers.key[row] = flights.key[place]
    answers.rank[row] = flights.rank[place]
    answers.agent[row] = flights.agent[place]
    answers.resource[row] = flights.resource[place]
    answers.change[row] = change
    answers.held[0] = row + 1


@formula
def _find_first(crowd: Crowd, queue: int) -> None:
    """Find the earliest copy of every agent among those that are due."""
    flights, scratch = crowd.flights, crowd.scratch
    ticking = crowd.grain > 0.0
    block = flights.head[queue, DUE]
    while block >= 0:
        for place in places(flights, block):
            i, key, rank = flights.agent[place], flights.key[place], flights.rank[place]
            arrival = flights.arrival[place] if ticking else 0.0
            earlier = key < scratch.first_key[i]
            if key == scratch.first_key[i]:
                same = arrival == scratch.first_arrival[i]
                earlier = rank < scratch.first_rank[i] if same else arrival < scratch.first_arrival[i]
            if earlier:
                scratch.first_key[i], scratch.first_rank[i] = key, rank
                scratch.first_arrival[i] = arrival
        block = flights.following[block]


@formula
def _one_broadcast(crowd: Crowd, queue: int) -> bool:
    """Tell whether all copies that are due are of one broadcast, so that no agent has two."""
    flights = crowd.flights
    block = flights.head[queue, DUE]
    lowest = highest = flights.rank[block * BLOCK]
    while block >= 0:
        for place in places(flights, block):
            lowest = min(lowest, flights.rank[place])
            highest = max(highest, flights.rank[place])
        block = flights.following[block]
    # The copies of a broadcast have consecutive order numbers, one for each agent.
    return bool(highest - lowest < crowd.members.shape[0])


@formula
def _choose(crowd: Crowd, queue: int, block: int, everybody: bool) -> int:
    """List the copies of a block that are answered now; the others wait for the next round, or go."""
    flights, scratch, state = crowd.flights, crowd.scratch, crowd.state
    ticking = crowd.grain > 0.0
    chosen = 0
    for place in places(flights, block):
        i = flights.agent[place]
        if everybody or flights.rank[place] == scratch.first_rank[i]:
            scratch.first_key[i] = LAST
            flights.aloft[0] -= 1
            # A latch that was set already: this tick's signal has been answered.
            latched = ticking and (state.anchor[flights.resource[place], i] == flights.moment[place])
            scratch.chosen[chosen] = place
            chosen += 0 if latched else 1
        else:
            move(flights, queue, LATER, place)
    return chosen


@formula
def _gather(crowd: Crowd, chosen: int) -> None:
    """Bring side by side what the answers of agents far apart in memory are computed from."""
    flights, state, law, scratch = crowd.flights, crowd.state, crowd.law, crowd.scratch
    ticking = crowd.grain > 0.0
    for row in range(chosen):
        place = scratch.chosen[row]
        i, j = flights.agent[place], flights.resource[place]
        moment = flights.moment[place] if ticking else time_of(flights.key[place])
        scratch.moment[row], scratch.since[row] = moment, moment - state.anchor[j, i]
        scratch.held[row], scratch.accumulated[row] = state.demand[j, i], state.accumulated[j, i]
        scratch.increase[row], scratch.gamma[row] = law.increase[j, i], law.normalization[j]


@formula
def _find_slopes(crowd: Crowd, queue: int, chosen: int) -> None:
    """Evaluate the derivatives of the costs at the averages."""
    flights, scratch = crowd.flights, crowd.scratch
    if crowd.coupled or crowd.gradient != 0:
        for row in range(chosen):
            place = scratch.chosen[row]
            i, j = flights.agent[place], flights.resource[place]
            scratch.slope[row] = _marginal_cost(crowd, i, j, scratch.moment[row], scratch.averages[row])
    else:
        slopes = crowd.table.slopes[queue]
        for d in range(slopes.shape[0] - 1, -1, -1):
            for row in range(chosen):
                scratch.coefficient[row] = slopes[d, flights.agent[scratch.chosen[row]]]
            horner_step(
                scratch.slope, scratch.averages, scratch.coefficient, chosen, d == slopes.shape[0] - 1
            )


@formula
def _weigh(crowd: Crowd, queue: int, chosen: int) -> None:
    """Compute averages and response probabilities, pass by pass, so that they are computed side by side."""
    scratch, grain = crowd.scratch, crowd.grain
    _gather(crowd, chosen)
    accumulated, held, increase, since = scratch.accumulated, scratch.held, scratch.increase, scratch.since
    for row in range(chosen):
        scratch.folded[row] = accumulated_at(accumulated[row], held[row], increase[row], since[row], grain)
    for row in range(chosen):
        scratch.averages[row] = time_average(scratch.folded[row], scratch.moment[row], grain)
    for row in range(chosen):
        scratch.present[row] = demand_at(held[row], increase[row], since[row], grain)
    _find_slopes(crowd, queue, chosen)
    for row in range(chosen):
        gamma, slope, average = scratch.gamma[row], scratch.slope[row], scratch.averages[row]
        scratch.probability[row] = response_probability(gamma, slope, average)


@formula
def _answer(crowd: Crowd, chosen: int) -> None:
    """Let agents respond, or hold: Algorithm 2, the branch S = 1."""
    flights, state, law, scratch = crowd.flights, crowd.state, crowd.law, crowd.scratch
    ticking = crowd.grain > 0.0
    for row in range(chosen):
        place = scratch.chosen[row]
        responds = flights.uniform[place] < scratch.probability[row]
        # A tick that holds is a tick without growth; a continuous agent just grows on.
        if responds or ticking:
            i, j = flights.agent[place], flights.resource[place]
            present = scratch.present[row]
            kept = present * law.decrease[j, i] if responds else present
            state.demand[j, i], state.accumulated[j, i] = kept, scratch.folded[row]
            state.anchor[j, i] = scratch.moment[row]
            state.responses[j, i] += responds
            state.saturated[j, i] += scratch.probability[row] > 1.0
            if crowd.hearing > 0 and responds:
                _report(crowd, place, kept - present)
        if crowd.hearing == _ALL_ANSWERS and not responds:
            _report(crowd, place, np.nan)


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
    flights = crowd.flights
    for queue in range(first, last):
        raise_due(flights, queue, time, limit)
        while flights.head[queue, DUE] >= 0:
            everybody = _one_broadcast(crowd, queue)
            if not everybody:
                _find_first(crowd, queue)
            block = flights.head[queue, DUE]
            while block >= 0:
                chosen = _choose(crowd, queue, block, everybody)
                _weigh(crowd, queue, chosen)
                _answer(crowd, chosen)
                block = release(flights, block)
            for ends in (flights.head, flights.tail):
                ends[queue, DUE], ends[queue, LATER] = ends[queue, LATER], -1
