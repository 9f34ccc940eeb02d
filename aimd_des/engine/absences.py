"""What must not be declared together, and what would never begin."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

from aimd_des.utils.errors import InputError
from aimd_des.interventions.agents import (Absence, Crash, Join, Prices, UnusualActivity)
from aimd_des.interventions.capacity import CapacityProfile, CapacityRamp, CapacityStep
from aimd_des.interventions.faults import Failover, Partition
from aimd_des.problem.lookup import agent_indices
from aimd_des.problem.problem import Problem

__all__ = ["check_absences", "check_end"]


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


def check_end(interventions: Sequence[object], until: float) -> None:
    """Refuse what would begin when the run is over: it is declared, and nothing of it would be seen.

    Parameters
    ----------
    interventions : sequence of Intervention
        All that are declared; when those of the user's own begin is not known.
    until : float
        The end of the run.

    Raises
    ------
    InputError
        Naming all of them.
    """
    late = [number for number, declared in enumerate(interventions) if _begins(declared) >= until]
    if late:
        raise InputError.of(
            ", ".join(f"interventions[{number}]" for number in late),
            [interventions[number] for number in late],
            f"such that they begin before {until:g}, the end of the run",
            "leave them out, or let the run last longer",
        )


def _begins(declared: object) -> float:
    """Return when an intervention first changes something; those who join are away from the start."""
    if isinstance(declared, CapacityStep | Absence | Crash | UnusualActivity | Failover | Partition):
        return declared.at
    if isinstance(declared, CapacityRamp):
        return declared.start
    if isinstance(declared, CapacityProfile):
        return float(declared.times[0])
    return declared.every if isinstance(declared, Prices) else 0.0
