"""The state of all agents in arrays, one row per resource, and what can be read off it at a look.

A total is always summed over the agents in index order at the look that needs it and never
carried along: so it has the same bits however the agents are represented.
"""

from aimd_des.dynamics.averaging import age_at, average_at, folded_at
from aimd_des.dynamics.response import demand_at
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.utils.jit import formula, kernel
from aimd_des.utils.validation import FloatArray


@formula
def average_of(
    state: State, parameters: AgentParameters, resource: int, agent: int, moment: float, tick_weight: float
) -> float:
    """Read one agent's average of one resource without changing anything."""
    j, i, averaging = resource, agent, parameters.averaging
    held, kept, alpha = state.demand[j, i], state.accumulated[j, i], parameters.increase[j, i]
    anchor, now = state.anchor[j, i], min(moment, state.pause[j, i])
    origin = state.origin[j, i]
    before = age_at(anchor, origin, tick_weight)
    folded = folded_at(averaging, kept, held, alpha, now - anchor, before, tick_weight)
    line = (folded, kept, held, alpha, anchor, origin)
    return average_at(averaging, state.parts, j, i, *line, now, tick_weight)


@kernel
def total_of(
    demand: FloatArray, increase: FloatArray, anchor: FloatArray, moment: FloatArray, tick_weight: float
) -> float:
    """Sum the demand for one resource over the agents, in index order."""
    total = 0.0
    if moment.shape[0] == 1:
        now = moment[0]
        for i in range(demand.shape[0]):
            total += demand_at(demand[i], increase[i], now - anchor[i], tick_weight)
    else:
        for i in range(demand.shape[0]):
            total += demand_at(demand[i], increase[i], moment[i] - anchor[i], tick_weight)
    return total


@kernel
def totals(
    state: State, parameters: AgentParameters, moment: FloatArray, tick_weight: float, out: FloatArray
) -> None:
    """Sum the demand over the agents in index order, for every resource."""
    for j in range(state.demand.shape[0]):
        out[j] = total_of(state.demand[j], parameters.increase[j], state.anchor[j], moment, tick_weight)


@formula
def _moment_of(moment: FloatArray, agent: int) -> float:
    return float(moment[0] if moment.shape[0] == 1 else moment[agent])


@kernel
def observe(
    state: State,
    parameters: AgentParameters,
    moment: FloatArray,
    tick_weight: float,
    demand: FloatArray,
    average: FloatArray,
) -> None:
    """Read demand and average of all agents without changing anything."""
    for j in range(state.demand.shape[0]):
        for i in range(state.demand.shape[1]):
            now = _moment_of(moment, i)
            demand[j, i] = demand_at(
                state.demand[j, i], parameters.increase[j, i], now - state.anchor[j, i], tick_weight
            )
            average[j, i] = average_of(state, parameters, j, i, now, tick_weight)


@kernel
def observe_totals(
    state: State,
    parameters: AgentParameters,
    moment: FloatArray,
    tick_weight: float,
    demand: FloatArray,
    average: FloatArray,
) -> None:
    """Sum demand and average over the agents in index order, for every resource."""
    totals(state, parameters, moment, tick_weight, demand)
    for j in range(state.demand.shape[0]):
        used = 0.0
        for i in range(state.demand.shape[1]):
            used += average_of(state, parameters, j, i, _moment_of(moment, i), tick_weight)
        average[j] = used
