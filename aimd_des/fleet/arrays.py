"""All that the compiled agents of one run work on, and how copies become theirs."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.clocks import next_tick, tick_time
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.fleet.in_flight import BLOCK, DUPLICATE, CopiesInFlight
from aimd_des.fleet.radix_heap import bits_of, put
from aimd_des.problem.costs import CostTable
from aimd_des.utils.jit import routine
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key, uniforms_row
from aimd_des.utils.validation import FloatArray

#: Above every order number, and the bits of every time.
LAST = (1 << 63) - 1

#: Which answers are kept for somebody: none, those of agents that respond, or of those that hold as well.
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
    """Answers that somebody wants to know of, in the order in which they were computed."""

    key: IntArray  # (a,): bits of the time
    rank: IntArray  # (a,): order number of the copy that was answered
    # (a,): i and j.
    agent: IntArray
    resource: IntArray
    change: FloatArray  # (a,): of demand; not a number where the agent holds
    held: IntArray  # (1,): how many there are


@record
class CopyAccount(NamedTuple):
    """Who is here, and what becomes of copies; the arrays are those of the run."""

    away: BoolArray  # (n,): agents that are not here at the moment
    # (m, n): as in `transmission.Transmitter`.
    delivered: IntArray
    lost: IntArray
    duplicated: IntArray


@record
class ResponseBuffers(NamedTuple):
    """Working memory, so that nothing is allocated per event.

    `first_key`, `first_arrival` and `first_rank`, shape (n,), are of the earliest copy of each agent
    among those that are due; `uniform`, (n,), is a row of draws; `average` and `gradient`, (m,), are of
    the agent at hand.  Of the copies of one block that are answered together, shape (BLOCK,): `chosen` are
    their places, `resource` what they are about, and all after it what the answers are computed from.
    """

    first_key: IntArray
    first_arrival: FloatArray
    first_rank: IntArray
    uniform: FloatArray
    average: FloatArray
    gradient: FloatArray
    chosen: npt.NDArray[np.uint64]
    resource: IntArray
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


def response_buffers(n_resources: int, n_agents: int) -> ResponseBuffers:
    """Make the working memory of one run, with nobody's copies due."""
    return ResponseBuffers(
        np.full(n_agents, LAST),  # later than every copy, so the first one found is the earliest so far
        np.zeros(n_agents),
        np.zeros(n_agents, dtype=np.int64),
        np.zeros(n_agents),
        np.zeros(n_resources),
        np.zeros(n_resources),
        np.zeros(BLOCK, dtype=np.uint64),
        np.zeros(BLOCK, dtype=np.int64),
        *np.zeros((13, BLOCK)),
    )


@record
class FleetAgents(NamedTuple):
    """The agents that are advanced together."""

    # State and parameters of all agents, as arrays of shape (m, n).
    state: State
    parameters: AgentParameters
    members: BoolArray  # (n,): who is advanced here
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
    account: CopyAccount  # who is here, and the account of copies
    room: int  # how many copies there may be at a time
    answers: Answers  # kept where somebody wants to know of them
    reported: int  # who does: `NO_ANSWERS`, or of which answers: `RESPONSES`, `ALL_ANSWERS`
    buffers: ResponseBuffers  # working memory


@routine
def accept(
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
