"""The state of all agents in arrays, one row per resource, and what can be read off it at a look.

A total is always summed over the agents in index order at the look that needs it and never
carried along: so it has the same bits however the agents are represented.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.checks import FloatArray
from aimd_des.compiled import kernel
from aimd_des.problem import Problem
from aimd_des.response import grown, tick_averages

__all__ = ["Law", "State", "law_of", "observe", "start", "total_demand"]

IntArray = npt.NDArray[np.int64]


class State(NamedTuple):
    """What changes: every array has shape (m, n).

    Attributes
    ----------
    demand : ndarray
        Demand just after the anchor, in units of the resource.
    accumulated : ndarray
        Demand summed over all ticks up to and including the anchor.
    anchor : ndarray
        Index of the tick at which a signal was answered last; -1 before the first.
    responses, saturated : ndarray of int
        Decreases, and those of them that had a response probability above 1.
    """

    demand: FloatArray
    accumulated: FloatArray
    anchor: FloatArray
    responses: IntArray
    saturated: IntArray


class Law(NamedTuple):
    """What does not change: the parameters of the agents' rule.

    Attributes
    ----------
    increase, decrease : ndarray, shape (m, n)
        alpha and beta.
    normalization : ndarray, shape (m,)
        Gamma.
    limit : ndarray, shape (m,)
        Total demand above which a capacity event is due.
    capacity : ndarray, shape (m,)
        C.
    """

    increase: FloatArray
    decrease: FloatArray
    normalization: FloatArray
    limit: FloatArray
    capacity: FloatArray


def law_of(problem: Problem) -> Law:
    """Lay out a problem's parameters with agents along the contiguous axis.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many.

    Returns
    -------
    Law
        Its arrays are copies.
    """
    return Law(
        increase=problem.increase.T.copy(),
        decrease=problem.decrease.T.copy(),
        normalization=problem.normalization.copy(),
        limit=problem.limit.copy(),
        capacity=problem.capacity.copy(),
    )


def start(n_resources: int, n_agents: int) -> State:
    """Give the state before the first tick: nobody holds anything.

    Parameters
    ----------
    n_resources, n_agents : int
        m and n.

    Returns
    -------
    State
        Fresh arrays.
    """
    shape = (n_resources, n_agents)
    return State(
        demand=np.zeros(shape),
        accumulated=np.zeros(shape),
        anchor=np.full(shape, -1.0),
        responses=np.zeros(shape, dtype=np.int64),
        saturated=np.zeros(shape, dtype=np.int64),
    )


@kernel
def total_demand(state: State, law: Law, tick: float, out: FloatArray) -> None:
    """Sum x(k) over the agents in index order, for every resource.

    Parameters
    ----------
    state : State
        State of all agents.
    law : Law
        Parameters of the rule.
    tick : float
        k, the index of the agents' next tick.
    out : ndarray, shape (m,)
        Receives the totals, in units of the resources.
    """
    for j in range(state.demand.shape[0]):
        demand, increase, anchor = state.demand[j], law.increase[j], state.anchor[j]
        total = 0.0
        for i in range(demand.shape[0]):
            total += grown(demand[i], increase[i], tick - anchor[i] - 1.0)
        out[j] = total


@kernel
def observe(state: State, law: Law, tick: float, demand: FloatArray, average: FloatArray) -> None:
    """Read demand x(k) and average x-bar(k) of all agents without changing anything.

    Parameters
    ----------
    state : State
        State of all agents.
    law : Law
        Parameters of the rule.
    tick : float
        k, the index of the agents' next tick.
    demand, average : ndarray, shape (m, n)
        Receive what is read, in units of the resources.
    """
    for j in range(state.demand.shape[0]):
        for i in range(state.demand.shape[1]):
            steps = tick - state.anchor[j, i] - 1.0
            demand[j, i] = grown(state.demand[j, i], law.increase[j, i], steps)
        tick_averages(
            state.demand[j], state.accumulated[j], state.anchor[j], law.increase[j], tick, average[j]
        )
