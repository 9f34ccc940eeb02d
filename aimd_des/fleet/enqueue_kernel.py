"""How the copies of a broadcast are put into the queues of a fleet: as a row, or one by one in a heap."""

import numpy as np

from aimd_des.dynamics.clocks import next_tick, tick_time
from aimd_des.fleet.arrays import FleetAgents
from aimd_des.fleet.in_flight import DUPLICATE
from aimd_des.fleet.radix_heap import bits_of, put
from aimd_des.fleet.row_queue import common_landing, make_way, may_wait, open_row, put_behind
from aimd_des.utils.jit import deferred, routine
from aimd_des.utils.rng import uniforms_row
from aimd_des.utils.validation import FloatArray


@deferred
def _enqueue_one_by_one(
    agents: FleetAgents,
    resource: int,
    number: int,
    copy: int,
    arrival: FloatArray,
    first_rank: int,
    acted_at: float,
    acted: int,
) -> None:
    """Put each copy into a heap, at the time at which its agent answers it."""
    # A queue for each resource lets a crossing control unit settle the one it looks at.  Costs that couple
    # the resources forbid that: an answer reads the averages of all of them, so all are settled together.
    queue = resource if not agents.coupled else 0
    ticking, clocks, copies = agents.tick_weight > 0.0, agents.clocks, agents.copies
    uniform = agents.buffers.uniform
    # Drawn for all agents at once, though some copies are lost: a draw has an address, so none is used up.
    uniforms_row(agents.key, resource, number, copy, uniform)
    before, due, tick = np.inf, np.inf, 0.0
    for i in range(arrival.shape[0]):
        time = arrival[i]
        # Lost copies arrive at infinity, and so are among those that arrive after the end.
        if not (time < agents.until and agents.members[i]):
            continue
        if ticking:
            # The last event at `acted_at` was the tick of agent `acted`: agents up to it have had their turn
            # at that instant, and answer what arrives there now at their next tick.
            from_ = np.nextafter(time, np.inf) if time == acted_at and i <= acted else time
            # Where the clock is common, the tick is mostly that of the agent before.
            if not (clocks.common and before < from_ <= due):
                phase, period, jitter = clocks.phase[i], clocks.period[i], clocks.jitter[i]
                tick = next_tick(phase, period, jitter, clocks.key, i, from_)
                due = tick_time(phase, period, jitter, clocks.key, i, tick)
                before = (
                    tick_time(phase, period, jitter, clocks.key, i, tick - 1.0) if tick > 0.0 else -np.inf
                )
        else:
            due = time
        about = resource + copy * DUPLICATE
        # Agent i's copy has the i-th order number of its broadcast, and lost copies leave gaps: so order
        # number and agent tell the broadcast, and two copies of one agent are at least n apart.
        put(copies, queue, bits_of(due), tick, time, number, i, about, first_rank + i, uniform[i])
        copies.in_flight[0] += 1


@routine
def enqueue(
    agents: FleetAgents,
    resource: int,
    number: int,
    copy: int,
    arrival: FloatArray,
    first_rank: int,
    acted_at: float,
    acted: int,
) -> None:
    """Put the members' copies of one broadcast on their way; there must be room for n."""
    landing = common_landing(agents, resource, copy, arrival, acted_at)
    if may_wait(agents.rows, resource, landing, first_rank):
        put_behind(agents, resource, number, arrival, first_rank, landing)
    elif make_way(agents, resource, copy, landing):
        open_row(agents, resource, number, arrival, first_rank)
    else:
        _enqueue_one_by_one(agents, resource, number, copy, arrival, first_rank, acted_at, acted)
