"""The state of all agents in arrays, one row per resource, and what can be read off it at a look.

A total is always summed over the agents in index order at the look that needs it and never
carried along: so it has the same bits however the agents are represented.
"""

from aimd_des.dynamics.averaging import average_at, folded_at
from aimd_des.dynamics.response import demand_at
from aimd_des.dynamics.state import Law, State
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray

__all__ = ["average_of", "observe", "observe_totals", "total_of", "totals"]


@formula
def average_of(state: State, law: Law, resource: int, agent: int, moment: float, grain: float) -> float:
    """Read one agent's average of one resource without changing anything."""
    j, i, memory = resource, agent, law.memory
    held, kept, alpha = state.demand[j, i], state.accumulated[j, i], law.increase[j, i]
    anchor, now = state.anchor[j, i], min(moment, state.pause[j, i])
    folded = folded_at(memory, kept, held, alpha, now - anchor, grain)
    line = (folded, kept, held, alpha, anchor, state.origin[j, i])
    return average_at(memory, state.parts, j, i, *line, now, grain)


@kernel
def total_of(
    demand: FloatArray, increase: FloatArray, anchor: FloatArray, moment: FloatArray, grain: float
) -> float:
    """Sum the demand for one resource over the agents, in index order."""
    total = 0.0
    if moment.shape[0] == 1:
        now = moment[0]
        for i in range(demand.shape[0]):
            total += demand_at(demand[i], increase[i], now - anchor[i], grain)
    else:
        for i in range(demand.shape[0]):
            total += demand_at(demand[i], increase[i], moment[i] - anchor[i], grain)
    return total


@kernel
def totals(state: State, law: Law, moment: FloatArray, grain: float, out: FloatArray) -> None:
    """Sum the demand over the agents in index order, for every resource."""
    for j in range(state.demand.shape[0]):
        out[j] = total_of(state.demand[j], law.increase[j], state.anchor[j], moment, grain)


@formula
def _moment_of(moment: FloatArray, agent: int) -> float:
    return float(moment[0] if moment.shape[0] == 1 else moment[agent])


@kernel
def observe(
    state: State, law: Law, moment: FloatArray, grain: float, demand: FloatArray, average: FloatArray
) -> None:
    """Read demand and average of all agents without changing anything."""
    for j in range(state.demand.shape[0]):
        for i in range(state.demand.shape[1]):
            now = _moment_of(moment, i)
            demand[j, i] = demand_at(state.demand[j, i], law.increase[j, i], now - state.anchor[j, i], grain)
            average[j, i] = average_of(state, law, j, i, now, grain)


@kernel
def observe_totals(
    state: State, law: Law, moment: FloatArray, grain: float, demand: FloatArray, average: FloatArray
) -> None:
    """Sum demand and average over the agents in index order, for every resource."""
    totals(state, law, moment, grain, demand)
    for j in range(state.demand.shape[0]):
        used = 0.0
        for i in range(state.demand.shape[1]):
            used += average_of(state, law, j, i, _moment_of(moment, i), grain)
        average[j] = used
