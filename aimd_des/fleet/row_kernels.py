"""Agents answer a broadcast that is a row: each its own copies in the order of time, most in one pass.

Agent i's copy in the row may come before or after copies of earlier broadcasts that are still listed.  So of
what is due, listed copies that come before the row's are answered first, then the row, then the others.
"""

from typing import Any, NamedTuple

import numpy as np

from aimd_des.dynamics.averaging import accumulated_at, age_at, time_average
from aimd_des.dynamics.demand import CONTINUOUS, demand_at
from aimd_des.dynamics.responses import AVERAGE, DRAWN, is_saturated, response_probability
from aimd_des.fleet.absent_agents import comes_before, miss
from aimd_des.fleet.arrays import ALL_ANSWERS, LAST, NO_ANSWERS, FleetAgents, report
from aimd_des.fleet.broadcast_rows import BroadcastRows
from aimd_des.fleet.in_flight import PIECE, IntArray
from aimd_des.fleet.pending_totals import begin_piece, break_line, break_lines, end_piece
from aimd_des.fleet.radix_heap import bits_of, time_of
from aimd_des.fleet.row_queue import end_row, is_due, list_row
from aimd_des.fleet.row_response_kernels import (
    cut_otherwise,
    factor_otherwise,
    probability_otherwise,
    weigh_otherwise,
)
from aimd_des.problem.costs.kernels import add_terms, horner_at, horner_row
from aimd_des.utils.jit import deferred, formula
from aimd_des.utils.opaque import opaque
from aimd_des.utils.validation import FloatArray


class ResourceRows(NamedTuple):
    """State, parameters and slopes of all agents for one resource."""

    # Looked up once for a look: in a loop over agents each would be found anew for each agent.
    demand: FloatArray
    accumulated: FloatArray
    anchor: FloatArray
    origin: FloatArray
    responses: IntArray
    saturated: IntArray
    increase: FloatArray
    decrease: FloatArray
    slopes: FloatArray


@formula
def _resource_rows(agents: FleetAgents, resource: int) -> ResourceRows:
    j, state, parameters = resource, agents.state, agents.parameters
    return ResourceRows(
        state.demand[j],
        state.accumulated[j],
        state.anchor[j],
        state.origin[j],
        state.responses[j],
        state.saturated[j],
        parameters.increase[j],
        parameters.decrease[j],
        agents.table.slopes[j],
    )


@formula
def _either(mask: int, one: float, other: float) -> float:
    """Choose one number if all bits of the mask are set, another if none is."""
    a, b = np.float64(one).view(np.int64), np.float64(other).view(np.int64)
    return float(np.int64(b ^ ((a ^ b) & mask)).view(np.float64))


@formula
def _sort_by_pieces(rows: BroadcastRows, count: int) -> None:
    """Find the order in which the agents of a piece have their listed copies that are due side by side."""
    ends, order = rows.due_end, rows.due_order
    # Without a sign: compiled code need not ask whether an index counts from the end.
    length = np.uint64(PIECE)
    for piece in range(ends.shape[0]):
        ends[piece] = 0
    for place in range(count):
        ends[np.uint64(rows.due_agent[place]) // length] += 1
    begin = 0
    for piece in range(ends.shape[0]):
        held = ends[piece]
        ends[piece] = begin
        begin += held
    for place in range(count):
        own = np.uint64(rows.due_agent[place]) // length
        order[ends[own]] = place
        ends[own] += 1


@formula
def _take_due(rows: BroadcastRows, resource: int, time: float, limit: int, by_pieces: bool) -> None:
    """Take the listed copies that are due out of the list; if asked, sort them by the pieces of agents."""
    # Both keep their order: agents that are answered one after the other are near each other in memory then.
    j = resource
    agents, arrivals = rows.listed_agent[j], rows.listed_arrival[j]
    uniforms, ranks = rows.listed_uniform[j], rows.listed_rank[j]
    due, kept, soonest = np.uint64(0), np.uint64(0), bits_of(np.inf)
    for place in range(rows.listed[j]):
        agent, arrival, uniform, rank = agents[place], arrivals[place], uniforms[place], ranks[place]
        # Written to both, and counted where it belongs, which needs no branch.
        rows.due_agent[due], rows.due_arrival[due] = agent, arrival
        rows.due_uniform[due], rows.due_rank[due] = uniform, rank
        agents[kept], arrivals[kept], uniforms[kept], ranks[kept] = agent, arrival, uniform, rank
        is_due = comes_before(arrival, rank, time, limit)
        due += np.uint64(is_due)
        kept += np.uint64(not is_due)
        soonest = min(soonest, LAST if is_due else bits_of(arrival))
    rows.listed[j], rows.first_listed[j] = kept, time_of(soonest)
    if by_pieces and rows.due_end.shape[0] > 1:
        _sort_by_pieces(rows, int(due))
        return
    for place in range(due):
        rows.due_order[place] = place
    rows.due_end[0] = due


@formula
def _answer_listed(agents: FleetAgents, row: ResourceRows, resource: int, place: int) -> bool:
    """Let one agent answer a listed copy, and tell whether it responds: Algorithm 2, the branch S = 1."""
    j, rows, response = resource, agents.rows, agents.parameters.response
    i: Any = np.uint64(rows.due_agent[place])
    agent: Any = np.int64(i)
    moment = rows.due_arrival[place]
    if agents.account.away[i]:
        miss(agents, j, agent, False)
        return False
    held, increase, since = row.demand[i], row.increase[i], moment - row.anchor[i]
    before = row.accumulated[i]
    folded = accumulated_at(before, held, increase, since, CONTINUOUS)
    average = time_average(folded, age_at(moment, row.origin[i], CONTINUOUS))
    slope = add_terms(agents.table, j, agent, average, horner_at(row.slopes, i, average))
    present = demand_at(held, increase, since, CONTINUOUS)
    if response.divisor == AVERAGE:
        probability = response_probability(agents.parameters.normalization[j], slope, average)
    else:
        probability = probability_otherwise(agents, j, agent, slope, average, present, moment)
    factor, chance = row.decrease[i], probability
    if response.cut != DRAWN:
        factor = factor_otherwise(agents, j, agent, probability, present)
        chance = 1.0 if factor < 1.0 else 0.0
    kept, responds = present * factor, rows.due_uniform[place] < chance
    # Whether an agent responds is as good as random, so a branch would often be predicted wrongly.  LLVM
    # makes one of what chooses between two numbers, unless it cannot tell what the mask is.
    mask: Any = opaque(np.int64(0) - np.int64(responds))
    row.demand[i] = _either(mask, kept, held)
    row.accumulated[i] = _either(mask, folded, before)
    row.anchor[i] = _either(mask, moment, row.anchor[i])
    row.responses[i] += responds
    if is_saturated(response, probability, row.decrease[i]):
        row.saturated[i] += responds
    if agents.reported != NO_ANSWERS:
        change = kept - present if responds else np.nan
        report(agents.answers, bits_of(moment), rows.due_rank[place], agent, j, change)
        # Written in any case, and counted if a listener asks for it.
        agents.answers.held[0] -= agents.reported != ALL_ANSWERS and not responds
    return bool(responds)


@formula
def _comes_before(rows: BroadcastRows, place: int, other: int) -> bool:
    """Tell which of two copies that are due is the earlier one."""
    if rows.due_arrival[place] == rows.due_arrival[other]:
        return bool(rows.due_rank[place] < rows.due_rank[other])
    return bool(rows.due_arrival[place] < rows.due_arrival[other])


@formula
def _comes_after_row(rows: BroadcastRows, resource: int, place: int) -> bool:
    """Tell whether the agent's copy in the row comes before one that is due, and so is due itself."""
    i = rows.due_agent[place]
    arrival = rows.arrival[resource, i]
    if arrival == rows.due_arrival[place]:
        return bool(rows.rank[resource] + np.int64(i) < rows.due_rank[place])
    return bool(arrival < rows.due_arrival[place])


@formula
def _answer_in_turn(
    agents: FleetAgents, resource: int, first: int, begin: int, end: int, row_waits: bool
) -> int:
    """Answer listed copies of a piece that are due; tell where those end that have to wait for the row."""
    # A round answers one copy of each agent at most, its earliest; hardly any agent has two.
    rows, earliest, row = agents.rows, agents.buffers.first_key, _resource_rows(agents, resource)
    # Where totals are taken, these are the agents of a piece, which is as many as there is room for here.
    order, broken, taking = rows.due_order, agents.buffers.chosen, agents.pending.waiting[0] > 0
    while begin < end:
        for turn in range(begin, end):
            place = order[turn]
            k = rows.due_agent[place] - np.uint64(first)
            if earliest[k] == LAST or _comes_before(rows, place, earliest[k]):
                earliest[k] = place
        waiting, count = begin, np.uint64(0)
        for turn in range(begin, end):
            place = order[turn]
            k = rows.due_agent[place] - np.uint64(first)
            if earliest[k] == place:
                earliest[k] = LAST
                if not (row_waits and _comes_after_row(rows, resource, place)):
                    responds = _answer_listed(agents, row, resource, place)
                    if taking:
                        broken[count] = place
                        count += np.uint64(responds)
                    continue
            order[waiting] = place
            waiting += 1
        for line in range(count):
            agent: Any = np.int64(rows.due_agent[broken[line]])
            break_line(agents.pending, agents.state, agents.parameters, resource, agent, first)
        if waiting == end:
            break
        end = waiting
    return end


@formula
def _weigh_piece(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> None:
    """Compute averages and response probabilities of some agents at their copies in the row."""
    # A loop for each formula, over few arrays and without a branch, becomes vector instructions.  What a
    # lost copy brings forth, at infinity, is never read.
    j, count, buffers, tick_weight = resource, last - first, agents.buffers, agents.tick_weight
    arrival, held = agents.rows.arrival[j][first:last], agents.state.demand[j][first:last]
    accumulated, anchor = agents.state.accumulated[j][first:last], agents.state.anchor[j][first:last]
    origin, increase = agents.state.origin[j][first:last], agents.parameters.increase[j][first:last]
    folded, average, slope = buffers.folded[:count], buffers.averages[:count], buffers.slope[:count]
    present, probability = buffers.present[:count], buffers.probability[:count]
    for k in range(count):
        since = arrival[k] - anchor[k]
        folded[k] = accumulated_at(accumulated[k], held[k], increase[k], since, tick_weight)
    for k in range(count):
        average[k] = time_average(folded[k], age_at(arrival[k], origin[k], tick_weight))
    for k in range(count):
        present[k] = demand_at(held[k], increase[k], arrival[k] - anchor[k], tick_weight)
    horner_row(agents.table.slopes[j], first, average, slope)
    if agents.table.exponentials.shape[1] + agents.table.powers.shape[1] > 0:
        for k in range(count):
            if arrival[k] <= bound:
                slope[k] = add_terms(agents.table, j, first + k, average[k], slope[k])
    if agents.parameters.response.divisor == AVERAGE:
        gamma = agents.parameters.normalization[j]
        for k in range(count):
            probability[k] = response_probability(gamma, slope[k], average[k])
    else:
        weigh_otherwise(agents, j, first, last, bound)


@formula
def _decide_piece(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> bool:
    """Find which of some agents respond, and what they keep; tell whether any probability is above 1."""
    j, count, buffers = resource, last - first, agents.buffers
    arrival, uniform = agents.rows.arrival[j][first:last], agents.rows.uniform[j][first:last]
    decrease = agents.parameters.decrease[j][first:last]
    kept, responds, saturated = buffers.kept[:count], buffers.resource[:count], 0
    if agents.parameters.response.cut == DRAWN:
        for k in range(count):
            kept[k] = buffers.present[k] * decrease[k]
        for k in range(count):
            cuts = (arrival[k] <= bound) & (uniform[k] < buffers.probability[k])
            responds[k] = cuts
            saturated += cuts & (buffers.probability[k] > 1.0)
    else:
        cut_otherwise(agents, j, first, last, bound)
        for k in range(count):
            kept[k] = buffers.present[k] * buffers.factor[k]
        for k in range(count):
            responds[k] = buffers.factor[k] < 1.0
            saturated += buffers.probability[k] > 1.0
    return saturated > 0


@formula
def _answer_piece(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> None:
    """Let some agents respond to their copies in the row, those that arrive up to a time, or hold."""
    j, count, state, buffers = resource, last - first, agents.state, agents.buffers
    arrival, held = agents.rows.arrival[j][first:last], state.demand[j][first:last]
    accumulated, anchor = state.accumulated[j][first:last], state.anchor[j][first:last]
    responses, decrease = state.responses[j][first:last], agents.parameters.decrease[j][first:last]
    saturated = _decide_piece(agents, j, first, last, bound)
    kept, responds = buffers.kept[:count], buffers.resource[:count]
    begins = responds
    if agents.tick_weight > 0.0:
        # A tick that holds is a tick without growth; a continuous agent just grows on.
        begins = buffers.begins[:count]
        for k in range(count):
            cut, present = kept[k], buffers.present[k]
            kept[k] = cut if responds[k] != 0 else present
        for k in range(count):
            begins[k] = arrival[k] <= bound
    for k in range(count):
        new, before = kept[k], held[k]
        held[k] = new if begins[k] != 0 else before
    for k in range(count):
        folded, before = buffers.folded[k], accumulated[k]
        accumulated[k] = folded if begins[k] != 0 else before
    for k in range(count):
        moment, before = arrival[k], anchor[k]
        anchor[k] = moment if begins[k] != 0 else before
    for k in range(count):
        responses[k] += responds[k]
    if saturated:
        for k in range(count):
            above = is_saturated(agents.parameters.response, buffers.probability[k], decrease[k])
            state.saturated[j, first + k] += responds[k] != 0 and above


@formula
def _report_piece(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> None:
    """Note the answers of some agents for their listeners."""
    j, rows, buffers, answers = resource, agents.rows, agents.buffers, agents.answers
    arrival, due, ticking = rows.arrival[j][first:last], rows.first[j], agents.tick_weight > 0.0
    # First only which agents answer, without a branch.
    count = np.uint64(0)
    if agents.reported == ALL_ANSWERS:
        for k in range(last - first):
            buffers.chosen[count] = k
            count += np.uint64(arrival[k] <= bound)
    else:
        for k in range(last - first):
            buffers.chosen[count] = k
            count += np.uint64(buffers.resource[k])
    begin, rank = answers.held[0], rows.rank[j] + first
    key, ranks = answers.key[begin:], answers.rank[begin:]
    agent, about, change = answers.agent[begin:], answers.resource[begin:], answers.change[begin:]
    for row in range(count):
        k = buffers.chosen[row]
        key[row], ranks[row] = bits_of(due if ticking else arrival[k]), rank + np.int64(k)
        agent[row], about[row] = first + np.int64(k), j
        change[row] = buffers.kept[k] - buffers.present[k] if buffers.resource[k] != 0 else np.nan
    answers.held[0] = begin + np.int64(count)


@formula
def _take_out(agents: FleetAgents, resource: int, time: float, limit: int) -> None:
    """Take copies out of the row that are due and not answered: at agents that are away, or latched."""
    away, anybody = agents.account.away, False
    for i in range(away.shape[0]):
        anybody |= away[i]
    if anybody:
        row, rank = agents.rows.arrival[resource], agents.rows.rank[resource]
        for i in range(away.shape[0]):
            if away[i] and comes_before(row[i], rank + i, time, limit):
                miss(agents, resource, i, False)
                row[i] = np.inf
    if agents.tick_weight > 0.0:
        # A latch that was set already: this tick's signal has been answered.  Every answer of a discrete
        # agent, a hold as well, begins a new line at its tick; nothing else does at a tick to come.
        ticks, anchor = agents.rows.arrival[resource], agents.state.anchor[resource]
        for i in range(ticks.shape[0]):
            tick = ticks[i]
            ticks[i] = np.inf if anchor[i] == tick else tick


@formula
def _answer_row(agents: FleetAgents, resource: int, piece: int, end: int, time: float, limit: int) -> None:
    """Answer what is due of a piece of the row, and list the rest."""
    rows, pending = agents.rows, agents.pending
    # At this very time the copies of the first agents are due, whose order numbers are below the limit.
    split, first = limit - rows.rank[resource], piece
    while first < end:
        last = min(first + PIECE, min(end, split) if first < split else end)
        bound = time if first < split else np.nextafter(time, -np.inf)
        _weigh_piece(agents, resource, first, last, bound)
        _answer_piece(agents, resource, first, last, bound)
        if pending.waiting[0] > 0:
            parameters, responds = agents.parameters, agents.buffers.resource
            break_lines(pending, agents.state, parameters, resource, first, last, first - piece, responds)
        if agents.reported != NO_ANSWERS:
            _report_piece(agents, resource, first, last, bound)
        if agents.tick_weight == 0.0:
            list_row(rows, resource, first, last, bound)
        first = last


@deferred
def settle_rows(agents: FleetAgents, resource: int, time: float, limit: int) -> None:
    """Let all agents answer what is due of row and list, and take the totals that are pending.

    No copies may have to leave, and where totals are pending none behind the row may be due.
    """
    rows, pending, j, n = agents.rows, agents.pending, resource, agents.members.shape[0]
    row_waits = is_due(rows.first[j], time, limit)
    listed = is_due(rows.first_listed[j], time, limit)
    if listed:
        _take_due(rows, j, time, limit, pending.waiting[0] > 0)
    if row_waits:
        if agents.tick_weight > 0.0:
            # A row has indices of ticks then, and is due as a whole.
            time, limit = rows.tick[j], LAST
        _take_out(agents, j, time, limit)
    elif not listed and pending.waiting[0] == 0:
        return
    begin = 0
    for instant in range(pending.waiting[0]):
        pending.demand[instant] = pending.average[instant] = 0.0
    # Where totals are taken, agents go through all of it piece by piece; else copies need not be sorted.
    length = PIECE if pending.waiting[0] > 0 else n
    for piece in range(-(-n // length)):
        first = piece * length
        last = min(first + length, n)
        if pending.waiting[0] > 0:
            begin_piece(pending, agents.state, agents.parameters, j, first, last)
        end = rows.due_end[piece] if listed else 0
        waits, waiting = row_waits, end
        # Before the row and after it, by one call: compiled code holds a copy of what is called for each.
        while True:
            waiting = _answer_in_turn(agents, j, first, begin, waiting, waits)
            if not waits:
                break
            _answer_row(agents, j, first, last, time, limit)
            waits = False
        if pending.waiting[0] > 0:
            end_piece(pending, agents.state, j, first, last)
        begin = end
    if row_waits:
        end_row(agents, j)
