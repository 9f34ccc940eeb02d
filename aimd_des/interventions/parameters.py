"""Capacities, thresholds and the parameters of the agents' rule, changed while a run goes on.

Functions of the system as those of `actions`.  Only they can write into the arrays of `system.parameters`, so
that agents that are processes and a fleet obey alike, and the log tells of it.
"""

from collections.abc import Sequence

from aimd_des.engine.conditions import growth_of
from aimd_des.engine.system import System
from aimd_des.interventions.bookkeeping import begin_piece, end_piece, note
from aimd_des.problem.lookup import Agents, agent_indices, resource_index
from aimd_des.results.event_log import Entry
from aimd_des.utils import validation
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.locked_arrays import locked, put


def set_capacity(system: System, resource: str | int, capacity: float) -> None:
    """Change the capacity of a resource, and its threshold in proportion.

    Parameters
    ----------
    system : System
        The run in progress.
    resource : str or int
        Its name, or j.
    capacity : float
        C > 0, in units of the resource.

    Raises
    ------
    InputError
        If there is no such resource.
    """
    j = resource_index(system.problem, resource)
    value = validation.number("capacity", capacity, low=0.0, low_open=True)
    end_piece(system)
    lower = value < system.parameters.capacity[j]
    put(system.parameters.capacity, j, value)
    put(system.parameters.limit, j, system.conditions.threshold[j] * value)
    _conclude(system, Entry.CAPACITY, j, value)
    if lower:
        system.tighten(j)


@described_like(set_capacity)
def set_threshold(system: System, resource: str | int, threshold: float) -> None:
    """Change the share of a capacity above which a signal is due.

    Parameters
    ----------
    threshold : float
        gamma, greater than 0 and at most 1.
    """
    j = resource_index(system.problem, resource)
    value = validation.number("threshold", threshold, low=0.0, low_open=True, high=1.0)
    end_piece(system)
    lower = value < system.conditions.threshold[j]
    put(system.conditions.threshold, j, value)
    put(system.parameters.limit, j, value * system.parameters.capacity[j])
    _conclude(system, Entry.THRESHOLD, j, value)
    if lower:
        system.tighten(j)


@described_like(set_capacity)
def set_normalization(system: System, resource: str | int, normalization: float) -> None:
    """Change the normalization factor of a resource.

    Parameters
    ----------
    normalization : float
        Gamma > 0.
    """
    j = resource_index(system.problem, resource)
    value = validation.number("normalization", normalization, low=0.0, low_open=True)
    end_piece(system)
    put(system.parameters.normalization, j, value)
    _conclude(system, Entry.NORMALIZATION, j, value)


@described_like(set_capacity)
def set_increase(system: System, agents: Agents, resource: str | int, increase: float) -> None:
    """Change how fast agents grow; of those that are away, from when they are back.

    Parameters
    ----------
    agents : str, int or sequence of these
        Whose: names, or i.
    increase : float
        alpha > 0, in units of the resource per tick or per unit of time.

    Raises
    ------
    InputError
        If there is no such agent or resource, or one agent is named twice.
    """
    j, indices = resource_index(system.problem, resource), agent_indices(system.problem, agents)
    value = validation.number("increase", increase, low=0.0, low_open=True)
    conditions = system.conditions
    end_piece(system)
    growing = conditions.increase.copy()
    growing[j, indices] = value
    conditions.increase = locked(growing)
    for i in indices:
        if not conditions.away[i]:
            # Growth up to now is that of before.
            system.break_line(i, j, system.demand(i, j))
            put(system.parameters.increase, (j, i), value)
    put(conditions.growth, slice(None), growth_of(system.parameters.increase))
    _conclude(system, Entry.INCREASE, j, value, indices)
    system.tighten(j)


@described_like(set_increase)
def set_decrease(system: System, agents: Agents, resource: str | int, decrease: float) -> None:
    """Change what responses of agents multiply their demand by.

    Parameters
    ----------
    decrease : float
        beta, at least 0 and less than 1.
    """
    j, indices = resource_index(system.problem, resource), agent_indices(system.problem, agents)
    value = validation.number("decrease", decrease, low=0.0, high=1.0, high_open=True)
    end_piece(system)
    put(system.parameters.decrease, (j, indices), value)
    _conclude(system, Entry.DECREASE, j, value, indices)


def _conclude(
    system: System, entry: Entry, resource: int, value: float, agents: Sequence[int] = (-1,)
) -> None:
    """Tell of a change, and begin a piece with it."""
    for tell in system.conditions.on_parameters:
        tell()
    for agent in agents:
        note(system, entry, resource, agent, value)
    begin_piece(system)
