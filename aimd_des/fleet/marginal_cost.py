"""The derivative of one agent's cost in compiled code: of the built-in families, or of the user's own."""

from aimd_des.dynamics.totals import average_of
from aimd_des.fleet.arrays import FleetAgents
from aimd_des.problem.costs.kernels import gradient_at
from aimd_des.utils.compiled_call import call_of_agent
from aimd_des.utils.jit import formula


@formula
def marginal_cost_at(agents: FleetAgents, agent: int, resource: int, moment: float, average: float) -> float:
    """Return grad_j f_i at the agent's averages, of which that of the resource itself is known."""
    averages = agents.buffers.average
    if agents.coupled:
        # An answer leaves the average at its own moment as it was, so of several answers at one tick each
        # finds the averages from before all of them.
        for j in range(averages.shape[0]):
            averages[j] = average_of(agents.state, agents.parameters, j, agent, moment, agents.tick_weight)
    else:
        # Costs that are separable read no other average; what the others hold here is of another agent.
        averages[resource] = average
    if agents.gradient != 0:
        # It hands over all m derivatives, and after them the last one that was no finite number.
        gradient = agents.buffers.gradient
        call_of_agent(agents.gradient, (agent, averages.ctypes.data, gradient.ctypes.data))
        return float(gradient[resource])
    return gradient_at(agents.table, averages, resource, agent)
