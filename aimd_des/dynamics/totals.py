"""The state of all agents in arrays, one row per resource, and what can be read off it at a look.

A total is always summed over the agents in index order at the look that needs it and never
carried along: so it has the same bits however the agents are represented.
"""

import numpy as np

from aimd_des.dynamics.averaging import (
    CUMULATIVE,
    accumulated_at,
    age_at,
    average_at,
    folded_at,
    time_average,
)
from aimd_des.dynamics.demand import demand_at
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.utils.jit import deferred, formula, kernel, shared
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


@formula
def _find_values(
    state: State,
    parameters: AgentParameters,
    resource: int,
    first: int,
    now: float,
    tick_weight: float,
    demand: FloatArray,
    average: FloatArray,
) -> None:
    """Compute demand and average over all of the past of some agents, from one of them on."""
    # What `average_of` computes, a loop for each formula: so several agents are computed at once.
    j, count = resource, demand.shape[0]
    held, kept = state.demand[j][first:], state.accumulated[j][first:]
    anchor, origin, pause = state.anchor[j][first:], state.origin[j][first:], state.pause[j][first:]
    increase = parameters.increase[j][first:]
    for k in range(count):
        demand[k] = demand_at(held[k], increase[k], now - anchor[k], tick_weight)
    for k in range(count):
        since = min(now, pause[k]) - anchor[k]
        average[k] = accumulated_at(kept[k], held[k], increase[k], since, tick_weight)
    for k in range(count):
        average[k] = time_average(average[k], age_at(min(now, pause[k]), origin[k], tick_weight))


@formula
def _add_up(values: FloatArray, count: int, demand: FloatArray, average: FloatArray) -> None:
    """Add values of some agents to the sums of those before them."""
    # Each sum in the order of agents, one addition after the other; six sums side by side take hardly longer
    # than one.
    m = demand.shape[0]
    for j in range(0, m - m % 3, 3):
        held0, held1, held2 = demand[j], demand[j + 1], demand[j + 2]
        used0, used1, used2 = average[j], average[j + 1], average[j + 2]
        for k in range(count):
            held0 += values[2 * j, k]
            used0 += values[2 * j + 1, k]
            held1 += values[2 * j + 2, k]
            used1 += values[2 * j + 3, k]
            held2 += values[2 * j + 4, k]
            used2 += values[2 * j + 5, k]
        demand[j], demand[j + 1], demand[j + 2] = held0, held1, held2
        average[j], average[j + 1], average[j + 2] = used0, used1, used2
    for j in range(m - m % 3, m):
        held, used = demand[j], average[j]
        for k in range(count):
            held += values[2 * j, k]
            used += values[2 * j + 1, k]
        demand[j], average[j] = held, used


@formula
def _is_plain(parameters: AgentParameters, moment: FloatArray) -> bool:
    """Tell whether averages are over all of the past, up to one moment for all agents."""
    return bool(parameters.averaging.kind == CUMULATIVE and moment.shape[0] == 1)


@deferred
def _observe_in_turn(
    state: State,
    parameters: AgentParameters,
    moment: FloatArray,
    tick_weight: float,
    demand: FloatArray,
    average: FloatArray,
) -> None:
    """Read demand and average of all agents, for any way of averaging and up to any moments."""
    for j in range(state.demand.shape[0]):
        for i in range(state.demand.shape[1]):
            now = _moment_of(moment, i)
            demand[j, i] = demand_at(
                state.demand[j, i], parameters.increase[j, i], now - state.anchor[j, i], tick_weight
            )
            average[j, i] = average_of(state, parameters, j, i, now, tick_weight)


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
    if _is_plain(parameters, moment):
        for j in range(state.demand.shape[0]):
            _find_values(state, parameters, j, 0, moment[0], tick_weight, demand[j], average[j])
    else:
        _observe_in_turn(state, parameters, moment, tick_weight, demand, average)


@deferred
def _observe_totals_in_turn(
    state: State,
    parameters: AgentParameters,
    moment: FloatArray,
    tick_weight: float,
    demand: FloatArray,
    average: FloatArray,
) -> None:
    """Sum demand and average, for any way of averaging and up to any moments."""
    totals(state, parameters, moment, tick_weight, demand)
    for j in range(state.demand.shape[0]):
        used = 0.0
        for i in range(state.demand.shape[1]):
            used += average_of(state, parameters, j, i, _moment_of(moment, i), tick_weight)
        average[j] = used


@shared
def observe_totals(
    state: State,
    parameters: AgentParameters,
    moment: FloatArray,
    tick_weight: float,
    values: FloatArray,
    demand: FloatArray,
    average: FloatArray,
) -> None:
    """Sum demand and average over the agents in index order, for every resource; `values` is of `piece`."""
    if not _is_plain(parameters, moment):
        _observe_totals_in_turn(state, parameters, moment, tick_weight, demand, average)
        return
    m, n = state.demand.shape
    demand[:] = 0.0
    average[:] = 0.0
    for first in range(0, n, values.shape[1]):
        count = min(values.shape[1], n - first)
        for j in range(m):
            rows = values[2 * j][:count], values[2 * j + 1][:count]
            _find_values(state, parameters, j, first, moment[0], tick_weight, *rows)
        _add_up(values, count, demand, average)


def piece(n_resources: int) -> FloatArray:
    """Make the working memory of `observe_totals`: so small that it stays in the cache."""
    return np.empty((2 * n_resources, 256))
