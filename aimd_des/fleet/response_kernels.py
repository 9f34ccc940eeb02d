"""Agents answer the copies that are due, in dense passes: each its own in the order of time.

Agents touch each other only through the control unit, so between two looks their order does not matter.
In every round each agent answers the earliest of its copies that are due, and most have no other.
"""

import numpy as np

from aimd_des.dynamics.averaging import (
    CUMULATIVE,
    WINDOW,
    accumulated_at,
    age_at,
    average_at,
    folded_at,
    keep_parts,
    time_average,
)
from aimd_des.dynamics.loss_compensation import (
    ESTIMATED,
    KNOWN,
    NOTHING,
    compensation_factor,
    estimated_loss,
    read_number,
)
from aimd_des.dynamics.response import demand_at, response_probability
from aimd_des.fleet.absent_agents import miss, subject
from aimd_des.fleet.arrays import ALL_ANSWERS, LAST, NOBODY, Crowd
from aimd_des.fleet.in_flight import BLOCK, DUE, FORGOTTEN, LATER
from aimd_des.fleet.marginal_cost import marginal_cost_at
from aimd_des.fleet.radix_heap import move, places, raise_due, release, time_of
from aimd_des.problem.costs.kernels import horner_step
from aimd_des.utils.jit import formula, kernel

__all__ = ["settle"]


@formula
def _report(crowd: Crowd, place: int, resource: int, change: float) -> None:
    """Note an answer for those who want to know of it."""
    answers, flights = crowd.answers, crowd.flights
    # There is always a row.  Only what is sent adds to answers and copies in flight together; it waits where
    # copies have no room (`room`) or answers are more than `TOLD_AT_ONCE`, and there are rows for both.
    row = answers.held[0]
    answers.key[row] = flights.key[place]
    answers.rank[row] = flights.rank[place]
    answers.agent[row] = flights.agent[place]
    answers.resource[row] = resource
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
            # Among copies for one tick, the first to arrive has set the latch, and its draw counts.  Of a
            # continuous agent the key is the arrival, and order numbers decide at once.
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
    # Worth a pass of its own: where it is so, nobody's first copy has to be found.
    flights = crowd.flights
    block = flights.head[queue, DUE]
    lowest = highest = flights.rank[block * BLOCK]
    while block >= 0:
        for place in places(flights, block):
            lowest = min(lowest, flights.rank[place])
            highest = max(highest, flights.rank[place])
        block = flights.following[block]
    # The copies of a broadcast have consecutive order numbers, agent i the i-th: two copies of one agent are
    # at least n apart.  A narrower range may hold parts of two broadcasts, but no agent twice.
    return bool(highest - lowest < crowd.members.shape[0])


@formula
def _read_number(crowd: Crowd, resource: int, agent: int, number: int) -> None:
    """Count a signal that has been heard, by its running number."""
    j, i, state = resource, agent, crowd.state
    state.heard[j, i], state.first[j, i], state.latest[j, i] = read_number(
        number, state.heard[j, i], state.first[j, i], state.latest[j, i], crowd.law.answering.period
    )


@formula
def _choose(crowd: Crowd, queue: int, block: int, everybody: bool) -> int:
    """List the copies of a block that are answered now; the others wait for the next round, or go."""
    flights, scratch, state = crowd.flights, crowd.scratch, crowd.state
    ticking, numbered = crowd.grain > 0.0, crowd.law.answering.rule == ESTIMATED
    chosen = 0
    for place in places(flights, block):
        i = flights.agent[place]
        if everybody or flights.rank[place] == scratch.first_rank[i]:
            # As if no copy of this agent had been seen: the next round begins without a pass over all agents.
            scratch.first_key[i] = LAST
            flights.aloft[0] -= 1
            resource, second = subject(flights, place)
            if flights.uniform[place] == FORGOTTEN:  # accounted for when it was forgotten
                continue
            # As it is now is as it was when the copy was due: whoever lets an agent come or go settles first.
            if crowd.books.away[i]:
                miss(crowd, resource, i, second)
                continue
            # Numbers are read even where the latch is set; a duplicate would count a signal twice.
            if numbered and not second:
                _read_number(crowd, resource, i, flights.number[place])
            # A latch that was set already: this tick's signal has been answered.  Every answer of a discrete
            # agent, a hold as well, begins a new line at its tick; nothing else does at a tick to come.
            latched = ticking and (state.anchor[resource, i] == flights.moment[place])
            # Written in any case and counted if it holds, which needs no branch.
            scratch.chosen[chosen], scratch.resource[chosen] = place, resource
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
        i, j = flights.agent[place], scratch.resource[row]
        moment = flights.moment[place] if ticking else time_of(flights.key[place])
        scratch.moment[row], scratch.since[row] = moment, moment - state.anchor[j, i]
        scratch.age[row] = age_at(moment, state.origin[j, i], crowd.grain)
        scratch.held[row], scratch.accumulated[row] = state.demand[j, i], state.accumulated[j, i]
        scratch.increase[row], scratch.gamma[row] = law.increase[j, i], law.normalization[j]


@formula
def _find_slopes(crowd: Crowd, queue: int, chosen: int) -> None:
    """Evaluate the derivatives of the costs at the averages."""
    flights, scratch = crowd.flights, crowd.scratch
    if crowd.coupled or crowd.gradient != 0:
        # One after the other: a derivative reads all averages of its agent, or calls the user's function.
        for row in range(chosen):
            place = scratch.chosen[row]
            i, j = flights.agent[place], scratch.resource[row]
            scratch.slope[row] = marginal_cost_at(crowd, i, j, scratch.moment[row], scratch.averages[row])
    else:
        # Costs that are separable have a queue for each resource, so all copies at hand are about this one.
        # The polynomial is evaluated degree by degree: the same operations for an agent as one at a time,
        # and so the same bits.
        slopes = crowd.table.slopes[queue]
        for d in range(slopes.shape[0] - 1, -1, -1):
            for row in range(chosen):
                scratch.coefficient[row] = slopes[d, flights.agent[scratch.chosen[row]]]
            horner_step(
                scratch.slope, scratch.averages, scratch.coefficient, chosen, d == slopes.shape[0] - 1
            )


@formula
def _remember(crowd: Crowd, chosen: int) -> None:
    """Compute what is accumulated, and averages, in whatever way demand is averaged."""
    scratch, state, memory, grain = crowd.scratch, crowd.state, crowd.law.memory, crowd.grain
    for row in range(chosen):
        i, j = crowd.flights.agent[scratch.chosen[row]], scratch.resource[row]
        line = (scratch.accumulated[row], scratch.held[row], scratch.increase[row])
        folded = folded_at(memory, *line, scratch.since[row], grain)
        span = (state.anchor[j, i], state.origin[j, i], scratch.moment[row], grain)
        scratch.folded[row] = folded
        scratch.averages[row] = average_at(memory, state.parts, j, i, folded, *line, *span)


@formula
def _compensate(crowd: Crowd, chosen: int) -> None:
    """Make good for the signals that agents lose, or estimate that they lose."""
    scratch, state, answering = crowd.scratch, crowd.state, crowd.law.answering
    for row in range(chosen):
        i, j = crowd.flights.agent[scratch.chosen[row]], scratch.resource[row]
        # This answer counts among those that the factor is computed from, as it does for a process.
        state.answered[j, i] += 1
        if answering.rule == KNOWN:
            loss = answering.loss[i]
        else:
            loss = estimated_loss(state.heard[j, i], state.first[j, i], state.latest[j, i])
        factor = compensation_factor(loss, state.answered[j, i], scratch.age[row], crowd.grain)
        scratch.probability[row] *= factor


@formula
def _weigh(crowd: Crowd, queue: int, chosen: int) -> None:
    """Compute averages and response probabilities, pass by pass, so that they are computed side by side."""
    # Every agent is in `chosen` once at most, so no row reads what another one writes.
    scratch, grain = crowd.scratch, crowd.grain
    _gather(crowd, chosen)
    accumulated, held, increase, since = scratch.accumulated, scratch.held, scratch.increase, scratch.since
    # A loop for each formula, without a branch or an index into other arrays, becomes vector instructions.
    if crowd.law.memory.kind == CUMULATIVE:
        for row in range(chosen):
            sums, span = accumulated[row], since[row]
            scratch.folded[row] = accumulated_at(sums, held[row], increase[row], span, grain)
        for row in range(chosen):
            scratch.averages[row] = time_average(scratch.folded[row], scratch.age[row])
    else:
        _remember(crowd, chosen)
    for row in range(chosen):
        scratch.present[row] = demand_at(held[row], increase[row], since[row], grain)
    _find_slopes(crowd, queue, chosen)
    for row in range(chosen):
        gamma, slope, average = scratch.gamma[row], scratch.slope[row], scratch.averages[row]
        scratch.probability[row] = response_probability(gamma, slope, average)
    if crowd.law.answering.rule != NOTHING:
        _compensate(crowd, chosen)


@formula
def _answer(crowd: Crowd, chosen: int) -> None:
    """Let agents respond, or hold: Algorithm 2, the branch S = 1."""
    flights, state, law, scratch = crowd.flights, crowd.state, crowd.law, crowd.scratch
    ticking, memory = crowd.grain > 0.0, law.memory
    for row in range(chosen):
        place = scratch.chosen[row]
        responds = flights.uniform[place] < scratch.probability[row]
        # A tick that holds is a tick without growth; a continuous agent just grows on.
        if responds or ticking:
            i, j = flights.agent[place], scratch.resource[row]
            present = scratch.present[row]
            if memory.kind == WINDOW:
                # Before the line is overwritten, from which alone it is known what was accumulated on it.
                line = (scratch.accumulated[row], scratch.held[row], scratch.increase[row])
                span = (state.anchor[j, i], state.origin[j, i], scratch.moment[row], crowd.grain)
                keep_parts(memory, state.parts, j, i, *line, *span)
            kept = present * law.decrease[j, i] if responds else present
            state.demand[j, i], state.accumulated[j, i] = kept, scratch.folded[row]
            state.anchor[j, i] = scratch.moment[row]
            state.responses[j, i] += responds
            # Only responses are counted: every draw is below 1, so above 1 nobody holds.
            state.saturated[j, i] += scratch.probability[row] > 1.0
            if crowd.hearing != NOBODY and responds:
                _report(crowd, place, j, kept - present)
        if crowd.hearing == ALL_ANSWERS and not responds:
            # Not 0: a response of somebody who holds nothing changes demand by 0 as well.
            _report(crowd, place, scratch.resource[row], np.nan)


@kernel
def settle(crowd: Crowd, first: int, last: int, time: float, limit: int) -> None:
    """Let all agents answer the copies that are due, in the queues from `first` to the one before `last`."""
    # What is due before `time` is due; at this very time, as `raise_due` has it.  Agents are answered in the
    # order of chains, not of time: an answer reads and writes one agent's columns alone, and totals are
    # added up afterwards.
    flights = crowd.flights
    for queue in range(first, last):
        raise_due(flights, queue, time, limit)
        # A round answers one copy of each agent at most; a second one finds what the first has changed.
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
            # All blocks of the round have been given back; those that wait are due in the next one.
            for ends in (flights.head, flights.tail):
                ends[queue, DUE], ends[queue, LATER] = ends[queue, LATER], -1
