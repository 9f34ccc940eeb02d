"""How copies spread over a network of arcs, in compiled code.

An arc is one direction of an edge.  A node forwards the first copy that reaches it over all its
arcs, so that a broadcast reaches node v at

    t(root) = departure,    t(v) = min of t(u) + latency(u, v) over arcs that lose nothing.

which is the least sum, added from the root on, over all paths that survive.  Rounded sums of numbers
that are not negative are monotone, so it is the same to the last bit in any order of the arcs.  Nodes are
taken in the order of their nominal distance, again and again until nothing changes; a tree needs one round,
and v nodes v rounds at most.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.utils.jit import shared
from aimd_des.utils.records import record
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray


@record
class NetworkTable(NamedTuple):
    """A network for compiled code, with working memory; all arrays are empty where there is none."""

    # (v + 1,): where the arcs out of each node begin in `arc` and `head`, and where the last ones end; node 0
    # is the control unit's, and nodes stand in the order of their nominal distance from it.
    first: IntArray
    # (a,): number of an arc, which is the address of its draws, and the node to which it leads.
    arc: IntArray
    head: IntArray
    agent: IntArray  # (n,): the node of each agent
    latency: FloatArray  # (a,): receives the latencies of a broadcast, by number of the arc
    # Working memory, (v,): the time of each node, and whether the next nodes have not seen it yet.
    time: FloatArray
    fresh: BoolArray


def network_table(
    tail: npt.ArrayLike = (), head: npt.ArrayLike = (), agent: npt.ArrayLike = ()
) -> NetworkTable:
    """Lay out a network for compiled code; without arguments, none."""
    # Sorted by the node that they leave: a node finds its own side by side.
    tails, heads = np.array(tail, dtype=np.int64), np.array(head, dtype=np.int64)
    n_nodes = int(heads.max()) + 1 if len(heads) else 0
    arc = np.argsort(tails, kind="stable")
    return NetworkTable(
        first=np.searchsorted(tails[arc], np.arange(n_nodes + 1)).astype(np.int64),
        arc=arc.astype(np.int64),
        head=heads[arc],
        agent=np.array(agent, dtype=np.int64),
        latency=np.zeros(len(arc)),
        time=np.zeros(n_nodes),
        fresh=np.zeros(n_nodes, dtype=np.bool_),
    )


@shared
def spread(network: NetworkTable, lost: BoolArray, departure: float, arrival: FloatArray) -> None:
    """Let a broadcast run over the arcs."""
    # Infinity is where the broadcast has not come yet, and stays where it never does: so a lost copy is one
    # that arrives at infinity, here as elsewhere.
    time, fresh = network.time, network.fresh
    time[:] = np.inf
    fresh[:] = False
    time[0], fresh[0] = departure, True
    # It ends: latencies are at least 0, so no way round a circle is earlier, and only what is earlier counts.
    again = True
    while again:
        again = False
        for node in range(time.shape[0]):
            if not fresh[node]:
                continue
            fresh[node] = False
            for place in range(network.first[node], network.first[node + 1]):
                # By the number of the arc, at which its draws stand however arcs are sorted here.
                arc, head = network.arc[place], network.head[place]
                reached = time[node] + network.latency[arc]
                if reached < time[head] and not lost[arc]:
                    time[head], fresh[head] = reached, True
                    # Nodes that stand later will be seen in this round.
                    again |= head < node
    for i in range(arrival.shape[0]):
        arrival[i] = time[network.agent[i]]
