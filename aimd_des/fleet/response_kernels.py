"""Agents answer the copies that are due, in dense passes: each its own in the order of time.

Agents touch each other only through the control unit, so between two samples their order does not matter.
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
from aimd_des.dynamics.demand import demand_at
from aimd_des.dynamics.loss_compensation import (
    ESTIMATED,
    KNOWN,
    NOTHING,
    compensation_factor,
    estimated_loss,
    read_number,
)
from aimd_des.dynamics.responses import (
    AVERAGE,
    DRAWN,
    cut_factor,
    is_saturated,
    probability_of,
    response_probability,
)
from aimd_des.fleet.absent_agents import miss, subject
from aimd_des.fleet.arrays import ALL_ANSWERS, LAST, NO_ANSWERS, FleetAgents, report
from aimd_des.fleet.in_flight import BLOCK, DUE, FORGOTTEN, LATER
from aimd_des.fleet.marginal_cost import marginal_cost_at
from aimd_des.fleet.observer_kernels import FleetOvershoot, ObservedTotals, fold_answers
from aimd_des.fleet.pending_totals import INSTANTS
from aimd_des.fleet.radix_heap import move, places, raise_due, release, time_of
from aimd_des.fleet.row_kernels import settle_rows
from aimd_des.fleet.row_queue import is_alone, is_due, must_leave, spill
from aimd_des.problem.costs.kernels import add_terms, horner_step
from aimd_des.utils.jit import deferred, formula, shared


@formula
def _report(agents: FleetAgents, place: int, resource: int, change: float) -> None:
    """Note the answer to a copy for its listeners."""
    copies = agents.copies
    report(agents.answers, copies.key[place], copies.rank[place], copies.agent[place], resource, change)


@formula
def _find_first(agents: FleetAgents, queue: int) -> None:
    """Find the earliest copy of every agent among those that are due."""
    copies, buffers = agents.copies, agents.buffers
    ticking = agents.tick_weight > 0.0
    block = copies.head[queue, DUE]
    while block >= 0:
        for place in places(copies, block):
            i, key, rank = copies.agent[place], copies.key[place], copies.rank[place]
            arrival = copies.arrival[place] if ticking else 0.0
            # Among copies for one tick, the first to arrive has set the latch, and its draw counts.  Of a
            # continuous agent the key is the arrival, and order numbers decide at once.
            earlier = key < buffers.first_key[i]
            if key == buffers.first_key[i]:
                same = arrival == buffers.first_arrival[i]
                earlier = rank < buffers.first_rank[i] if same else arrival < buffers.first_arrival[i]
            if earlier:
                buffers.first_key[i], buffers.first_rank[i] = key, rank
                buffers.first_arrival[i] = arrival
        block = copies.following[block]


@formula
def _one_broadcast(agents: FleetAgents, queue: int) -> bool:
    """Tell whether all copies that are due are of one broadcast, so that no agent has two."""
    # Worth a pass of its own: where it is so, no first copy has to be found.
    copies = agents.copies
    block = copies.head[queue, DUE]
    lowest = highest = copies.rank[block * BLOCK]
    while block >= 0:
        for place in places(copies, block):
            lowest = min(lowest, copies.rank[place])
            highest = max(highest, copies.rank[place])
        block = copies.following[block]
    # The copies of a broadcast have consecutive order numbers, agent i the i-th: two copies of one agent are
    # at least n apart.  A narrower range may hold parts of two broadcasts, but no agent twice.
    return bool(highest - lowest < agents.members.shape[0])


@formula
def _read_number(agents: FleetAgents, resource: int, agent: int, number: int) -> None:
    """Count a signal that has been heard, by its running number."""
    j, i, state = resource, agent, agents.state
    state.heard[j, i], state.first[j, i], state.latest[j, i] = read_number(
        number,
        state.heard[j, i],
        state.first[j, i],
        state.latest[j, i],
        agents.parameters.compensation.period,
    )


@formula
def _choose(agents: FleetAgents, queue: int, block: int, everybody: bool) -> int:
    """List the copies of a block that are answered now; the others wait for the next round, or go."""
    copies, buffers, state = agents.copies, agents.buffers, agents.state
    ticking, numbered = agents.tick_weight > 0.0, agents.parameters.compensation.rule == ESTIMATED
    chosen = 0
    for place in places(copies, block):
        i = copies.agent[place]
        if everybody or copies.rank[place] == buffers.first_rank[i]:
            # As if no copy of this agent had been seen: the next round begins without a pass over all agents.
            buffers.first_key[i] = LAST
            copies.in_flight[0] -= 1
            resource, second = subject(copies, place)
            if copies.uniform[place] == FORGOTTEN:  # accounted for when it was forgotten
                continue
            # As it is now is as it was when the copy was due: a change of the present agents settles first.
            if agents.account.away[i]:
                miss(agents, resource, i, second)
                continue
            # Numbers are read even where the latch is set; a duplicate would count a signal twice.
            if numbered and not second:
                _read_number(agents, resource, i, copies.number[place])
            # A latch that was set already: this tick's signal has been answered.  Every answer of a discrete
            # agent, a hold as well, begins a new line at its tick; nothing else does at a tick to come.
            latched = ticking and (state.anchor[resource, i] == copies.moment[place])
            # Written in any case and counted if it holds, which needs no branch.
            buffers.chosen[chosen], buffers.resource[chosen] = place, resource
            chosen += 0 if latched else 1
        else:
            move(copies, queue, LATER, place)
    return chosen


@formula
def _gather(agents: FleetAgents, chosen: int) -> None:
    """Bring side by side what the answers of agents far apart in memory are computed from."""
    copies, state, parameters, buffers = agents.copies, agents.state, agents.parameters, agents.buffers
    ticking = agents.tick_weight > 0.0
    for row in range(chosen):
        place = buffers.chosen[row]
        i, j = copies.agent[place], buffers.resource[row]
        moment = copies.moment[place] if ticking else time_of(copies.key[place])
        buffers.moment[row], buffers.since[row] = moment, moment - state.anchor[j, i]
        buffers.age[row] = age_at(moment, state.origin[j, i], agents.tick_weight)
        buffers.held[row], buffers.accumulated[row] = state.demand[j, i], state.accumulated[j, i]
        buffers.increase[row], buffers.gamma[row] = parameters.increase[j, i], parameters.normalization[j]


@deferred
def _find_slopes_in_turn(agents: FleetAgents, chosen: int) -> None:
    """Evaluate derivatives that read all averages of an agent, or call the user's function."""
    buffers = agents.buffers
    for row in range(chosen):
        i, j = agents.copies.agent[buffers.chosen[row]], buffers.resource[row]
        buffers.slope[row] = marginal_cost_at(agents, i, j, buffers.moment[row], buffers.averages[row])


@formula
def _find_slopes(agents: FleetAgents, queue: int, chosen: int) -> None:
    """Evaluate the derivatives of the costs at the averages."""
    copies, buffers = agents.copies, agents.buffers
    if agents.coupled or agents.gradient != 0:
        _find_slopes_in_turn(agents, chosen)
    else:
        # Costs that are separable have a queue for each resource, so all copies at hand are about this one.
        # The polynomial is evaluated degree by degree: the same operations for an agent as one at a time,
        # and so the same bits.
        slopes = agents.table.slopes[queue]
        for d in range(slopes.shape[0] - 1, -1, -1):
            for row in range(chosen):
                buffers.coefficient[row] = slopes[d, copies.agent[buffers.chosen[row]]]
            horner_step(
                buffers.slope, buffers.averages, buffers.coefficient, chosen, d == slopes.shape[0] - 1
            )
        if agents.table.exponentials.shape[1] + agents.table.powers.shape[1] > 0:
            for row in range(chosen):
                i, average = copies.agent[buffers.chosen[row]], buffers.averages[row]
                buffers.slope[row] = add_terms(agents.table, queue, i, average, buffers.slope[row])


@deferred
def _remember(agents: FleetAgents, chosen: int) -> None:
    """Compute what is accumulated, and averages, for any way of averaging."""
    buffers, state, averaging, tick_weight = (
        agents.buffers,
        agents.state,
        agents.parameters.averaging,
        agents.tick_weight,
    )
    for row in range(chosen):
        i, j = agents.copies.agent[buffers.chosen[row]], buffers.resource[row]
        line = (buffers.accumulated[row], buffers.held[row], buffers.increase[row])
        before = age_at(state.anchor[j, i], state.origin[j, i], tick_weight)
        folded = folded_at(averaging, *line, buffers.since[row], before, tick_weight)
        span = (state.anchor[j, i], state.origin[j, i], buffers.moment[row], tick_weight)
        buffers.folded[row] = folded
        buffers.averages[row] = average_at(averaging, state.parts, j, i, folded, *line, *span)


# Apart, so that the loops of the paper's rule stay as short as they are without the others.
@deferred
def _find_probabilities(agents: FleetAgents, chosen: int) -> None:
    """Compute response probabilities where lambda divides by another than the average over time."""
    buffers, parameters, memory = agents.buffers, agents.parameters, agents.state.memory
    for row in range(chosen):
        i, j = agents.copies.agent[buffers.chosen[row]], buffers.resource[row]
        lines = (buffers.present[row], buffers.increase[row], parameters.decrease[j, i], buffers.age[row])
        found = (buffers.gamma[row], buffers.slope[row], buffers.averages[row], *lines)
        buffers.probability[row] = probability_of(
            parameters.response, parameters.averaging, memory, j, i, *found
        )


@deferred
def _cut(agents: FleetAgents, chosen: int) -> None:
    """Compute what demands are multiplied by where no draw decides."""
    buffers, parameters, memory, copies = (
        agents.buffers,
        agents.parameters,
        agents.state.memory,
        agents.copies,
    )
    for row in range(chosen):
        place = buffers.chosen[row]
        i, j = copies.agent[place], buffers.resource[row]
        found = (buffers.probability[row], copies.uniform[place], buffers.present[row])
        buffers.factor[row] = cut_factor(
            parameters.response, parameters.averaging, memory, j, i, *found, parameters.decrease[j, i]
        )


@deferred
def _compensate(agents: FleetAgents, chosen: int) -> None:
    """Compensate for the signals that agents lose, or estimate that they lose."""
    buffers, state, compensation = agents.buffers, agents.state, agents.parameters.compensation
    for row in range(chosen):
        i, j = agents.copies.agent[buffers.chosen[row]], buffers.resource[row]
        # This answer counts among those that the factor is computed from, as it does for a process.
        state.answered[j, i] += 1
        if compensation.rule == KNOWN:
            loss = compensation.loss[i]
        else:
            loss = estimated_loss(state.heard[j, i], state.first[j, i], state.latest[j, i])
        factor = compensation_factor(loss, state.answered[j, i], buffers.age[row], agents.tick_weight)
        buffers.probability[row] *= factor


@formula
def _weigh(agents: FleetAgents, queue: int, chosen: int) -> None:
    """Compute averages and response probabilities, pass by pass, so that they are computed side by side."""
    # Every agent is in `chosen` once at most, so no row reads what another one writes.
    buffers, tick_weight = agents.buffers, agents.tick_weight
    _gather(agents, chosen)
    accumulated, held, increase, since = buffers.accumulated, buffers.held, buffers.increase, buffers.since
    # A loop for each formula, without a branch or an index into other arrays, becomes vector instructions.
    if agents.parameters.averaging.kind == CUMULATIVE:
        for row in range(chosen):
            sums, span = accumulated[row], since[row]
            buffers.folded[row] = accumulated_at(sums, held[row], increase[row], span, tick_weight)
        for row in range(chosen):
            buffers.averages[row] = time_average(buffers.folded[row], buffers.age[row])
    else:
        _remember(agents, chosen)
    for row in range(chosen):
        buffers.present[row] = demand_at(held[row], increase[row], since[row], tick_weight)
    _find_slopes(agents, queue, chosen)
    if agents.parameters.response.divisor == AVERAGE:
        for row in range(chosen):
            gamma, slope, average = buffers.gamma[row], buffers.slope[row], buffers.averages[row]
            buffers.probability[row] = response_probability(gamma, slope, average)
    else:
        _find_probabilities(agents, chosen)
    if agents.parameters.compensation.rule != NOTHING:
        _compensate(agents, chosen)
    if agents.parameters.response.cut != DRAWN:
        _cut(agents, chosen)


@formula
def _answer(agents: FleetAgents, chosen: int) -> None:
    """Let agents respond, or hold: Algorithm 2, the branch S = 1."""
    copies, state, parameters, buffers = agents.copies, agents.state, agents.parameters, agents.buffers
    ticking, averaging, response = agents.tick_weight > 0.0, parameters.averaging, parameters.response
    drawn = response.cut == DRAWN
    for row in range(chosen):
        place = buffers.chosen[row]
        responds = copies.uniform[place] < buffers.probability[row] if drawn else buffers.factor[row] < 1.0
        # A tick that holds is a tick without growth; a continuous agent just grows on.
        if responds or ticking:
            i, j = copies.agent[place], buffers.resource[row]
            present = buffers.present[row]
            if averaging.kind == WINDOW:
                # Before the line is overwritten, from which alone it is known what was accumulated on it.
                line = (buffers.accumulated[row], buffers.held[row], buffers.increase[row])
                span = (state.anchor[j, i], state.origin[j, i], buffers.moment[row], agents.tick_weight)
                keep_parts(averaging, state.parts, j, i, *line, *span)
            kept = present
            if responds:
                kept *= parameters.decrease[j, i] if drawn else buffers.factor[row]
            state.demand[j, i], state.accumulated[j, i] = kept, buffers.folded[row]
            state.anchor[j, i] = buffers.moment[row]
            state.responses[j, i] += responds
            # Only responses are counted: every draw is below 1, so above 1 no agent holds.
            if buffers.probability[row] > 1.0:
                decrease = parameters.decrease[j, i]
                state.saturated[j, i] += is_saturated(response, buffers.probability[row], decrease)
            if agents.reported != NO_ANSWERS and responds:
                _report(agents, place, j, kept - present)
        if agents.reported == ALL_ANSWERS and not responds:
            # Not 0: a response of an agent that holds nothing changes demand by 0 as well.
            _report(agents, place, buffers.resource[row], np.nan)


@deferred
def _settle_queue(agents: FleetAgents, queue: int, time: float, limit: int) -> None:
    """Let all agents answer the copies in one queue that are due."""
    copies = agents.copies
    raise_due(copies, queue, time, limit)
    # A round answers one copy of each agent at most; a second one finds what the first has changed.
    while copies.head[queue, DUE] >= 0:
        everybody = _one_broadcast(agents, queue)
        if not everybody:
            _find_first(agents, queue)
        block = copies.head[queue, DUE]
        while block >= 0:
            chosen = _choose(agents, queue, block, everybody)
            _weigh(agents, queue, chosen)
            _answer(agents, chosen)
            block = release(copies, block)
        # All blocks of the round have been given back; those that wait are due in the next one.
        for ends in (copies.head, copies.tail):
            ends[queue, DUE], ends[queue, LATER] = ends[queue, LATER], -1


@shared
def settle(
    agents: FleetAgents, integrals: FleetOvershoot, first: int, last: int, time: float, limit: int
) -> None:
    """Let all agents answer the copies that are due, in the queues from `first` to the one before `last`."""
    # What is due before `time` is due; at this very time, as `raise_due` has it.  Agents are answered in the
    # order of chains, not of time: an answer reads and writes one agent's columns alone, and totals are
    # added up afterwards.
    for queue in range(first, last):
        while agents.rows.serving[queue]:
            if must_leave(agents, queue, time, limit):
                spill(agents, queue)
                break
            settle_rows(agents, queue, time, limit)
            # What has waited behind the row is the row now.
            if not is_due(agents.rows.first[queue], time, limit):
                break
        # Asked again: rows that have no space for what is left go there.
        if agents.copies.in_flight[0] > 0 and not agents.rows.serving[queue]:
            _settle_queue(agents, queue, time, limit)
        # Answers may be folded in now: all that are earlier have been computed.  Overshoot is integrated for
        # each resource, so answers for others may be folded in at another time.
        if integrals.lines and agents.answers.held[0] > 0:
            fold_answers(agents.answers, integrals)


@deferred
def settle_and_take(
    agents: FleetAgents,
    integrals: FleetOvershoot,
    observed: ObservedTotals,
    first: int,
    last: int,
    time: float,
    limit: int,
) -> None:
    """Do what `settle` does, and take the totals that wait for it, none of them later."""
    pending, rows, j = agents.pending, agents.rows, first
    while j < last:
        begin = observed.taken[j]
        waiting = observed.row[0] - begin
        count, until, order = min(INSTANTS, waiting), time, limit
        if count < waiting:
            until, order = observed.times[begin + count - 1], LAST
        in_rows = (
            rows.serving[j] and not must_leave(agents, j, until, order) and is_alone(rows, j, until, order)
        )
        if count > 0 and not in_rows:
            # A heap is settled at each instant, and so are several broadcasts that are due.
            count, until, order = 1, observed.times[begin], LAST
        for instant in range(count):
            pending.times[instant] = observed.times[begin + instant]
        pending.waiting[0] = count if in_rows else 0
        settle(agents, integrals, j, j + 1, until, order)
        if count > 0 and not in_rows:
            pending.waiting[0] = count
            settle_rows(agents, j, until, order)
        pending.waiting[0] = 0
        for instant in range(count):
            observed.demand[begin + instant, j] = pending.demand[instant]
            observed.average[begin + instant, j] = pending.average[instant]
        observed.taken[j] = begin + count
        # The last pass has gone on to the time that is asked for.
        if count == 0 or (in_rows and count == waiting):
            j += 1
