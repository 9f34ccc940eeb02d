"""What becomes of copies for agents that are away."""

from typing import Any

import numpy as np

from aimd_des.fleet.arrays import FleetAgents
from aimd_des.fleet.in_flight import DUPLICATE, FORGOTTEN, CopiesInFlight
from aimd_des.fleet.radix_heap import places
from aimd_des.utils.jit import formula, routine


@formula
def subject(copies: CopiesInFlight, place: int) -> Any:
    """Tell which resource a copy is about, and whether it is a duplicate."""
    resource = np.int64(copies.resource[place])
    second = resource >= DUPLICATE
    return resource - (DUPLICATE if second else 0), second


@formula
def comes_before(arrival: float, rank: int, time: float, limit: int) -> Any:
    """Tell whether a copy comes before a time or, at this very time, before an order number."""
    # Without a branch: whether a copy is due is as good as random.
    return (arrival < time) | ((arrival == time) & (rank < limit))


@formula
def miss(agents: FleetAgents, resource: int, agent: int, second: bool) -> None:
    """Take note that a copy has landed at an agent that is away: it is lost after all."""
    # It was counted as delivered when it was sent, as all are that arrive before the end.  A duplicate that
    # is missed is no loss: the account has one copy of each signal for each agent.
    if second:
        agents.account.duplicated[resource, agent] -= 1
    else:
        agents.account.delivered[resource, agent] -= 1
        agents.account.lost[resource, agent] += 1


@formula
def _forget_in_rows(agents: FleetAgents, agent: int, time: float, limit: int, lost: bool) -> None:
    """Drop those of them that are in rows, or behind them."""
    rows, i = agents.rows, agent
    for j in range(rows.first.shape[0]):
        waits = rows.first[j] < np.inf and rows.arrival[j, i] < np.inf
        if waits and comes_before(rows.landing[j], rows.rank[j] + i, time, limit):
            rows.arrival[j, i] = np.inf
            if lost:
                miss(agents, j, i, False)
        for turn in range(rows.behind[j]):
            place = (rows.oldest[j] + turn) % rows.rank_behind.shape[1]
            landing, rank = rows.landing_behind[j, place], rows.rank_behind[j, place] + i
            if rows.uniform_behind[j, place, i] < FORGOTTEN and comes_before(landing, rank, time, limit):
                rows.uniform_behind[j, place, i] = FORGOTTEN
                if lost:
                    miss(agents, j, i, False)


@routine
def forget(agents: FleetAgents, agent: int, time: float, limit: int, lost: bool) -> None:
    """Drop the copies of a discrete agent that have arrived and wait for its next tick."""
    _forget_in_rows(agents, agent, time, limit, lost)
    # What has arrived before `time` has arrived, and at this very time what has an order number below
    # `limit`.  It may stand in any chain, since chains are sorted by the tick and not by the arrival.
    copies = agents.copies
    for queue in range(copies.head.shape[0]):
        for chain in range(copies.head.shape[1]):
            block = copies.head[queue, chain]
            while block >= 0:
                for place in places(copies, block):
                    # What was forgotten before has been accounted for, and must not be twice.
                    if copies.agent[place] != agent or copies.uniform[place] == FORGOTTEN:
                        continue
                    if comes_before(copies.arrival[place], copies.rank[place], time, limit):
                        # Marked, not taken out: a block has no gaps.  The copy leaves when it is due.
                        copies.uniform[place] = FORGOTTEN
                        if lost:
                            resource, second = subject(copies, place)
                            miss(agents, resource, agent, second)
                block = copies.following[block]
