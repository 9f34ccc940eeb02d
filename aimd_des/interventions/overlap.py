"""What must not be declared together."""

from collections.abc import Iterable
from itertools import pairwise

from aimd_des.errors import InputError
from aimd_des.interventions.agents import Absence, Crash, Join
from aimd_des.interventions.names import agent_indices
from aimd_des.problem import Problem

__all__ = ["check_absences"]


def check_absences(problem: Problem, interventions: Iterable[object]) -> None:
    """Refuse absences of one agent that overlap, or follow each other at one instant.

    Parameters
    ----------
    problem : Problem
        Who shares.
    interventions : iterable of Intervention
        All that are declared, each fit for the problem.

    Raises
    ------
    InputError
        Naming the agent and the two.
    """
    spans: dict[int, list[tuple[float, float, object]]] = {}
    for declared in interventions:
        if isinstance(declared, Join | Absence | Crash):
            start, end = declared.span
            for agent in agent_indices(problem, declared.agents):
                spans.setdefault(agent, []).append((start, end, declared))
    for agent, absences in spans.items():
        absences.sort(key=lambda absence: absence[:2])
        for (_, end, one), (start, _, other) in pairwise(absences):
            if start <= end:
                name = problem.agent_names[agent]
                allowed = f"after {one!r} is over"
                raise InputError.of(
                    f"absence of agent {name}", other, allowed, "let one begin after the other"
                )
