"""All that the compiled agents of one run work on."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.fleet.broadcast_rows import BroadcastRows
from aimd_des.fleet.in_flight import PIECE, CopiesInFlight
from aimd_des.fleet.pending_totals import PendingTotals
from aimd_des.problem.costs import CostTable
from aimd_des.utils.jit import formula
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key
from aimd_des.utils.validation import FloatArray

#: Above every order number, and the bits of every time.
LAST = (1 << 63) - 1

#: Which answers are kept for observers: none, those of agents that respond, or of those that hold as well.
NO_ANSWERS, RESPONSES, ALL_ANSWERS = 0, 1, 2

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


@record
class ClockArrays(NamedTuple):
    """The clocks of discrete agents; of continuous ones, the arrays are empty."""

    # (n,): of each agent, drift included in the period.
    phase: FloatArray
    period: FloatArray
    jitter: FloatArray
    key: Key  # the run's key for clocks
    common: bool  # whether all tick at the same times


@record
class Answers(NamedTuple):
    """Answers that a listener asked for, in the order in which they were computed."""

    key: IntArray  # (a,): bits of the time
    rank: IntArray  # (a,): order number of the copy that was answered
    # (a,): i and j.
    agent: IntArray
    resource: IntArray
    change: FloatArray  # (a,): of demand; not a number where the agent holds
    held: IntArray  # (1,): how many there are
    interval: IntArray  # (a,): of which interval of time each is: working memory of sorting


@formula
def report(answers: Answers, key: int, rank: int, agent: int, resource: int, change: float) -> None:
    """Note an answer for its listeners."""
    # There is always a row.  Only what is sent adds to answers and copies in flight together; it waits where
    # copies have no room (`room`) or answers are more than `told_at_once`, and there are rows for both.
    row = answers.held[0]
    answers.key[row], answers.rank[row], answers.agent[row] = key, rank, agent
    answers.resource[row], answers.change[row] = resource, change
    answers.held[0] = row + 1


@record
class CopyAccount(NamedTuple):
    """Which agents are here, and what becomes of copies; the arrays are those of the run."""

    away: BoolArray  # (n,): agents that are not here at the moment
    # (m, n): as in `transmitter.Transmitter`.
    delivered: IntArray
    lost: IntArray
    duplicated: IntArray


@record
class ResponseBuffers(NamedTuple):
    """Working memory, so that nothing is allocated per event.

    `first_key`, `first_arrival` and `first_rank`, shape (n,), are of the earliest copy of each agent
    among those that are due. `uniform`, (n,), is a row of draws. `average`, (m,), and `gradient` are of
    the agent at hand; `gradient` has one place more, for what a gradient of one's own may not return. The
    other arrays, shape (PIECE,), are of copies that are answered together: those of a block or of a piece
    of a row. `chosen` are their places, `resource` what they are about (in a row, whether the agent
    responds, and `begins` whether it begins a new line). All after it is what the answers are computed from.
    """

    first_key: IntArray
    first_arrival: FloatArray
    first_rank: IntArray
    uniform: FloatArray
    average: FloatArray
    gradient: FloatArray
    chosen: npt.NDArray[np.uint64]
    resource: IntArray
    begins: IntArray
    moment: FloatArray
    since: FloatArray
    age: FloatArray
    held: FloatArray
    accumulated: FloatArray
    increase: FloatArray
    gamma: FloatArray
    folded: FloatArray
    present: FloatArray
    averages: FloatArray
    coefficient: FloatArray
    slope: FloatArray
    probability: FloatArray
    factor: FloatArray
    kept: FloatArray


def response_buffers(n_resources: int, n_agents: int) -> ResponseBuffers:
    """Make the working memory of one run, with no copies due."""
    return ResponseBuffers(
        np.full(n_agents, LAST),  # later than every copy, so the first one found is the earliest so far
        np.zeros(n_agents),
        np.zeros(n_agents, dtype=np.int64),
        np.zeros(n_agents),
        np.zeros(n_resources),
        np.zeros(n_resources + 1),
        np.zeros(PIECE, dtype=np.uint64),
        *np.zeros((2, PIECE), dtype=np.int64),
        *np.zeros((15, PIECE)),
    )


@record
class FleetAgents(NamedTuple):
    """The agents that are advanced together."""

    # State and parameters of all agents, as arrays of shape (m, n).
    state: State
    parameters: AgentParameters
    members: BoolArray  # (n,): which agents are advanced here
    table: CostTable  # private costs of the built-in families
    gradient: int  # address of the compiled gradient of other costs; 0 where there is none
    coupled: bool  # whether costs couple the resources
    clocks: ClockArrays
    # Tick weight, and the end of the run.
    tick_weight: float
    until: float
    key: Key  # the key of the response draws
    # Copies on their way: in one queue if costs are coupled, else in one for each resource.
    copies: CopiesInFlight
    rows: BroadcastRows  # those that are in no queue
    account: CopyAccount  # which agents are present, and the account of copies
    room: int  # how many copies there may be at a time in queues, besides all that may get there from rows
    answers: Answers  # kept where an observer asks for them
    reported: int  # which are asked for: `RESPONSES`, `ALL_ANSWERS`
    buffers: ResponseBuffers
    pending: PendingTotals  # totals that are taken while agents answer
