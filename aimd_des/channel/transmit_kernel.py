"""What becomes of a broadcast, in compiled code: the one way for processes and for compiled agents."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.channel.latency.kernels import LatencyTable, is_improper, latency_row
from aimd_des.channel.loss.kernels import LossTable, forgotten_loss, loss_row, refuse_loss
from aimd_des.channel.network_kernel import NetworkTable, network_table, spread
from aimd_des.channel.random_draws import LANES_PER_COPY
from aimd_des.utils.errors import InputError
from aimd_des.utils.jit import deferred, kernel, shared
from aimd_des.utils.locked_arrays import each
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key, Purpose, uniforms_row
from aimd_des.utils.validation import BoolArray, FloatArray

# Why a broadcast is refused, besides what its losses say.
_IMPROPER = 4

# Shared by all channels without one: its arrays are empty.
_NO_NETWORK = network_table()


@record
class ChannelTable(NamedTuple):
    """A channel in one run, for compiled code, with its memory.

    Its a links are those of the n agents or, where there is a network, the arcs of that.
    """

    latency: LatencyTable  # the model of latency, for each link
    loss: LossTable  # the model of loss, for each link
    duplication: FloatArray  # (n,): probability that a copy which is not lost arrives twice
    duplicates: bool  # whether any can
    fifo: bool  # whether each agent's link keeps the order of what is sent over it
    latest: FloatArray  # (n,): the last arrival on each link, kept where links are FIFO
    # The run's keys.
    latency_key: Key
    loss_key: Key
    duplication_key: Key
    # Working memory, (a,).
    lost: BoolArray
    spare: FloatArray
    network: NetworkTable  # over which copies travel; empty where each agent has a link of its own


def channel_table(
    latency: LatencyTable,
    loss: LossTable,
    duplication: npt.ArrayLike,
    fifo: bool,
    keys: Mapping[Purpose, Key],
    network: NetworkTable | None = None,
) -> ChannelTable:
    """Lay out a channel for compiled code, at the start of a run."""
    # Models are drawn for each link; what comes after the draws, duplication and order, is for each agent.
    # Over a network there is neither: a node forwards the first copy alone, so callers give 0 and False.
    links = len(latency.first)
    n = links if network is None else len(network.agent)
    return ChannelTable(
        latency=latency,
        loss=loss,
        duplication=each(duplication, (n,)),
        duplicates=bool(np.any(duplication)),
        fifo=fifo,
        latest=np.zeros(n),  # nothing arrives before a run begins, so the first copy waits for none
        latency_key=keys[Purpose.LATENCY],
        loss_key=keys[Purpose.LOSS],
        duplication_key=keys[Purpose.DUPLICATION],
        lost=np.zeros(links, dtype=np.bool_),
        spare=np.zeros(links),
        network=_NO_NETWORK if network is None else network,
    )


def forgotten(table: ChannelTable, keys: Mapping[Purpose, Key]) -> ChannelTable:
    """Give another run the models of a channel, which stay as they are, and a memory of its own."""
    loss, network, links = table.loss, table.network, len(table.lost)
    return table._replace(
        loss=forgotten_loss(loss),
        latest=np.zeros(len(table.latest)),
        latency_key=keys[Purpose.LATENCY],
        loss_key=keys[Purpose.LOSS],
        duplication_key=keys[Purpose.DUPLICATION],
        lost=np.zeros(links, dtype=np.bool_),
        spare=np.zeros(links),
        network=network._replace(
            latency=np.zeros(len(network.latency)),
            time=np.zeros(len(network.time)),
            fresh=np.zeros(len(network.fresh), dtype=np.bool_),
        ),
    )


@kernel
def put_in_order(latest: FloatArray, arrival: FloatArray) -> None:
    """Let no copy overtake another one on its link."""
    # Broadcasts come here in the order in which they leave, after cuts: what does not get through, at
    # infinity, is not remembered, and holds nothing back.
    for i in range(arrival.shape[0]):
        arrival[i] = max(arrival[i], latest[i])
        if arrival[i] < np.inf:
            latest[i] = arrival[i]


@deferred
def _transmit_seconds(
    table: ChannelTable, resource: int, number: int, departure: float, second: FloatArray
) -> None:
    # Lanes of its own: whether a channel duplicates moves no draw of the first copies.
    latency, key, lost, spare = table.latency, table.latency_key, table.lost, table.spare
    latency_row(latency, key, resource, number, LANES_PER_COPY, second, spare)
    uniforms_row(table.duplication_key, resource, number, 0, spare)
    # What is lost on the way is lost before it could be doubled.
    for i in range(second.shape[0]):
        twice = not lost[i] and spare[i] < table.duplication[i]
        second[i] = departure + second[i] if twice else np.inf


@shared
def transmit(
    table: ChannelTable, resource: int, number: int, departure: float, arrival: FloatArray, second: FloatArray
) -> int:
    """Draw loss, latency and duplication of every copy of a broadcast; `put_in_order` comes after it."""
    lost, spare, network = table.lost, table.spare, table.network
    # A refusal is a code here, and gets its words from `refuse`; the run ends with it.
    code = loss_row(table.loss, table.loss_key, resource, number, departure, 0, lost, spare)
    # Latencies of all links, lost copies included: a row is drawn in one go, and draws have addresses, so
    # that two channels which differ in loss alone give the copies that both deliver the same latencies.
    networked = network.head.shape[0] > 0
    drawn = network.latency if networked else arrival
    latency_row(table.latency, table.latency_key, resource, number, 0, drawn, spare)
    if is_improper(table.latency, drawn, spare):
        return _IMPROPER
    if networked:
        spread(network, lost, departure, arrival)
        return code
    # Lost copies arrive at infinity: a comparison of times suffices.
    for i in range(arrival.shape[0]):
        arrival[i] = np.inf if lost[i] else departure + arrival[i]
    # If there cannot be any, `second` is left alone and is not read.
    if table.duplicates:
        _transmit_seconds(table, resource, number, departure, second)
    return code


def refuse(table: ChannelTable, code: int, resource: int, time: float) -> Exception:
    """Say why a broadcast cannot be sent."""
    if code != _IMPROPER:
        return refuse_loss(table.loss, code, resource, time)
    link = int(np.argmin(table.spare >= 0.0))  # `is_improper` has left there what was drawn
    field = f"time {time!r}, resource {resource}: compiled latency of one's own[{link}]"
    return InputError.of(field, float(table.spare[link]), "a number of at least 0")
