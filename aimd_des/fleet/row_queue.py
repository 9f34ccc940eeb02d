"""Where the copies of a broadcast wait: in the row, behind it, in the list or in the heap.

A broadcast whose copies all land at one instant, no earlier than those before it, waits behind the row as no
more than that instant and a row of draws.  Its turn comes when the row is free, so that each agent answers
its copies in their order.  All other broadcasts become the row, whose later copies are listed.
"""

from typing import Any

import numpy as np

from aimd_des.dynamics.clocks import next_tick, tick_time
from aimd_des.fleet.arrays import FleetAgents
from aimd_des.fleet.broadcast_rows import BroadcastRows
from aimd_des.fleet.in_flight import FORGOTTEN
from aimd_des.fleet.radix_heap import bits_of, is_empty, put, time_of
from aimd_des.utils.jit import deferred, formula, shared
from aimd_des.utils.rng import uniforms_row
from aimd_des.utils.validation import FloatArray


@formula
def list_row(rows: BroadcastRows, resource: int, first: int, last: int, after: float) -> None:
    """List those of some agents' copies in the row that arrive after a time."""
    j, arrival, uniform = resource, rows.arrival[resource], rows.uniform[resource]
    begin: Any = np.uint64(rows.listed[j])
    agents, end = rows.listed_agent[j], begin
    # First only their numbers, without a branch: written in any case, and counted if the copy waits.
    for i in range(first, last):
        time = arrival[i]
        agents[end] = i
        end += np.uint64((time > after) & (time < np.inf))
    listed_arrival, listed_uniform, listed_rank = (
        rows.listed_arrival[j],
        rows.listed_uniform[j],
        rows.listed_rank[j],
    )
    soonest, rank = bits_of(rows.first_listed[j]), rows.rank[j]
    for place in range(begin, end):
        agent = np.uint64(agents[place])
        soonest = min(soonest, bits_of(arrival[agent]))
        listed_arrival[place], listed_uniform[place] = arrival[agent], uniform[agent]
        listed_rank[place] = rank + np.int64(agent)
    rows.listed[j], rows.first_listed[j] = end, time_of(soonest)


@formula
def _fits(rows: BroadcastRows, resource: int) -> bool:
    """Tell whether a whole row can be listed."""
    return bool(rows.listed[resource] + rows.arrival.shape[1] < rows.listed_agent.shape[1])


@formula
def is_due(time_due: float, time: float, limit: int) -> bool:
    """Tell whether anything of what is due at a time may be due by now: order numbers begin at 0."""
    return bool(time_due < time or (time_due == time and limit > 0))


@formula
def must_leave(agents: FleetAgents, resource: int, time: float, limit: int) -> bool:
    """Tell whether the copies about a resource have to go to its heap before those due are answered."""
    j, rows = resource, agents.rows
    if not is_due(rows.first[j], time, limit):
        return False
    if agents.tick_weight > 0.0:
        # In the middle of a tick, where only the first agents have had their turn.
        return bool(rows.first[j] == time and limit < rows.arrival.shape[1])
    return not _fits(rows, j)


@formula
def is_alone(rows: BroadcastRows, resource: int, time: float, limit: int) -> bool:
    """Tell whether of what waits behind the row nothing is due."""
    oldest = rows.oldest[resource]
    return bool(rows.behind[resource] == 0 or not is_due(rows.landing_behind[resource, oldest], time, limit))


@formula
def is_full(rows: BroadcastRows, resource: int, time: float, limit: int) -> bool:
    """Tell whether there may be no place behind the row once what is due has been answered."""
    j = resource
    full = rows.behind[j] == rows.rank_behind.shape[1] and rows.landing[j] < np.inf
    return bool(full and rows.first[j] < np.inf and not is_due(rows.first[j], time, limit))


@deferred
def _wait_for_tick(agents: FleetAgents, resource: int) -> None:
    """Let discrete agents answer the row, which has just got its copies, at the tick after these land."""
    j, rows, clocks, row = resource, agents.rows, agents.clocks, agents.rows.arrival[resource]
    clock = (clocks.phase[0], clocks.period[0], clocks.jitter[0], clocks.key, 0)
    tick = next_tick(*clock, rows.landing[j])
    rows.tick[j], rows.first[j] = tick, tick_time(*clock, tick)
    for i in range(row.shape[0]):
        time = row[i]
        row[i] = tick if time < np.inf else np.inf


@deferred
def _move_up(agents: FleetAgents, resource: int) -> None:
    """Let the broadcast behind the row be the row."""
    rows = agents.rows
    j, place = resource, rows.oldest[resource]
    landing, uniform = rows.landing_behind[j, place], rows.uniform_behind[j, place]
    row, draws = rows.arrival[j], rows.uniform[j]
    for i in range(row.shape[0]):
        draws[i] = uniform[i]
        row[i] = landing if uniform[i] < FORGOTTEN else np.inf
    rows.first[j] = rows.landing[j] = landing
    rows.rank[j] = rows.rank_behind[j, place]
    rows.oldest[j] = (place + 1) % rows.rank_behind.shape[1]
    rows.behind[j] -= 1
    agents.copies.in_flight[0] -= row.shape[0]
    if agents.tick_weight > 0.0:
        _wait_for_tick(agents, j)


@formula
def end_row(agents: FleetAgents, resource: int) -> None:
    """Free the row, all of whose copies are answered or listed, for what waits behind it."""
    agents.rows.first[resource] = np.inf
    if agents.rows.behind[resource] > 0:
        _move_up(agents, resource)


@shared
def spill(agents: FleetAgents, resource: int) -> None:
    """Put all copies about a resource into its heap; there is always room for them."""
    j, copies, rows, ticking = resource, agents.copies, agents.rows, agents.tick_weight > 0.0
    for place in range(rows.listed[j]):
        key, agent = bits_of(rows.listed_arrival[j, place]), rows.listed_agent[j, place]
        rank, uniform = rows.listed_rank[j, place], rows.listed_uniform[j, place]
        put(copies, j, key, 0.0, 0.0, 0, agent, j, rank, uniform)
    copies.in_flight[0] += rows.listed[j]
    while rows.first[j] < np.inf:
        for i in range(rows.arrival.shape[1]):
            if rows.arrival[j, i] < np.inf:
                key = bits_of(rows.first[j] if ticking else rows.arrival[j, i])
                # Discrete agents alone have what is answered at a tick.
                tick, landing, rank = rows.arrival[j, i], rows.landing[j], rows.rank[j] + i
                put(copies, j, key, tick, landing, 0, i, j, rank, rows.uniform[j, i])
                copies.in_flight[0] += 1
        end_row(agents, j)
    rows.listed[j], rows.serving[j] = 0, False
    rows.first_listed[j] = np.inf


@formula
def _span(agents: FleetAgents, arrival: FloatArray) -> Any:
    """Return the bits of the first and of the last time at which a copy lands; without one, inf and 0."""
    # The least of whole numbers is found several at a time; that of floating-point numbers is not.
    first, last = bits_of(np.inf), bits_of(0.0)
    for i in range(arrival.shape[0]):
        time = arrival[i]
        lands = (time < agents.until) & agents.members[i]
        first = min(first, bits_of(time if lands else np.inf))
        last = max(last, bits_of(time if lands else 0.0))
    return first, last


@formula
def common_landing(
    agents: FleetAgents, resource: int, copy: int, arrival: FloatArray, acted_at: float
) -> float:
    """Tell at which instant all copies of a broadcast land; not a number if that is not so, or not asked."""
    j, rows, ticking = resource, agents.rows, agents.tick_weight > 0.0
    behind = rows.serving[j] and rows.first[j] < np.inf and rows.landing[j] < np.inf
    if not (rows.enabled and copy == 0 and (ticking or behind)):
        return np.nan
    first, last = _span(agents, arrival)
    landing = time_of(first)
    # Some agents may have had their turn at this instant, and answer at their next tick.
    return np.nan if first < last or (ticking and landing == acted_at) else landing


@formula
def may_wait(rows: BroadcastRows, resource: int, landing: float, rank: int) -> bool:
    """Tell whether a broadcast that lands at an instant may wait behind the row."""
    j = resource
    if not (rows.serving[j] and rows.first[j] < np.inf):
        return False
    before, ranks = rows.landing[j], rows.rank[j]
    if rows.behind[j] > 0:
        place = (rows.oldest[j] + rows.behind[j] - 1) % rows.rank_behind.shape[1]
        before, ranks = rows.landing_behind[j, place], rows.rank_behind[j, place]
    # What lands at the same instant is answered by order number: a late signal may have a lower one.
    return bool(landing > before or (landing == before and rank > ranks))


@deferred
def put_behind(
    agents: FleetAgents, resource: int, number: int, arrival: FloatArray, first_rank: int, landing: float
) -> None:
    """Let a broadcast wait behind the row; there must be a place for it."""
    j, rows = resource, agents.rows
    if landing == np.inf:
        return
    place = (rows.oldest[j] + rows.behind[j]) % rows.rank_behind.shape[1]
    uniform = rows.uniform_behind[j, place]
    uniforms_row(agents.key, j, number, 0, uniform)
    for i in range(arrival.shape[0]):
        # What does not arrive, or is for another agent, is as if it had been forgotten.
        lands, draw = (arrival[i] < agents.until) & agents.members[i], uniform[i]
        uniform[i] = draw if lands else FORGOTTEN
    rows.landing_behind[j, place], rows.rank_behind[j, place] = landing, first_rank
    rows.behind[j] += 1
    # All of them, lost ones included: in a heap there is room for what is counted here.
    agents.copies.in_flight[0] += arrival.shape[0]


@formula
def make_way(agents: FleetAgents, resource: int, copy: int, landing: float) -> bool:
    """Tell whether the copies of a broadcast may become a row, and see to it that its place is free."""
    rows = agents.rows
    if not rows.enabled:
        return False
    suits = copy == 0 and (agents.tick_weight == 0.0 or not np.isnan(landing))
    occupied = rows.first[resource] < np.inf
    # All copies about a resource are in one place, since an agent's have to be compared with each other.
    if not rows.serving[resource]:
        rows.serving[resource] = suits and is_empty(agents.copies, resource)
    elif not suits or (occupied and (rows.behind[resource] > 0 or not _fits(rows, resource))):
        spill(agents, resource)
    elif occupied:
        # There was no look since the last broadcast, or nothing of it was due.
        list_row(rows, resource, 0, rows.arrival.shape[1], -np.inf)
    return bool(rows.serving[resource])


@formula
def open_row(agents: FleetAgents, resource: int, number: int, arrival: FloatArray, first_rank: int) -> None:
    """Let the copies of a broadcast be a row."""
    rows, row = agents.rows, agents.rows.arrival[resource]
    uniforms_row(agents.key, resource, number, 0, rows.uniform[resource])
    first, last = bits_of(np.inf), bits_of(0.0)
    for i in range(row.shape[0]):
        time = arrival[i]
        lands = (time < agents.until) & agents.members[i]
        # What does not arrive, or is for another agent, is as if it were lost.
        row[i] = time if lands else np.inf
        # The least of whole numbers is found several at a time; that of floating-point numbers is not.
        first = min(first, bits_of(time if lands else np.inf))
        last = max(last, bits_of(time if lands else 0.0))
    rows.first[resource] = time_of(first)
    rows.landing[resource] = time_of(first) if first == last else np.inf
    rows.rank[resource] = first_rank
    if agents.tick_weight > 0.0 and rows.first[resource] < np.inf:
        _wait_for_tick(agents, resource)
