"""The losses of one broadcast as compiled code draws them, and what it remembers from one to the next."""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.channel.loss.compiled_loss import call_lost
from aimd_des.channel.random_draws import LANES_PER_PART, Draws
from aimd_des.utils.errors import SimulationError
from aimd_des.utils.jit import deferred, formula, routine
from aimd_des.utils.locked_arrays import carry_over, each
from aimd_des.utils.portable_math import exp
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key, Purpose, uniform_at, uniforms_row
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray


class Cause(IntEnum):
    """What makes copies get lost."""

    NOTHING = 0
    CHANCE = 1
    COMMON = 2
    BURSTS = 3
    RECORD = 4
    OWN = 5


_NOTHING, _CHANCE, _COMMON, _BURSTS, _RECORD, _OWN = (int(cause) for cause in Cause)

# What keeps a broadcast from being sent at all.
_SENT, _RECORD_ENDED, _BACK_IN_TIME, _RAISED = 0, 1, 2, 3


@record
class LossTable(NamedTuple):
    """One or several causes of loss, for compiled code, with their memory; a copy is lost to any of them."""

    cause: IntArray  # (p,): of `Cause`
    # (p, n): probability of loss, and the rate at which links forget; of a cause of the user's own, the first
    # and the second parameter of its function, and the third.
    probability: FloatArray
    rate: FloatArray
    third: FloatArray
    address: IntArray  # (p,): of the user's own function, compiled for rows; 0 for other causes
    memory: FloatArray  # (c,): what these functions keep, link by link, one cause after another
    # (p,): where that of a cause begins, and how many numbers it keeps for each link.
    memory_begin: IntArray
    columns: IntArray
    bad: BoolArray  # (p, n): state of the links at the last broadcast
    time: FloatArray  # (p,): when that was; not a number before the first
    record: BoolArray  # (r,): the rows of all records, one after another
    # (p,): where a record begins, how many rows it has, and how many columns: 1 or n.
    begin: IntArray
    rows: IntArray
    width: IntArray
    repeat: BoolArray  # (p,): whether a record begins anew after its last row
    row: IntArray  # (p,): how many rows have been read


def loss_table(
    cause: Cause,
    n_agents: int,
    probability: npt.ArrayLike = 0.0,
    rate: npt.ArrayLike = 0.0,
    record: BoolArray | None = None,
    repeat: bool = False,
    third: npt.ArrayLike = 0.0,
    address: int = 0,
    columns: int = 0,
) -> LossTable:
    """Lay out a model for compiled code, at the start of a run."""
    rows = np.zeros((0, 1), dtype=np.bool_) if record is None else record.reshape(len(record), -1)
    return LossTable(
        cause=np.array([cause], dtype=np.int64),
        probability=each(probability, (1, n_agents)),
        rate=each(rate, (1, n_agents)),
        third=each(third, (1, n_agents)),
        address=np.array([address], dtype=np.int64),
        memory=np.zeros(n_agents * columns),
        memory_begin=np.zeros(1, dtype=np.int64),
        columns=np.array([columns], dtype=np.int64),
        bad=np.zeros((1, n_agents), dtype=np.bool_),
        time=np.array([np.nan]),
        record=rows.ravel().copy(),
        begin=np.zeros(1, dtype=np.int64),
        rows=np.array([rows.shape[0]]),
        width=np.array([rows.shape[1]]),
        repeat=np.array([repeat]),
        row=np.zeros(1, dtype=np.int64),
    )


def forgotten_loss(table: LossTable) -> LossTable:
    """Give another run the causes of a table, which stay as they are, and a memory of its own."""
    return table._replace(
        memory=np.zeros(len(table.memory)),
        bad=np.zeros(table.bad.shape, dtype=np.bool_),
        time=np.full(len(table.time), np.nan),
        row=np.zeros(len(table.row), dtype=np.int64),
    )


def join(tables: Sequence[LossTable]) -> LossTable:
    """Put several causes into one table."""
    columns = zip(*tables, strict=True)
    joined = LossTable(*(np.concatenate(column) for column in columns))
    sizes, kept = joined.rows * joined.width, joined.columns * joined.bad.shape[1]
    return joined._replace(begin=np.cumsum(sizes) - sizes, memory_begin=np.cumsum(kept) - kept)


@deferred
def _bursts(table: LossTable, part: int, uniform: FloatArray, time: float) -> None:
    """Move all links to the time of the broadcast."""
    first, since = np.isnan(table.time[part]), time - table.time[part]
    for i in range(uniform.shape[0]):
        chance = table.probability[part, i]
        if not first:
            # At the same instant the memory is 1 and the chance 0 or 1: the state stays.
            was = 1.0 if table.bad[part, i] else 0.0
            chance = chance + (was - chance) * exp(-table.rate[part, i] * since)
        table.bad[part, i] = uniform[i] < chance
    table.time[part] = time


@deferred
def _ask_own(table: LossTable, part: int, time: float, lost: BoolArray, spare: FloatArray) -> bool:
    """Ask the user's function for each link, whose uniform number is in `spare`; tell whether it answers."""
    memory = table.memory[table.memory_begin[part] :]
    first, second, third = table.probability[part], table.rate[part], table.third[part]
    rows = spare.ctypes.data, first.ctypes.data, second.ctypes.data, third.ctypes.data, memory.ctypes.data
    call_lost(table.address[part], (lost.shape[0], time, *rows, lost.ctypes.data))
    return not np.isnan(spare[0])


@formula
def _read_record(table: LossTable, part: int, lost: BoolArray) -> bool:
    """Read the next row of a record; tell whether there is one."""
    rows, width = table.rows[part], table.width[part]
    if table.row[part] >= rows and not table.repeat[part]:
        return False
    begin = table.begin[part] + (table.row[part] % rows) * width
    for i in range(lost.shape[0]):
        lost[i] |= table.record[begin + (i if width > 1 else 0)]
    table.row[part] += 1
    return True


@formula
def _draw_bursts(table: LossTable, part: int, spare: FloatArray, time: float, lost: BoolArray) -> None:
    """Lose the copies on links that are in a burst at the time of the broadcast."""
    _bursts(table, part, spare, time)
    for i in range(lost.shape[0]):
        lost[i] |= table.bad[part, i]


@routine
def loss_row(
    table: LossTable,
    key: Key,
    resource: int,
    number: int,
    time: float,
    lane: int,
    lost: BoolArray,
    spare: FloatArray,
) -> int:
    """Draw the losses of one broadcast; every part is asked, for what it remembers must be kept up."""
    lost[:] = False
    for part in range(table.cause.shape[0]):
        cause, own = table.cause[part], lane + part * LANES_PER_PART
        if cause == _CHANCE:
            uniforms_row(key, resource, number, own, spare)
            for i in range(lost.shape[0]):
                lost[i] |= spare[i] < table.probability[part, i]
        elif cause == _COMMON:
            # The first agent's number decides for all: it is there however many agents there are.
            if uniform_at(key, resource, number, own, 0) < table.probability[part, 0]:
                lost[:] = True
        elif cause == _BURSTS:
            if time < table.time[part]:
                return _BACK_IN_TIME
            uniforms_row(key, resource, number, own, spare)
            _draw_bursts(table, part, spare, time, lost)
        elif cause == _RECORD:
            if not _read_record(table, part, lost):
                return _RECORD_ENDED
        elif cause == _OWN:
            uniforms_row(key, resource, number, own, spare)
            if not _ask_own(table, part, time, lost, spare):
                return _RAISED
    return _SENT


def refuse_loss(table: LossTable, code: int, resource: int, time: float) -> SimulationError:
    """Say why a broadcast cannot be sent."""
    where = f"time {time!r}, resource {resource}"
    if code == _RAISED:
        return SimulationError(f"{where}: the compiled function of a loss of one's own raises an exception")
    if code == _RECORD_ENDED:
        # Parts before the one that has ended have read a row for this broadcast, perhaps their last.
        record = table.cause == _RECORD
        ended = record & (table.rows <= table.row[record].min()) & ~table.repeat
        part = int(np.argmax(ended))
        return SimulationError(
            f"{where}: broadcast {table.row[part]} of the run has no row in a trace of {table.rows[part]}; "
            "give Trace more rows, or repeat=True to begin anew"
        )
    part = int(np.nanargmax(np.where(table.cause == _BURSTS, table.time, np.nan)))
    return SimulationError(
        f"{where}: a broadcast that is earlier than the one before it, at {float(table.time[part])!r}; "
        "bursts of loss need broadcasts in the order of time"
    )


class TabledLoss:
    """The losses of one run as compiled code draws them."""

    def __init__(self, table: LossTable) -> None:
        self.table = table

    def state(self) -> dict[str, Any]:
        """Return what it remembers."""
        table = self.table
        return {"bad": table.bad, "time": table.time, "row": table.row, "memory": table.memory}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        table = self.table
        table.time[:], table.row[:] = state["time"], state["row"]
        carry_over(state["bad"], table.bad)
        carry_over(state["memory"], table.memory)

    def draw(self, draws: Draws) -> BoolArray:
        """Return whether each agent's copy is lost."""
        lost, spare = np.empty(draws.n_agents, dtype=np.bool_), np.empty(draws.n_agents)
        key, lane = draws.keys[Purpose.LOSS], draws.lane(0)
        code = loss_row(self.table, key, draws.resource, draws.number, draws.time, lane, lost, spare)
        if code != _SENT:
            raise refuse_loss(self.table, code, draws.resource, draws.time)
        return lost
