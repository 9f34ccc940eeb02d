"""Total demand where every agent ticks at times of its own: a tick costs log n, not n."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from aimd_des.dynamics.demand import DISCRETE, demand_at
from aimd_des.engine.system import System
from aimd_des.utils.jit import kernel
from aimd_des.utils.validation import FloatArray, IntArray


@kernel
def _renew(
    sums: FloatArray,
    demand: FloatArray,
    increase: FloatArray,
    anchor: FloatArray,
    agents: IntArray,
    moment: FloatArray,
) -> None:
    """Take in what some agents hold now, and add up anew what it is a part of."""
    leaves = sums.shape[1] // 2
    for place in range(agents.shape[0]):
        i = agents[place]
        for j in range(sums.shape[0]):
            node = leaves + i
            since = moment[i] - anchor[j, i]
            sums[j, node] = demand_at(demand[j, i], increase[j, i], since, DISCRETE)
            while node > 1:
                node //= 2
                sums[j, node] = sums[j, 2 * node] + sums[j, 2 * node + 1]


class DemandSums:
    """Sums of demand in a binary tree over the agents.

    A demand that changes is added up anew along its branch alone.  A sum is that of two others after any
    change, and in any order of changes: so the total at the root has the same bits for processes and fleets.
    They are not those of a sum in the order of agents, in the last places.
    """

    def __init__(self, system: System) -> None:
        n, m = system.problem.n_agents, system.problem.n_resources
        self.system = system
        # Node k has the nodes 2 k and 2 k + 1 below it, and the agents are the last ones.
        self._sums = np.zeros((m, 2 << (n - 1).bit_length()))
        self._moment = np.zeros(n)  # how many ticks of each agent are over
        self._changed: list[int] = []
        system.on_break.append(self._changed.append)

    def state(self) -> dict[str, Any]:
        """Return the sums, and what they lack."""
        return {"sums": self._sums, "moment": self._moment, "changed": tuple(self._changed)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self._sums[:], self._moment[:] = state["sums"], state["moment"]
        self._changed[:] = state["changed"]  # in place: a break of a line is appended to this very list

    def ticks(self, agent: int, tick: int) -> None:
        """Take note that an agent ticks at this instant; what it holds then is read at a later one."""
        self._moment[agent] = tick + 1
        self._changed.append(agent)

    def read(self) -> FloatArray:
        """Return total demand now, shape (m,), which is no instant of a tick that has been noted."""
        self.system.settle()
        state, increase = self.system.state, self.system.parameters.increase
        _renew(
            self._sums,
            state.demand,
            increase,
            state.anchor,
            np.array(self._changed, dtype=np.int64),
            self._moment,
        )
        self._changed.clear()
        return self._sums[:, 1].copy()
