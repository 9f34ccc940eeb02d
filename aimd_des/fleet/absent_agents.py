"""What becomes of copies for agents that are away."""

from typing import Any

import numpy as np

from aimd_des.fleet.arrays import Crowd
from aimd_des.fleet.in_flight import FORGOTTEN, SECOND, Flights
from aimd_des.fleet.radix_heap import places
from aimd_des.utils.jit import formula, routine

__all__ = ["forget", "miss", "subject"]


@formula
def subject(flights: Flights, place: int) -> Any:
    """Tell what a copy is about."""
    resource = np.int64(flights.resource[place])
    second = resource >= SECOND
    return resource - (SECOND if second else 0), second


@formula
def miss(crowd: Crowd, resource: int, agent: int, second: bool) -> None:
    """Take note that a copy has landed where nobody is: it is lost after all."""
    if second:
        crowd.books.duplicated[resource, agent] -= 1
    else:
        crowd.books.delivered[resource, agent] -= 1
        crowd.books.lost[resource, agent] += 1


@routine
def forget(crowd: Crowd, agent: int, time: float, limit: int, lost: bool) -> None:
    """Drop the copies of a discrete agent that have arrived and wait for its next tick."""
    flights = crowd.flights
    for queue in range(flights.head.shape[0]):
        for chain in range(flights.head.shape[1]):
            block = flights.head[queue, chain]
            while block >= 0:
                for place in places(flights, block):
                    if flights.agent[place] != agent or flights.uniform[place] > 1.0:
                        continue
                    arrival = flights.arrival[place]
                    if arrival < time or (arrival == time and flights.rank[place] < limit):
                        flights.uniform[place] = FORGOTTEN
                        if lost:
                            resource, second = subject(flights, place)
                            miss(crowd, resource, agent, second)
                block = flights.following[block]
