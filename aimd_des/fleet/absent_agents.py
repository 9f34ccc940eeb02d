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
def miss(agents: FleetAgents, resource: int, agent: int, second: bool) -> None:
    """Take note that a copy has landed at an agent that is away: it is lost after all."""
    # It was counted as delivered when it was sent, as all are that arrive before the end.  A duplicate that
    # is missed is no loss: the account has one copy of each signal for each agent.
    if second:
        agents.account.duplicated[resource, agent] -= 1
    else:
        agents.account.delivered[resource, agent] -= 1
        agents.account.lost[resource, agent] += 1


@routine
def forget(agents: FleetAgents, agent: int, time: float, limit: int, lost: bool) -> None:
    """Drop the copies of a discrete agent that have arrived and wait for its next tick."""
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
                    arrival = copies.arrival[place]
                    if arrival < time or (arrival == time and copies.rank[place] < limit):
                        # Marked, not taken out: a block has no gaps.  The copy leaves when it is due.
                        copies.uniform[place] = FORGOTTEN
                        if lost:
                            resource, second = subject(copies, place)
                            miss(agents, resource, agent, second)
                block = copies.following[block]
