"""What an intervention is to a run; what must not be declared together, and what would never begin.

The run asks an intervention for two attributes besides, and does without either: `span`, from when to when
its agents are away, with `agents`; and `begins`, when it first changes something.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Protocol, runtime_checkable

from aimd_des.engine.control_unit import CrossingTable, table_of
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.system import System
from aimd_des.problem.lookup import agent_indices
from aimd_des.problem.problem import Problem
from aimd_des.utils.errors import InputError


@runtime_checkable
class Intervention(Protocol):
    """Anything that is declared and changes a run."""

    def check(self, problem: Problem) -> None:
        """Refuse, before anything runs, what does not fit the problem."""
        ...

    def process(self, system: System) -> ProcessGenerator:
        """Live: the SimPy process of the intervention."""
        ...


def check_absences(problem: Problem, interventions: Iterable[object]) -> None:
    """Refuse absences of one agent that overlap, or follow each other at one instant.

    Parameters
    ----------
    problem : Problem
        The agents that share.
    interventions : iterable of Intervention
        All that are declared, each fit for the problem.

    Raises
    ------
    InputError
        Naming the agent and the two.
    """
    # Otherwise the second absence would be refused in the middle of a run.
    spans: dict[int, list[tuple[float, float, object]]] = {}
    for declared in interventions:
        span = getattr(declared, "span", None)
        if span is not None:
            for agent in agent_indices(problem, declared.agents):  # type: ignore[attr-defined]  # with a span
                spans.setdefault(agent, []).append((*span, declared))
    for agent, absences in spans.items():
        absences.sort(key=lambda absence: absence[:2])
        for (_, end, one), (start, _, other) in pairwise(absences):
            # Also where they touch: whether leaving or coming back is first at one instant would decide.
            if start <= end:
                name = problem.agent_names[agent]
                allowed = f"after {one!r} is over"
                raise InputError.of(
                    f"absence of agent {name}", other, allowed, "let one begin after the other"
                )


def check_hold_offs(interventions: Iterable[object], control_unit: object) -> None:
    """Refuse changes of a hold-off (those with ``of_hold_off``) where the control unit has none."""
    for number, declared in enumerate(interventions):
        if getattr(declared, "of_hold_off", False) and not isinstance(table_of(control_unit), CrossingTable):
            allowed = "left out unless the control unit is a Crossing: others have no hold-off"
            raise InputError.of(
                f"interventions[{number}]", declared, allowed, "choose Crossing(hold_off=...)"
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
    # An intervention that does not say when it begins may begin at once.
    late = [
        number for number, declared in enumerate(interventions) if getattr(declared, "begins", 0.0) >= until
    ]
    if late:
        raise InputError.of(
            ", ".join(f"interventions[{number}]" for number in late),
            [interventions[number] for number in late],
            f"such that they begin before {until:g}, the end of the run",
            "leave them out, or let the run last longer",
        )
