"""The latest broadcast of each resource, as rows aligned with the agents, and what is left of earlier ones.

Between a broadcast and the next look nothing has to be sorted: the copies stay where they were drawn, agent
i's at place i, and the look answers all that are due in passes over the rows.  Copies that are later still
are then listed one by one, with all that is left of earlier broadcasts, and the rows are free again.  Where
all copies of a broadcast land at one instant, as with one latency for all, later ones wait behind its row.
Discrete agents answer such rows alone, and at one tick.
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
    # (m, n): when each agent's copy arrives, of discrete agents the index of the tick that answers it (inf:
    # never, or answered); and its draw.
    arrival: FloatArray
    uniform: FloatArray
    rank: IntArray  # (m,): order number of the copy of agent 0; agent i's is i higher
    # (m,): no copy in the row is answered before, as it arrives or at a tick; inf where there is none
    first: FloatArray
    landing: FloatArray  # (m,): when all copies in the row arrive; inf where they do so at several times
    tick: FloatArray  # (m,): of discrete agents, the index of the tick that answers the row
    # (m, w): broadcasts that wait behind the row, a ring of places: when all copies of each arrive, and the
    # order number of that of agent 0; (m, w, n): their draws, `FORGOTTEN` where a copy never arrives.
    landing_behind: FloatArray
    rank_behind: IntArray
    uniform_behind: FloatArray
    # (m,): the place of the first of them, and how many they are.
    oldest: IntArray
    behind: IntArray
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
    """Tell whether agents can answer rows: with the paper's average, and if they tick together."""
    parameters, link = system.parameters, system.link
    plain = parameters.averaging.kind == CUMULATIVE and parameters.compensation.rule == NOTHING
    # A second copy would have to leave its row at once, and make the first leave, too.
    doubled = isinstance(link, CompiledLink) and link.table.duplicates
    together = system.clocks is None or system.clocks.common
    return together and plain and system.problem.costs.separable and not doubled


def broadcast_rows(enabled: bool, n_resources: int, n_agents: int, *, ticking: bool) -> BroadcastRows:
    """Make space for copies, of which there are none yet."""
    # Not zeroed: what is written before it is read need not be touched before.
    m, n = n_resources, n_agents if enabled else 0
    # One more, since a copy is written before it is known whether it counts.  Discrete agents answer a row as
    # a whole, at one tick.
    space = (0 if ticking else _LISTED * n) + 1
    return BroadcastRows(
        enabled=enabled,
        serving=np.zeros(m, dtype=np.bool_),
        arrival=np.empty((m, n)),
        uniform=np.empty((m, n)),
        rank=np.zeros(m, dtype=np.int64),
        first=np.full(m, np.inf),
        landing=np.full(m, np.inf),
        tick=np.zeros(m),
        landing_behind=np.empty((m, 0)),
        rank_behind=np.empty((m, 0), dtype=np.int64),
        uniform_behind=np.empty((m, 0, n)),
        oldest=np.zeros(m, dtype=np.int64),
        behind=np.zeros(m, dtype=np.int64),
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


def places_behind(rows: BroadcastRows) -> BroadcastRows:
    """Return rows behind each of which there is a place for one more broadcast that lands at one instant."""
    if not np.any(
        (rows.behind == rows.rank_behind.shape[1]) & (rows.first < np.inf) & (rows.landing < np.inf)
    ):
        return rows
    return _with_places(rows, max(1, 2 * rows.rank_behind.shape[1]))


def _with_places(rows: BroadcastRows, places: int) -> BroadcastRows:
    """Make more places behind the rows, the first of which are taken by what waits."""
    m, n = rows.arrival.shape
    larger = rows._replace(
        # Not filled: what is written before it is read need not be touched before.
        landing_behind=np.empty((m, places)),
        rank_behind=np.empty((m, places), dtype=np.int64),
        uniform_behind=spare((m, places, n)),
        oldest=np.zeros(m, dtype=np.int64),
    )
    _fill_places(larger, _behind(rows))
    return larger


# What there is of each broadcast behind a row.
_BEHIND = ("landing_behind", "rank_behind", "uniform_behind")


def _behind(rows: BroadcastRows) -> list[list[npt.NDArray[Any]]]:
    """Return what waits behind each row, in its order."""
    places = rows.rank_behind.shape[1]
    order = [
        (oldest + np.arange(count)) % places for oldest, count in zip(rows.oldest, rows.behind, strict=True)
    ]
    return [[getattr(rows, name)[j, taken] for name in _BEHIND] for j, taken in enumerate(order)]


def _fill_places(rows: BroadcastRows, behind: list[list[npt.NDArray[Any]]]) -> None:
    """Let what `_behind` has returned wait behind rows behind which there is nothing."""
    for j, kept in enumerate(behind):
        for name, values in zip(_BEHIND, kept, strict=True):
            getattr(rows, name)[j, : len(values)] = values


def copies_in_rows(rows: BroadcastRows) -> int:
    """Tell how many copies there can be, at most, in rows and lists; those behind count as in flight."""
    return rows.arrival.size + rows.listed_agent.size


_OF_RESOURCES = ("serving", "rank", "first", "landing", "tick", "behind", "listed", "first_listed")
_LISTS = ("listed_agent", "listed_arrival", "listed_uniform", "listed_rank")


def rows_state(rows: BroadcastRows) -> dict[str, Any]:
    """Return what is in rows, behind them and in lists; of rows and lists nothing is copied."""
    longest = int(rows.listed.max())
    return {
        "enabled": rows.enabled,
        "resources": {name: getattr(rows, name) for name in _OF_RESOURCES},
        # Of a row that is free nothing is ever read.
        "rows": [(int(j), rows.arrival[j], rows.uniform[j]) for j in np.flatnonzero(rows.first < np.inf)],
        "behind": _behind(rows),
        "lists": {name: getattr(rows, name)[:, :longest] for name in _LISTS},
    }


def resumed_rows(rows: BroadcastRows, state: Mapping[str, Any]) -> BroadcastRows:
    """Fill rows, lists and places behind rows with what `rows_state` has returned."""
    rows = _with_places(rows, int(state["resources"]["behind"].max()))
    _fill_places(rows, state["behind"])
    for name, kept in state["resources"].items():
        getattr(rows, name)[:] = kept
    for j, arrival, uniform in state["rows"]:
        rows.arrival[j], rows.uniform[j] = arrival, uniform
    for name, kept in state["lists"].items():
        getattr(rows, name)[:, : kept.shape[1]] = kept
    return rows
