"""From the tables of a scenario to the problem, and to what refers to it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from aimd_des.interventions import Intervention, check_absences
from aimd_des.problem.problem import Problem
from aimd_des.scenario.kind_tables import KindTable
from aimd_des.scenario.models import made_by, model_parameters
from aimd_des.scenario.prices import RedrawnPrices
from aimd_des.scenario.tables import ResourceChange
from aimd_des.utils import returned_values
from aimd_des.utils.errors import InputError


@contextmanager
def under(key: str) -> Iterator[None]:
    """Say under which key of the scenario something was refused."""
    try:
        yield
    except InputError as refusal:
        raise InputError(f"{key}: {refusal}") from None


def built_by(model: str, parameters: dict[str, Any], seed: int) -> Problem:
    """Let a model make the problem."""
    return made_by(model, model_parameters(model, parameters, seed))


def with_resources(problem: Problem, changes: Mapping[str, ResourceChange]) -> Problem:
    """Put what a scenario says of resources over what the model has made."""
    resources = list(problem.resources)
    for number, change in changes.items():
        if number not in map(str, range(len(resources))):
            names = ", ".join(f"{place} ({one.name})" for place, one in enumerate(resources))
            raise InputError.of("number of a resource", number, f"one of those of the model: {names}")
        with under(f"resources.{number}"):
            resources[int(number)] = change.of(resources[int(number)])
    return Problem(resources, problem.costs, agent_names=problem.agent_names)


def changes_of(
    tables: Sequence[KindTable], problem: Problem, model: str | None, parameters: dict[str, Any], seed: int
) -> list[Intervention]:
    """Make the interventions, and hold them against the problem."""
    made = []
    for number, table in enumerate(tables):
        subject = next(key for key in ("agents", "resource", "parameter", "kind") if hasattr(table, key))
        with under(f"interventions.{number}.{subject}"):
            change = table.build()
            if isinstance(change, RedrawnPrices):
                change = change.by(str(model), parameters, seed)
            returned_values.check(change, problem)
            made.append(change)
    with under("interventions"):
        check_absences(problem, made)
    return made
