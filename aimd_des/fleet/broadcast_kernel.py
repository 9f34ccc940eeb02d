"""How a control unit in compiled code sends its signals, and the account of them."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.channel.transmit_kernel import ChannelTable, put_in_order, transmit
from aimd_des.fleet.arrays import FleetAgents
from aimd_des.fleet.enqueue_kernel import enqueue
from aimd_des.utils.jit import deferred, formula
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray

IntArray = npt.NDArray[np.int64]


@record
class FleetChannel(NamedTuple):
    """The way of a signal to all agents, and what is kept of it."""

    # Whether compiled code may send what leaves before a cut is possible; if not, it stops where a signal is
    # due.
    compiled: bool
    table: ChannelTable
    cut: npt.NDArray[np.bool_]  # (n,): agents to which nothing gets through at the moment
    numbers: IntArray  # (m,): how many signals there were for each resource
    # (m, n): copies by what becomes of them; duplicates that arrive are counted apart.
    delivered: IntArray
    lost: IntArray
    duplicated: IntArray
    # (n,): when the copies of a signal arrive: working memory.
    arrival: FloatArray
    second: FloatArray
    order: IntArray  # (1,): the next order number
    # (s,): signals since they were last noted.
    time: FloatArray
    resource: IntArray
    number: IntArray
    held: IntArray  # (1,): how many these are
    code: IntArray  # (1,): why the channel has refused a signal; 0 if it has not


@formula
def _cut(cut: npt.NDArray[np.bool_], arrival: FloatArray) -> None:
    """Let no copy get through to agents that are cut off."""
    for i in range(arrival.shape[0]):
        # Written in any case: a vector store of which no part is written takes ten times as long where its
        # page of memory has never been written to.
        time = arrival[i]
        arrival[i] = np.inf if cut[i] else time


@deferred
def broadcast(
    agents: FleetAgents,
    channel: FleetChannel,
    resource: int,
    time: float,
    delay: float,
    acted_at: float,
    acted: int,
) -> bool:
    """Send a capacity signal, for which there must be room; tell whether the channel takes it."""
    # `Transmitter.send` in compiled code, step by step in the same order: both give the same account, the
    # same draws and the same order of copies.
    number, row, n = channel.numbers[resource], channel.held[0], channel.arrival.shape[0]
    channel.numbers[resource] += 1
    channel.time[row], channel.resource[row], channel.number[row] = time, resource, number
    channel.held[0] = row + 1  # before it is refused, so that the refusal can name it
    channel.code[0] = transmit(channel.table, resource, number, time + delay, channel.arrival, channel.second)
    if channel.code[0] != 0:
        return False
    lost, delivered = channel.lost[resource], channel.delivered[resource]
    # Cut copies were drawn all the same: a channel's memory of losses must not depend on interventions.
    _cut(channel.cut, channel.arrival)
    for i in range(n):
        lost[i] += channel.arrival[i] == np.inf
    # After the cuts: a copy that does not get through holds nothing back on its link.
    if channel.table.fifo:
        put_in_order(channel.table.latest, channel.arrival)
    # Counted at the departure; where an agent is away when the copy lands, `miss` takes it back.
    for i in range(n):
        delivered[i] += channel.arrival[i] < agents.until
    # Order numbers for all agents, lost copies included: so the agent can be told from the number, and
    # whether one copy is lost does not move the turns of others.
    enqueue(agents, resource, number, 0, channel.arrival, channel.order[0], acted_at, acted)
    channel.order[0] += n
    if channel.table.duplicates:
        duplicated = channel.duplicated[resource]
        _cut(channel.cut, channel.second)
        # Behind the first copies on the same links, which have left before them.
        if channel.table.fifo:
            put_in_order(channel.table.latest, channel.second)
        for i in range(n):
            duplicated[i] += channel.second[i] < agents.until
        enqueue(agents, resource, number, 1, channel.second, channel.order[0], acted_at, acted)
        channel.order[0] += n
    return True
