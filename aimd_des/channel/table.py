"""What becomes of a broadcast, in compiled code: the one way for processes and for compiled agents."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.channel.draws import LANES_PER_COPY
from aimd_des.channel.latency.rows import LatencyTable, latency_row
from aimd_des.channel.loss.rows import LossTable, loss_row
from aimd_des.checks import FloatArray
from aimd_des.compiled import kernel, routine
from aimd_des.streams import Key, Purpose, uniforms_row

__all__ = ["ChannelTable", "channel_table", "transmit"]

BoolArray = npt.NDArray[np.bool_]


class ChannelTable(NamedTuple):
    """A channel in one run, for compiled code, with its memory.

    Attributes
    ----------
    latency : LatencyTable
        The model of latency.
    loss : LossTable
        The model of loss.
    duplication : ndarray, shape (n,)
        Probability that a copy which is not lost arrives twice.
    duplicates : bool
        Whether any can.
    fifo : bool
        Whether each agent's link keeps the order of what is sent over it.
    latest : ndarray, shape (n,)
        The last arrival on each link, kept where links are FIFO.
    latency_key, loss_key, duplication_key : tuple of two uint64
        The run's keys.
    lost : ndarray of bool, shape (n,)
        Working memory, and so is `spare`, (n,).
    spare : ndarray, shape (n,)
        See there.
    """

    latency: LatencyTable
    loss: LossTable
    duplication: FloatArray
    duplicates: bool
    fifo: bool
    latest: FloatArray
    latency_key: Key
    loss_key: Key
    duplication_key: Key
    lost: BoolArray
    spare: FloatArray


def channel_table(
    latency: LatencyTable,
    loss: LossTable,
    duplication: npt.ArrayLike,
    fifo: bool,
    keys: Mapping[Purpose, Key],
) -> ChannelTable:
    """Lay out a channel for compiled code, at the start of a run.

    Parameters
    ----------
    latency : LatencyTable
        The model of latency.
    loss : LossTable
        The model of loss.
    duplication : float or array_like, shape (n,)
        Probability that a copy which is not lost arrives twice.
    fifo : bool
        Whether links are.
    keys : mapping of Purpose to Key
        The run's keys of random numbers.

    Returns
    -------
    ChannelTable
        Nothing has been sent yet.
    """
    n = len(latency.first)
    return ChannelTable(
        latency=latency,
        loss=loss,
        duplication=np.array(np.broadcast_to(duplication, (n,)), dtype=np.float64),
        duplicates=bool(np.any(duplication)),
        fifo=fifo,
        latest=np.zeros(n),
        latency_key=keys[Purpose.LATENCY],
        loss_key=keys[Purpose.LOSS],
        duplication_key=keys[Purpose.DUPLICATION],
        lost=np.zeros(n, dtype=np.bool_),
        spare=np.zeros(n),
    )


@kernel
def _put_in_order(latest: FloatArray, arrival: FloatArray) -> None:
    """Let no copy overtake another one on its link."""
    for i in range(arrival.shape[0]):
        arrival[i] = max(arrival[i], latest[i])
        if arrival[i] < np.inf:
            latest[i] = arrival[i]


@routine
def _transmit_seconds(
    table: ChannelTable, resource: int, number: int, departure: float, second: FloatArray
) -> None:
    latency, key, lost, spare = table.latency, table.latency_key, table.lost, table.spare
    latency_row(latency, key, resource, number, LANES_PER_COPY, second, spare)
    uniforms_row(table.duplication_key, resource, number, 0, spare)
    for i in range(second.shape[0]):
        twice = not lost[i] and spare[i] < table.duplication[i]
        second[i] = departure + second[i] if twice else np.inf


@routine
def transmit(
    table: ChannelTable, resource: int, number: int, departure: float, arrival: FloatArray, second: FloatArray
) -> int:
    """Draw loss, latency and duplication of every copy of a broadcast.

    Parameters
    ----------
    table : ChannelTable
        The channel; its memory moves on.
    resource, number : int
        The broadcast.
    departure : float
        When it leaves the control unit.
    arrival : ndarray, shape (n,)
        Receives when each agent's copy arrives; inf where it is lost.
    second : ndarray, shape (n,)
        Receives when a duplicate arrives, inf where there is none; left alone if there cannot be any.

    Returns
    -------
    int
        0, or what `refuse_loss` has words for.
    """
    lost, spare = table.lost, table.spare
    code = loss_row(table.loss, table.loss_key, resource, number, departure, 0, lost, spare)
    latency_row(table.latency, table.latency_key, resource, number, 0, arrival, spare)
    for i in range(arrival.shape[0]):
        arrival[i] = np.inf if lost[i] else departure + arrival[i]
    if table.duplicates:
        _transmit_seconds(table, resource, number, departure, second)
    if table.fifo:
        _put_in_order(table.latest, arrival)
        if table.duplicates:
            _put_in_order(table.latest, second)
    return code
