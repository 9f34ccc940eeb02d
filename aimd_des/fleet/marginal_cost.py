"""The derivative of one agent's cost in compiled code: of the built-in families, or of the user's own."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from aimd_des.dynamics.totals import average_of
from aimd_des.fleet.arrays import FleetAgents
from aimd_des.problem.costs.kernels import gradient_at
from aimd_des.utils.jit import formula

__all__ = ["marginal_cost_at"]


@intrinsic  # type: ignore[untyped-decorator]  # numba has no type information
def _call_gradient(typingctx: Any, address: Any, agent: Any, average: Any, gradient: Any) -> Any:  # noqa: ARG001
    """Call a compiled gradient: void(int64 agent, double* average, double* gradient)."""
    # Addresses travel as integers: a function pointer in the record of agents would be part of its type.
    signature = types.void(types.int64, types.int64, types.int64, types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        word, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [word, pointer, pointer]).as_pointer()
        places = [builder.inttoptr(place, pointer) for place in args[2:]]
        builder.call(builder.inttoptr(args[0], kind), [args[1], *places])
        return context.get_dummy_value()

    return signature, codegen


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
        # It hands over all m derivatives.
        gradient = agents.buffers.gradient
        _call_gradient(agents.gradient, agent, averages.ctypes.data, gradient.ctypes.data)
        return float(gradient[resource])
    return gradient_at(agents.table, averages, resource, agent)
