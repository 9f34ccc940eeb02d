"""The state of all agents in arrays, one row per resource, and what can be read off it at a look.

A total is always summed over the agents in index order at the look that needs it and never
carried along: so it has the same bits however the agents are represented.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.checks import FloatArray
from aimd_des.compiled import formula, kernel
from aimd_des.problem import Problem
from aimd_des.response import accumulated_at, demand_at, time_average

__all__ = ["Law", "State", "law_of", "observe", "observe_totals", "start", "total_of", "totals"]

IntArray = npt.NDArray[np.int64]


class State(NamedTuple):
    """What changes: every array has shape (m, n).

    Attributes
    ----------
    demand : ndarray
        Demand just after the anchor, in units of the resource.
    accumulated : ndarray
        Demand accumulated up to the anchor: over ticks, or over time.
    anchor : ndarray
        The last moment at which growth was broken: index of the tick (-1 before the first), or time.
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


def start(n_resources: int, n_agents: int, grain: float) -> State:
    """Give the state before anything has happened: nobody holds anything.

    Parameters
    ----------
    n_resources, n_agents : int
        m and n.
    grain : float
        Grain of time.

    Returns
    -------
    State
        Fresh arrays.
    """
    shape = (n_resources, n_agents)
    return State(
        demand=np.zeros(shape),
        accumulated=np.zeros(shape),
        anchor=np.full(shape, 0.0 - grain),
        responses=np.zeros(shape, dtype=np.int64),
        saturated=np.zeros(shape, dtype=np.int64),
    )


@kernel
def total_of(
    demand: FloatArray, increase: FloatArray, anchor: FloatArray, moment: FloatArray, grain: float
) -> float:
    """Sum the demand for one resource over the agents, in index order.

    Parameters
    ----------
    demand, increase, anchor : ndarray, shape (n,)
        State and alpha for the resource.
    moment : ndarray, shape (n,) or (1,)
        The moment at hand: of each agent, or common to all.
    grain : float
        Grain of time.

    Returns
    -------
    float
        In units of the resource.
    """
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
    """Sum the demand over the agents in index order, for every resource.

    Parameters
    ----------
    state : State
        State of all agents.
    law : Law
        Parameters of the rule.
    moment : ndarray, shape (n,) or (1,)
        The moment at hand: of each agent, or common to all.
    grain : float
        Grain of time.
    out : ndarray, shape (m,)
        Receives the totals, in units of the resources.
    """
    for j in range(state.demand.shape[0]):
        out[j] = total_of(state.demand[j], law.increase[j], state.anchor[j], moment, grain)


@formula
def _moment_of(moment: FloatArray, agent: int) -> float:
    return float(moment[0] if moment.shape[0] == 1 else moment[agent])


@kernel
def observe(
    state: State, law: Law, moment: FloatArray, grain: float, demand: FloatArray, average: FloatArray
) -> None:
    """Read demand and average of all agents without changing anything.

    Parameters
    ----------
    state : State
        State of all agents.
    law : Law
        Parameters of the rule.
    moment : ndarray, shape (n,) or (1,)
        The moment at hand: of each agent, or common to all.
    grain : float
        Grain of time.
    demand, average : ndarray, shape (m, n)
        Receive what is read, in units of the resources.
    """
    for j in range(state.demand.shape[0]):
        for i in range(state.demand.shape[1]):
            now = _moment_of(moment, i)
            since = now - state.anchor[j, i]
            held, increase = state.demand[j, i], law.increase[j, i]
            folded = accumulated_at(state.accumulated[j, i], held, increase, since, grain)
            demand[j, i] = demand_at(held, increase, since, grain)
            average[j, i] = time_average(folded, now, grain)


@kernel
def observe_totals(
    state: State, law: Law, moment: FloatArray, grain: float, demand: FloatArray, average: FloatArray
) -> None:
    """Sum demand and average over the agents in index order, for every resource.

    Parameters
    ----------
    state : State
        State of all agents.
    law : Law
        Parameters of the rule.
    moment : ndarray, shape (n,) or (1,)
        The moment at hand: of each agent, or common to all.
    grain : float
        Grain of time.
    demand, average : ndarray, shape (m,)
        Receive the sums, in units of the resources.
    """
    totals(state, law, moment, grain, demand)
    for j in range(state.demand.shape[0]):
        used = 0.0
        for i in range(state.demand.shape[1]):
            now = _moment_of(moment, i)
            since = now - state.anchor[j, i]
            held, increase = state.demand[j, i], law.increase[j, i]
            folded = accumulated_at(state.accumulated[j, i], held, increase, since, grain)
            used += time_average(folded, now, grain)
        average[j] = used
