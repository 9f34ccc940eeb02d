"""Copies on their way, sorted no further than is needed: a radix heap on the bits of time.

A reader of the agents asks for all copies that are due by then, in any order, and never goes back
in time.  So a copy is kept by the highest bit in which its time differs from the last reading: what differs
in a lower bit than the present reading does is due as a whole, and only one level has to be sorted out.  A
copy sinks through a few levels in its life, for any number of copies on their way.  (R. K. Ahuja, K.
Mehlhorn, J. B. Orlin and R. E. Tarjan, "Faster algorithms for the shortest path problem", Journal of the ACM
37, 1990.)  Times are at least 0, and then their bits, read as an integer, are in the order of the numbers.

What holds between any two calls, for each queue:

- `base` is the time up to which copies have been handed out, and never falls;
- every copy that is not handed out yet is due at `base` or later;
- a copy stands in chain 1 + b, b being the highest bit in which its time differs from `base`, and in chain 0
  if it is due at `base` itself; so a chain of a lower number holds earlier copies than a higher one;
- chain `DUE` holds what is handed out and not answered yet.

Each chain is in the order in which copies were put there: mostly that of the agents, so that memory is
read in passes.
"""

from typing import Any

import numpy as np

from aimd_des.fleet.in_flight import BLOCK, DUE, CopiesInFlight
from aimd_des.utils.jit import formula, instruction


@instruction
def _highest_bit(word: int) -> int:
    """Return the index of the highest bit that is set, -1 of 0."""
    return int(word).bit_length() - 1


@instruction
def bits_of(time: float) -> Any:
    """Return the bits of a time, as an integer that is in the order of times."""
    # Adding 0.0 makes +0.0 of -0.0, whose bits would be a negative number; all other times are at least 0.
    return np.float64(time + 0.0).view(np.int64)


@instruction
def time_of(key: int) -> Any:
    """Return the time that bits stand for."""
    return np.int64(key).view(np.float64)


@formula
def places(copies: CopiesInFlight, block: int) -> Any:
    """Return the places of the copies in a block."""
    # Without a sign: compiled code need not ask whether an index counts from the end.
    first = block * BLOCK
    return range(np.uint64(first), np.uint64(first + copies.filled[block]))


@formula
def _end(copies: CopiesInFlight, queue: int, chain: int) -> np.uint64:
    """Return the place behind the last copy of a chain."""
    block = copies.tail[queue, chain]
    if block < 0 or copies.filled[block] == BLOCK:
        # There is always a free block: callers have seen to it that there is room for the copies (`room`).
        fresh = copies.free[0]
        copies.free[0] = copies.following[fresh]
        copies.following[fresh] = -1
        copies.filled[fresh] = 0  # a block that was given back has kept its old count
        if block < 0:
            copies.head[queue, chain] = fresh
        else:
            copies.following[block] = fresh
        copies.tail[queue, chain] = fresh
        block = fresh
    place = copies.filled[block]
    copies.filled[block] = place + 1
    return np.uint64(block * BLOCK + place)


@formula
def release(copies: CopiesInFlight, block: int) -> Any:
    """Give a block back whose copies are elsewhere, or answered; return the next of its chain."""
    following = copies.following[block]
    copies.following[block] = copies.free[0]
    copies.free[0] = block
    return following


@formula
def put(
    copies: CopiesInFlight,
    queue: int,
    key: int,
    moment: float,
    arrival: float,
    number: int,
    agent: int,
    resource: int,
    rank: int,
    uniform: float,
) -> None:
    """Put a copy on its way, due no earlier than the last release of its queue; there must be room."""
    # Earlier than `base`, it would get into a chain of later copies and be handed out too late.  It cannot
    # be: a signal leaves at the look that has released the queue, or later, and latencies are at least 0.
    end = _end(copies, queue, _highest_bit(key ^ copies.base[queue]) + 1)
    copies.key[end] = key
    copies.agent[end] = agent
    copies.resource[end] = resource
    copies.rank[end] = rank
    copies.uniform[end] = uniform
    # Columns that this run does not need have no rows, and cost neither memory nor time.
    if copies.moment.shape[0] > 0:
        copies.moment[end] = moment
        copies.arrival[end] = arrival
    if copies.number.shape[0] > 0:
        copies.number[end] = number


@formula
def move(copies: CopiesInFlight, queue: int, chain: int, place: int) -> None:
    """Copy a copy to the end of a chain."""
    end = _end(copies, queue, chain)
    copies.key[end] = copies.key[place]
    copies.agent[end] = copies.agent[place]
    copies.resource[end] = copies.resource[place]
    copies.rank[end] = copies.rank[place]
    copies.uniform[end] = copies.uniform[place]
    if copies.moment.shape[0] > 0:
        copies.moment[end] = copies.moment[place]
        copies.arrival[end] = copies.arrival[place]
    if copies.number.shape[0] > 0:
        copies.number[end] = copies.number[place]


@formula
def _join(copies: CopiesInFlight, queue: int, chain: int) -> None:
    """Hang a whole chain behind that of the copies that are due."""
    # The last block of a chain need not be full, so `DUE` may have such blocks inside: code that passes
    # through a chain asks each block how many copies it has.
    first = copies.head[queue, chain]
    if first >= 0:
        if copies.head[queue, DUE] < 0:
            copies.head[queue, DUE] = first
        else:
            copies.following[copies.tail[queue, DUE]] = first
        copies.tail[queue, DUE] = copies.tail[queue, chain]
        copies.head[queue, chain] = copies.tail[queue, chain] = -1


@formula
def _hand_over(copies: CopiesInFlight, queue: int, block: int) -> Any:
    """Hang a block, all of whose copies are due, behind those that are; return the next of its chain."""
    following = copies.following[block]
    copies.following[block] = -1
    if copies.head[queue, DUE] < 0:
        copies.head[queue, DUE] = block
    else:
        copies.following[copies.tail[queue, DUE]] = block
    copies.tail[queue, DUE] = block
    return following


@formula
def _raise_ties(copies: CopiesInFlight, queue: int, limit: int) -> None:
    """Make those of the copies of this very time due that come before `limit`: by agent, or by order."""
    # At one instant ticks take place in the order of agents, and deliveries in that of their order numbers.
    ticking = copies.moment.shape[0] > 0
    # Emptied before it is walked through, since what is not due goes back into it.
    block = copies.head[queue, 0]
    copies.head[queue, 0] = copies.tail[queue, 0] = -1
    while block >= 0:
        for place in places(copies, block):
            order = copies.agent[place] if ticking else copies.rank[place]
            move(copies, queue, DUE if order < limit else 0, place)
        block = release(copies, block)


@formula
def is_empty(copies: CopiesInFlight, queue: int) -> bool:
    """Tell whether there is no copy in a queue."""
    last = -1
    for chain in range(copies.head.shape[1]):
        last = max(last, copies.head[queue, chain])
    return bool(last < 0)


@formula
def raise_due(copies: CopiesInFlight, queue: int, time: float, limit: int) -> None:
    """Put all copies of a queue that are due in its chain of those; it never goes back in time."""
    # What is due before this time is due.  What is due at this very time is due if its order number (of
    # discrete agents: the agent's index) is below `limit`.
    base, now = copies.base[queue], bits_of(time)
    # A second call for one instant, with a higher limit, finds `base` there already and looks at ties alone.
    if now > base:
        copies.base[queue] = now
        # `now` has a 1 at the highest bit in which it differs from `base`.  Copies of lower chains have the 0
        # of `base` there, and are due.  Copies of higher chains differ from both in the same bit, and stay.
        top = _highest_bit(now ^ base) + 1
        for level in range(top):
            _join(copies, queue, level)
        # Copies of this chain have the 1 as well.  Those that are later differ from `now` in a lower bit than
        # from `base`: a copy only ever gets into lower chains, at most 64 times in its life.
        block = copies.head[queue, top]
        copies.head[queue, top] = copies.tail[queue, top] = -1
        while block >= 0:
            latest = 0
            for place in places(copies, block):
                latest = max(latest, copies.key[place])
            # A block that is due as a whole changes hands without any of its copies being moved.
            if latest < now:
                block = _hand_over(copies, queue, block)
                continue
            for place in places(copies, block):
                key = copies.key[place]
                chain = DUE if key < now else _highest_bit(key ^ now) + 1
                move(copies, queue, chain, place)
            block = release(copies, block)
    # Order numbers and indices begin at 0, so a limit of 0 lets nothing of this very time through.
    if limit > 0 and copies.head[queue, 0] >= 0:
        _raise_ties(copies, queue, limit)
