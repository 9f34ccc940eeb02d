"""The interventions of a scenario, made and held against its problem."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from aimd_des.errors import InputError
from aimd_des.interventions import Intervention, check_absences
from aimd_des.problem import Problem
from aimd_des.scenario.generated import KindTable
from aimd_des.scenario.prices import RedrawnPrices

__all__ = ["made_interventions", "under"]


def made_interventions(
    tables: Sequence[KindTable], problem: Problem, model: str, parameters: Mapping[str, Any], seed: int
) -> list[Intervention]:
    """Make what tables describe.

    Parameters
    ----------
    tables : sequence of KindTable
        The tables.
    problem : Problem
        Whose agents and resources they name.
    model : str
        Its model, for prices that are drawn anew.
    parameters : mapping
        Of the model.
    seed : int
        Of the scenario.

    Returns
    -------
    list of Intervention
        In the order of the tables.

    Raises
    ------
    InputError
        If one does not fit the problem, with the key under which it stands.
    """
    interventions: list[Intervention] = []
    for number, table in enumerate(tables):
        with under(".".join(["interventions", str(number), *_subject(table)])):
            made = table.build()
            if isinstance(made, RedrawnPrices):
                made = made.by(model, parameters, seed)
            made.check(problem)
            interventions.append(made)
    with under("interventions"):
        check_absences(problem, interventions)
    return interventions


def _subject(table: KindTable) -> Sequence[str]:
    """Name the key by which an intervention refers to the problem."""
    return [name for name in ("agents", "resource", "parameter") if name in type(table).model_fields][:1]


@contextmanager
def under(key: str) -> Iterator[None]:
    """Say under which key of the scenario something was refused.

    Parameters
    ----------
    key : str
        The dotted key.

    Yields
    ------
    None
        For what may be refused.

    Raises
    ------
    InputError
        The refusal, with the key before it.
    """
    try:
        yield
    except InputError as refusal:
        raise InputError(f"{key}: {refusal}") from None
