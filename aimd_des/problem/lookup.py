"""Agents and resources by name or by index, as readings, interventions and processes are given them."""

from collections.abc import Sequence
from typing import Any

from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

#: One agent or several, by name or by index.
Agents = str | int | Sequence[str | int]


def _index(field: str, names: Sequence[str], given: object) -> int:
    """Find one of the names, or take an index for what it is."""
    if type(given) is int and 0 <= given < len(names):
        return given  # at once: a process that reads totals asks for nothing else
    if not isinstance(given, str):
        return validation.integer(field, given, low=0, high=len(names) - 1)
    few = len(names) <= 12
    allowed = "" if few else f"one of {len(names)} names, {names[0]} to {names[-1]}"
    validation.known(field, given, names, allowed)
    return names.index(given)


def resource_index(problem: Problem, resource: str | int) -> int:
    """Find a resource."""
    if type(resource) is int and 0 <= resource < problem.n_resources:
        return resource  # without the names: every look at a total asks for it
    return _index("resource", problem.resource_names, resource)


def agent_index(problem: Problem, agent: str | int) -> int:
    """Find an agent."""
    if type(agent) is int and 0 <= agent < problem.n_agents:
        return agent  # without the names, which need not have been made
    return _index("agent", problem.agent_names, agent)


def agent_indices(problem: Problem, agents: Agents) -> list[int]:
    """Find agents.

    Parameters
    ----------
    problem : Problem
        Whose agents they are.
    agents : str, int, or sequence of str or int
        Names or indices.

    Returns
    -------
    list of int
        Their indices, in the order given.

    Raises
    ------
    InputError
        If there is no such agent, none at all, or one twice.
    """
    # One that is no list is looked up, or refused, as one agent.
    given: list[Any] = list(agents) if validation.axes(agents) else [agents]  # type: ignore[arg-type]  # it has elements
    found = [agent_index(problem, agent) for agent in given]
    if not found or len(set(found)) != len(found):
        raise InputError.of("agents", given, "one agent or several different ones")
    return found
