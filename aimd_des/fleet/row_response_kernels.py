"""How agents answer a row by another rule than the paper's: only those whose copies are due are asked.

A rule may remember what it has answered, so it must not be asked of a copy that is lost or comes later.
"""

from aimd_des.dynamics.averaging import age_at
from aimd_des.dynamics.demand import CONTINUOUS
from aimd_des.dynamics.responses import ASKED, INPUTS, OWN, ask_own, cut_factor, probability_of
from aimd_des.fleet.arrays import FleetAgents
from aimd_des.utils.jit import deferred, formula
from aimd_des.utils.validation import FloatArray

_NORMALIZATION, _SLOPE, _AVERAGE, _DEMAND, _INCREASE, _DECREASE, _AGE, _AGENT, _RESOURCE = range(len(INPUTS))


@formula
def _lay_out_from(source: FloatArray, row: FloatArray) -> None:
    for k in range(source.shape[0]):
        row[k] = source[k]


@formula
def _lay_out_ages(agents: FleetAgents, resource: int, first: int, last: int, row: FloatArray) -> None:
    arrival, origin = agents.rows.arrival[resource][first:last], agents.state.origin[resource][first:last]
    for k in range(last - first):
        row[k] = age_at(arrival[k], origin[k], agents.tick_weight)


@formula
def _lay_out(agents: FleetAgents, resource: int, first: int, last: int) -> None:
    """Lay out what the user's function reads, for the answers of a piece of a row."""
    j, count, buffers, response = resource, last - first, agents.buffers, agents.parameters.response
    for p in range(response.order.shape[0]):
        read, row = response.order[p], response.inputs[p]
        if read == _NORMALIZATION:
            row[:count] = agents.parameters.normalization[j]
        elif read == _SLOPE:
            _lay_out_from(buffers.slope[:count], row)
        elif read == _AVERAGE:
            _lay_out_from(buffers.averages[:count], row)
        elif read == _DEMAND:
            _lay_out_from(buffers.present[:count], row)
        elif read == _INCREASE:
            _lay_out_from(agents.parameters.increase[j][first:last], row)
        elif read == _DECREASE:
            _lay_out_from(agents.parameters.decrease[j][first:last], row)
        elif read == _AGE:
            _lay_out_ages(agents, j, first, last, row)
        elif read == _AGENT:
            for k in range(count):
                row[k] = float(first + k)
        elif read == _RESOURCE:
            row[:count] = float(j)


@formula
def _ask_own(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> None:
    """Have the user's function called for those of some agents whose copies are due."""
    j, count, buffers, response = resource, last - first, agents.buffers, agents.parameters.response
    arrival, given = agents.rows.arrival[j][first:last], response.given
    _lay_out(agents, j, first, last)
    for k in range(count):
        given[k] = ASKED if (arrival[k] <= bound) & (buffers.averages[k] > 0.0) else 0.0
    ask_own(response, agents.state.memory[j, first:], count)
    for k in range(count):
        buffers.probability[k] = given[k]


@deferred
def weigh_otherwise(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> None:
    """Compute the response probabilities of some agents at their copies in the row, where they are due."""
    j, buffers, parameters = resource, agents.buffers, agents.parameters
    if parameters.response.divisor == OWN:
        _ask_own(agents, j, first, last, bound)
        return
    for k in range(last - first):
        i, buffers.probability[k] = first + k, 0.0
        if agents.rows.arrival[j, i] <= bound:
            lines = (buffers.present[k], parameters.increase[j, i], parameters.decrease[j, i])
            age = age_at(agents.rows.arrival[j, i], agents.state.origin[j, i], agents.tick_weight)
            buffers.probability[k] = probability_of(
                parameters.response,
                parameters.averaging,
                agents.state.memory,
                j,
                i,
                parameters.normalization[j],
                buffers.slope[k],
                buffers.averages[k],
                *lines,
                age,
            )


@deferred
def cut_otherwise(agents: FleetAgents, resource: int, first: int, last: int, bound: float) -> None:
    """Compute what demands are multiplied by where no draw decides: 1 where nothing is due."""
    j, buffers, parameters = resource, agents.buffers, agents.parameters
    for k in range(last - first):
        i, buffers.factor[k] = first + k, 1.0
        if agents.rows.arrival[j, i] <= bound:
            found = (buffers.probability[k], agents.rows.uniform[j, i], buffers.present[k])
            buffers.factor[k] = cut_factor(
                parameters.response,
                parameters.averaging,
                agents.state.memory,
                j,
                i,
                *found,
                parameters.decrease[j, i],
            )


@deferred
def probability_otherwise(
    agents: FleetAgents, resource: int, agent: int, slope: float, average: float, demand: float, moment: float
) -> float:
    """Compute the response probability of one agent."""
    j, i, parameters = resource, agent, agents.parameters
    lines = (demand, parameters.increase[j, i], parameters.decrease[j, i])
    age = age_at(moment, agents.state.origin[j, i], CONTINUOUS)
    found = (parameters.normalization[j], slope, average, *lines, age)
    return probability_of(parameters.response, parameters.averaging, agents.state.memory, j, i, *found)


@deferred
def factor_otherwise(
    agents: FleetAgents, resource: int, agent: int, probability: float, demand: float
) -> float:
    """Compute what the demand of one agent is multiplied by where no draw decides."""
    j, i, parameters = resource, agent, agents.parameters
    found = (probability, 0.0, demand, parameters.decrease[j, i])
    return cut_factor(parameters.response, parameters.averaging, agents.state.memory, j, i, *found)
