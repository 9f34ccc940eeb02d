"""The latest broadcast of each resource, as rows aligned with the agents, and what is left of earlier ones.

Between a broadcast and the next look nothing has to be sorted: the copies stay where they were drawn, agent
i's at place i, and the look answers all that are due in passes over the rows.  Copies that are later still
are then listed one by one, with all that is left of earlier broadcasts, and the rows are free again.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.channel import CompiledLink
from aimd_des.dynamics.averaging import CUMULATIVE
from aimd_des.dynamics.loss_compensation import NOTHING
from aimd_des.engine.system import System
from aimd_des.fleet.in_flight import PIECE, IndexArray, IntArray
from aimd_des.utils.records import record
from aimd_des.utils.spare_arrays import spare
from aimd_des.utils.validation import FloatArray

# Copies that a list has space for, in broadcasts.  It is passed through at every look that finds something
# due, so with many broadcasts in flight a heap is faster.
_LISTED = 3


@record
class BroadcastRows(NamedTuple):
    """Copies on their way that are in no heap; with nothing enabled, the arrays of copies are empty."""

    enabled: bool  # whether a broadcast may become a row
    # (m,): whether the copies about a resource are here, and not in its heap.
    serving: npt.NDArray[np.bool_]
    # (m, n): when each agent's copy arrives (inf: never, or answered), and its draw.
    arrival: FloatArray
    uniform: FloatArray
    rank: IntArray  # (m,): order number of the copy of agent 0; agent i's is i higher
    first: FloatArray  # (m,): no copy in the row arrives before; inf where there is none
    # (m, s): copies that are left of earlier broadcasts, in no order: i, arrival, draw and order number.
    listed_agent: IndexArray
    listed_arrival: FloatArray
    listed_uniform: FloatArray
    listed_rank: IntArray
    listed: IntArray  # (m,): how many they are
    first_listed: FloatArray  # (m,): no listed copy arrives before; inf where there is none
    # (s,): those of them that are due at a look: working memory.
    due_agent: IndexArray
    due_arrival: FloatArray
    due_uniform: FloatArray
    due_rank: IntArray
    due_order: IndexArray  # (s,): their places, one piece of agents after the other
    due_end: IntArray  # (p,): where those of each piece end there


def serves(system: System) -> bool:
    """Tell whether the agents of a run can answer rows: continuous ones, with the paper's average."""
    parameters, link = system.parameters, system.link
    plain = parameters.averaging.kind == CUMULATIVE and parameters.compensation.rule == NOTHING
    # A second copy would have to leave its row at once, and make the first leave, too.
    doubled = isinstance(link, CompiledLink) and link.table.duplicates
    return system.clocks is None and plain and system.problem.costs.separable and not doubled


def broadcast_rows(enabled: bool, n_resources: int, n_agents: int) -> BroadcastRows:
    """Make space for copies, of which there are none yet."""
    # Not zeroed: what is written before it is read need not be touched before.
    m, n = n_resources, n_agents if enabled else 0
    # One more, since a copy is written before it is known whether it counts.
    space = _LISTED * n + 1
    return BroadcastRows(
        enabled=enabled,
        serving=np.zeros(m, dtype=np.bool_),
        arrival=np.empty((m, n)),
        uniform=np.empty((m, n)),
        rank=np.zeros(m, dtype=np.int64),
        first=np.full(m, np.inf),
        listed_agent=spare((m, space), np.uint32),
        listed_arrival=spare((m, space)),
        listed_uniform=spare((m, space)),
        listed_rank=spare((m, space), np.int64),
        listed=np.zeros(m, dtype=np.int64),
        first_listed=np.full(m, np.inf),
        due_agent=np.empty(space, dtype=np.uint32),
        due_arrival=np.empty(space),
        due_uniform=np.empty(space),
        due_rank=np.empty(space, dtype=np.int64),
        due_order=spare((space,), np.uint32),
        due_end=np.empty(-(-n_agents // PIECE), dtype=np.int64),
    )


def copies_in_rows(rows: BroadcastRows) -> int:
    """Tell how many copies there can be, at most, in rows and lists."""
    return rows.arrival.size + rows.listed_agent.size


_OF_RESOURCES = ("serving", "rank", "first", "listed", "first_listed")
_LISTS = ("listed_agent", "listed_arrival", "listed_uniform", "listed_rank")


def rows_state(rows: BroadcastRows) -> dict[str, Any]:
    """Return what is in rows and lists; nothing is copied."""
    longest = int(rows.listed.max())
    return {
        "enabled": rows.enabled,
        "resources": {name: getattr(rows, name) for name in _OF_RESOURCES},
        # Of a row that is free nothing is ever read.
        "rows": [(int(j), rows.arrival[j], rows.uniform[j]) for j in np.flatnonzero(rows.first < np.inf)],
        "lists": {name: getattr(rows, name)[:, :longest] for name in _LISTS},
    }


def resume_rows(rows: BroadcastRows, state: Mapping[str, Any]) -> None:
    """Fill rows and lists with what `rows_state` has returned."""
    for name, kept in state["resources"].items():
        getattr(rows, name)[:] = kept
    for j, arrival, uniform in state["rows"]:
        rows.arrival[j], rows.uniform[j] = arrival, uniform
    for name, kept in state["lists"].items():
        getattr(rows, name)[:, : kept.shape[1]] = kept
