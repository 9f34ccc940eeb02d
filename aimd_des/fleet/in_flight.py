"""The memory of copies on their way: chains of blocks from one pool, which grows with what is in flight."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray

IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.uint32]

#: Copies in a block: few, since each chain may waste most of one; enough to compute answers side by side.
BLOCK = 64

#: Agents that answer a row together, at least as many as a block has copies: few enough that what is computed
#: for them stays in the cache.
PIECE = max(256, BLOCK)

# Level 0 is the time of the last look itself; the highest bit of a positive number is bit 62.
_LEVELS = 64

#: Two more chains for each queue: copies that are due, and those of them that wait for another one of
#: the same agent.  `LATER` is empty but while a queue is settled.
DUE, LATER = _LEVELS, _LEVELS + 1
_CHAINS = _LEVELS + 2

#: The highest bit of a resource's index, set in that of a duplicate: it saves a column.
DUPLICATE = 1 << 31

#: The draw of a copy that is never answered: no draw is that high, all are below 1.
FORGOTTEN = 2.0


@record
class CopiesInFlight(NamedTuple):
    """All copies on their way, in one queue or in one for each resource.

    Block number b has the places from b * BLOCK on.
    """

    # (b * BLOCK,): when each is due: the bits of its time of arrival or, for a discrete agent, of the tick
    # after it.
    key: IntArray
    # (b * BLOCK,): of discrete agents only: index of that tick, and time of arrival.
    moment: FloatArray
    arrival: FloatArray
    number: IntArray  # (b * BLOCK,): number of the broadcast, where agents read it
    # (b * BLOCK,): i and j (with the bit `DUPLICATE` for a duplicate); without a sign, so that compiled code
    # need not ask whether they count from the end.
    agent: IndexArray
    resource: IndexArray
    rank: IntArray  # (b * BLOCK,): order number; decides between copies that arrive at the same time
    uniform: FloatArray  # (b * BLOCK,): the draw that decides how the agent responds
    # (b,): the next block of a chain (-1: none), and how many copies are in a block.
    following: IntArray
    filled: IntArray
    # (q, 66): first and last block of each chain (-1: empty).
    head: IntArray
    tail: IntArray
    base: IntArray  # (q,): bits of the time up to which a queue has been released
    free: IntArray  # (1,): first block of the chain of those that are not in use
    in_flight: IntArray  # (1,): how many copies there are


def _blocks_for(space: int, queues: int) -> int:
    # Each chain may end in a block that is not full, and again when the first is among those that are due.
    # Two more, since a block whose copies are moved elsewhere is given back after that, not before.
    return -(-space // BLOCK) + 2 * _CHAINS * queues + 2


def room(copies: CopiesInFlight) -> int:
    """Tell for how many copies there is space, those in flight included."""
    # Compiled code cannot enlarge anything.  What puts copies in flight compares `in_flight` with this
    # first, and leaves compiled code (`NO_ROOM`) where there might be too little.
    return (len(copies.following) - _blocks_for(0, len(copies.base))) * BLOCK


def empty_copies(space: int, queues: int, ticking: bool, numbered: bool) -> CopiesInFlight:
    """Make space for copies, of which there are none yet."""
    # Not zeroed where a row is written before it is read: pages that are never used are never allocated.
    blocks = _blocks_for(space, queues)
    shape = blocks * BLOCK
    own = shape if ticking else 0
    return CopiesInFlight(
        key=np.empty(shape, dtype=np.int64),
        moment=np.empty(own),
        arrival=np.empty(own),
        number=np.empty(shape if numbered else 0, dtype=np.int64),
        agent=np.empty(shape, dtype=np.uint32),
        resource=np.empty(shape, dtype=np.uint32),
        rank=np.empty(shape, dtype=np.int64),
        uniform=np.empty(shape),
        # All blocks are free, each followed by the next.
        following=np.append(np.arange(1, blocks), -1),
        filled=np.zeros(blocks, dtype=np.int64),
        head=np.full((queues, _CHAINS), -1),
        tail=np.full((queues, _CHAINS), -1),
        base=np.zeros(queues, dtype=np.int64),  # the bits of time 0, at which a run begins
        free=np.zeros(1, dtype=np.int64),
        in_flight=np.zeros(1, dtype=np.int64),
    )


def enlarge(copies: CopiesInFlight, space: int) -> CopiesInFlight:
    """Make space for more copies."""
    # Blocks keep their numbers, so chains hold as they are and only the list of free ones is joined.
    old = len(copies.following)
    ticking, numbered = copies.moment.size > 0, copies.number.size > 0
    larger = empty_copies(space, len(copies.base), ticking, numbered)
    for name in ("key", "moment", "arrival", "number", "agent", "resource", "rank", "uniform", "filled"):
        rows = getattr(copies, name)
        getattr(larger, name)[: len(rows)] = rows
    larger.following[:old] = copies.following
    # The new blocks stand before what is left of the old ones.
    larger.following[-1] = copies.free[0]
    larger.free[0] = old
    for name in ("head", "tail", "base", "in_flight"):
        getattr(larger, name)[...] = getattr(copies, name)
    return larger


# What there is of each copy, and what tells where copies are.
_OF_COPIES = ("key", "moment", "arrival", "number", "agent", "resource", "rank", "uniform")
_OF_BLOCKS = ("following", "filled", "head", "tail", "base", "free", "in_flight")


def copies_state(copies: CopiesInFlight) -> dict[str, Any]:
    """Return all copies, as far as blocks are in use; nothing is copied."""
    following, last = copies.following.tolist(), -1
    for head in copies.head[copies.head >= 0].tolist():
        block = head
        while block >= 0:
            last, block = max(last, block), following[block]
    used = (last + 1) * BLOCK
    return {
        "copies": {name: getattr(copies, name)[:used] for name in _OF_COPIES},
        "blocks": {name: getattr(copies, name) for name in _OF_BLOCKS},
    }


def resumed_copies(
    copies: CopiesInFlight, state: Mapping[str, Any], ticking: bool, numbered: bool
) -> CopiesInFlight:
    """Put copies where `copies_state` has found them, in space that is made if there was more of it."""
    blocks, queues = state["blocks"], len(state["blocks"]["base"])
    if len(blocks["following"]) != len(copies.following):
        space = (len(blocks["following"]) - _blocks_for(0, queues)) * BLOCK
        copies = empty_copies(space, queues, ticking, numbered)
    for name, kept in (*blocks.items(), *state["copies"].items()):
        getattr(copies, name)[: len(kept)] = kept
    return copies
