"""Totals at several instants, taken in the pass in which agents answer what has arrived up to the last.

To keep totals changes nothing, so they wait until the control unit next reads the resource.  Then all agents
are read from memory once, instead of once for each instant.  Each instant has a row of values of the agents
in a piece, which are computed from their lines as they were before and, where an agent responds, anew.  Sums
are in the order of agents, one addition after the other, as `dynamics.totals` has them: the same bits.
"""

from typing import NamedTuple

import numpy as np

from aimd_des.dynamics.averaging import accumulated_at, age_at, time_average
from aimd_des.dynamics.demand import CONTINUOUS, demand_at
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.utils.jit import formula
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray, IntArray

#: Instants of one pass.  Their values stay in the cache for so few.
INSTANTS = 8

# Instants whose sums are added up side by side: as many additions as a processor begins before one is done.
_SIDE_BY_SIDE = 4


@record
class PendingTotals(NamedTuple):
    """Totals of one resource that wait for a pass over the agents."""

    waiting: IntArray  # (1,): of how many instants
    times: FloatArray  # (INSTANTS,): when; ascending
    # (INSTANTS,): receive the sums of demand and of averages.
    demand: FloatArray
    average: FloatArray
    # (INSTANTS, p): values of the agents in a piece, of averages first what has been accumulated.
    held: FloatArray
    used: FloatArray


def pending_totals(length: int) -> PendingTotals:
    """Make the working memory for pieces of so many agents; nothing waits."""
    count, (times, demand, average) = np.zeros(1, dtype=np.int64), np.zeros((3, INSTANTS))
    return PendingTotals(count, times, demand, average, *np.zeros((2, INSTANTS, length)))


@formula
def begin_piece(
    pending: PendingTotals,
    state: State,
    parameters: AgentParameters,
    resource: int,
    first: int,
    last: int,
) -> None:
    """Compute the values of some agents from their lines as they are now."""
    j, count = resource, last - first
    demand, accumulated = state.demand[j][first:last], state.accumulated[j][first:last]
    anchor, pause = state.anchor[j][first:last], state.pause[j][first:last]
    increase = parameters.increase[j][first:last]
    for instant in range(pending.waiting[0]):
        now, held, used = pending.times[instant], pending.held[instant], pending.used[instant]
        for k in range(count):
            held[k] = demand_at(demand[k], increase[k], now - anchor[k], CONTINUOUS)
        for k in range(count):
            since = min(now, pause[k]) - anchor[k]
            used[k] = accumulated_at(accumulated[k], demand[k], increase[k], since, CONTINUOUS)


@formula
def break_line(
    pending: PendingTotals, state: State, parameters: AgentParameters, resource: int, agent: int, first: int
) -> None:
    """Compute the values of an agent anew from the instant on at which it has responded."""
    j, i, k, instant = resource, agent, agent - first, pending.waiting[0] - 1
    demand, accumulated, anchor = state.demand[j, i], state.accumulated[j, i], state.anchor[j, i]
    increase = parameters.increase[j, i]
    while instant >= 0 and pending.times[instant] >= anchor:
        since = pending.times[instant] - anchor
        pending.held[instant, k] = demand_at(demand, increase, since, CONTINUOUS)
        pending.used[instant, k] = accumulated_at(accumulated, demand, increase, since, CONTINUOUS)
        instant -= 1


@formula
def break_lines(
    pending: PendingTotals,
    state: State,
    parameters: AgentParameters,
    resource: int,
    first: int,
    last: int,
    offset: int,
    responds: IntArray,
) -> None:
    """Compute the values of those of some agents anew that have responded, from that instant on."""
    j, count = resource, last - first
    demand, accumulated = state.demand[j][first:last], state.accumulated[j][first:last]
    anchor, increase = state.anchor[j][first:last], parameters.increase[j][first:last]
    for instant in range(pending.waiting[0]):
        now = pending.times[instant]
        held, used = pending.held[instant][offset:], pending.used[instant][offset:]
        for k in range(count):
            new, before = demand_at(demand[k], increase[k], now - anchor[k], CONTINUOUS), held[k]
            held[k] = new if (responds[k] != 0) & (anchor[k] <= now) else before
        for k in range(count):
            since, before = now - anchor[k], used[k]
            new = accumulated_at(accumulated[k], demand[k], increase[k], since, CONTINUOUS)
            used[k] = new if (responds[k] != 0) & (anchor[k] <= now) else before


@formula
def end_piece(pending: PendingTotals, state: State, resource: int, first: int, last: int) -> None:
    """Add the values of some agents to the sums of those before them."""
    j, count = resource, last - first
    origin, pause = state.origin[j][first:last], state.pause[j][first:last]
    for instant in range(pending.waiting[0]):
        now, used = pending.times[instant], pending.used[instant]
        for k in range(count):
            used[k] = time_average(used[k], age_at(min(now, pause[k]), origin[k], CONTINUOUS))
    demand, average = pending.demand, pending.average
    for a in range(0, pending.waiting[0], _SIDE_BY_SIDE):
        # Of fewer instants, sums of what is left of earlier ones are computed as well: it takes no longer.
        b, c, d = a + 1, a + 2, a + 3
        held0, held1, held2, held3 = demand[a], demand[b], demand[c], demand[d]
        used0, used1, used2, used3 = average[a], average[b], average[c], average[d]
        for k in range(count):
            held0 += pending.held[a, k]
            used0 += pending.used[a, k]
            held1 += pending.held[b, k]
            used1 += pending.used[b, k]
            held2 += pending.held[c, k]
            used2 += pending.used[c, k]
            held3 += pending.held[d, k]
            used3 += pending.used[d, k]
        demand[a], demand[b], demand[c], demand[d] = held0, held1, held2, held3
        average[a], average[b], average[c], average[d] = used0, used1, used2, used3
