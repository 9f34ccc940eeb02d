"""Capacities that change: at once, in a ramp, or after a profile such as the load of a day."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from aimd_des.channel.csv_columns import read_columns
from aimd_des.engine.planned_changes import Change, Memory, Planned
from aimd_des.engine.system import System
from aimd_des.interventions.bookkeeping import BeginsAt
from aimd_des.interventions.parameters import set_capacity
from aimd_des.problem.lookup import resource_index
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.validation import FloatArray


@built_in("intervention", "capacity_step")
@dataclass(frozen=True)
class CapacityStep(BeginsAt):
    """A capacity changes at one instant.

    Parameters
    ----------
    resource : str or int
        Its name, or j.
    at : float
        When, at least 0.
    capacity : float
        C from then on, greater than 0, in units of the resource.
    """

    resource: str | int
    at: float
    capacity: float

    def __post_init__(self) -> None:
        super().__post_init__()
        clean = validation.number("CapacityStep.capacity", self.capacity, low=0.0, low_open=True)
        object.__setattr__(self, "capacity", clean)

    def check(self, problem: Problem) -> None:
        """Refuse what does not fit a problem."""
        resource_index(problem, self.resource)

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Change the capacity when it is time."""
        j = resource_index(system.problem, self.resource)
        yield self.at, lambda: set_capacity(system, j, self.capacity)


@built_in("intervention", "capacity_ramp")
@dataclass(frozen=True)
class CapacityRamp(Planned):
    """A capacity changes steadily, in equal small steps, from what it is to another one.

    Parameters
    ----------
    resource : str or int
        Its name, or j.
    start, end : float
        From when to when, at least 0 and after that.
    capacity : float
        C at the end and from then on, greater than 0, in units of the resource.
    steps : int
        How many; the first is one step's time after the start, the last at the end.
    """

    resource: str | int
    start: float
    end: float
    capacity: float
    steps: int = 20

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", validation.number("CapacityRamp.start", self.start, low=0.0))
        end = validation.number("CapacityRamp.end", self.end, low=self.start, low_open=True)
        object.__setattr__(self, "end", end)
        clean = validation.number("CapacityRamp.capacity", self.capacity, low=0.0, low_open=True)
        object.__setattr__(self, "capacity", clean)
        validation.integer("CapacityRamp.steps", self.steps, low=1, high=1_000_000)

    @property
    def begins(self) -> float:
        """When it first changes something, in units of time."""
        return self.start

    def check(self, problem: Problem) -> None:
        """Refuse what does not fit a problem."""
        resource_index(problem, self.resource)

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Change the capacity step by step."""
        j = resource_index(system.problem, self.resource)

        def climb(share: float) -> None:
            before = memory["before"]
            set_capacity(system, j, before + share * (self.capacity - before))

        yield self.start, lambda: memory.update(before=float(system.parameters.capacity[j]))
        for step in range(1, self.steps + 1):
            share = step / self.steps
            time = self.end if step == self.steps else self.start + share * (self.end - self.start)
            yield time, partial(climb, share)


@built_in("intervention", "capacity_profile")
@dataclass(frozen=True, eq=False)
class CapacityProfile(Planned):
    """A capacity follows a table of times and values, once or again and again.

    Parameters
    ----------
    resource : str or int
        Its name, or j.
    times : array_like, shape (k,)
        When it changes: ascending, at least 0 and, of a profile that is repeated, less than the period.
    capacities : array_like, shape (k,)
        C from each time to the next, greater than 0, in units of the resource.
    period : float, optional
        After which the profile begins anew, such as a day; default: once only.

    Raises
    ------
    InputError
        If a value is outside its range, or the lengths differ.
    """

    resource: str | int
    times: FloatArray
    capacities: FloatArray
    period: float | None = None

    def __post_init__(self) -> None:
        times = validation.array("CapacityProfile.times", self.times, ("n_times",), low=0.0)
        if not len(times) or (np.diff(times) <= 0.0).any():
            raise InputError.of("CapacityProfile.times", times.tolist(), "one or more, strictly ascending")
        values = validation.array(
            "CapacityProfile.capacities", self.capacities, (len(times),), low=0.0, low_open=True
        )
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "capacities", values)
        if self.period is not None:
            after = float(times[-1])
            remedy = "the period must be longer than the last time of the profile"
            clean = validation.number(
                "CapacityProfile.period", self.period, low=after, low_open=True, remedy=remedy
            )
            object.__setattr__(self, "period", clean)

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        resource: str | int,
        *,
        time: str = "time",
        capacity: str = "capacity",
        period: float | None = None,
    ) -> "CapacityProfile":
        """Read a profile from two columns of a CSV file.

        Parameters
        ----------
        path : str or Path
            The file; its first line holds the names of the columns.
        resource : str or int
            The name of the resource, or j.
        time, capacity : str
            The columns.
        period : float, optional
            After which the profile begins anew, such as a day; default: once only.

        Returns
        -------
        CapacityProfile
            With a row for each row of the file.

        Raises
        ------
        InputError
            If the file cannot be read, a column is missing (naming the nearest one), or a cell holds no
            number (naming its row, counted from 1 below the names).
        """
        times, values = read_columns(path, [time, capacity], float, "a number")
        return cls(resource, np.array(times), np.array(values), period)

    @property
    def begins(self) -> float:
        """When it first changes something, in units of time."""
        return float(self.times[0])

    def check(self, problem: Problem) -> None:
        """Refuse what does not fit a problem."""
        resource_index(problem, self.resource)

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Follow the profile."""
        j = resource_index(system.problem, self.resource)
        for time, capacity in self._rows():
            yield time, partial(set_capacity, system, j, capacity)

    def _rows(self) -> Iterator[tuple[float, float]]:
        rows = list(zip(self.times.tolist(), self.capacities.tolist(), strict=True))
        if self.period is None:
            yield from rows
            return
        for cycle in count():
            for time, capacity in rows:
                yield cycle * self.period + time, capacity


built_in("intervention", "capacity_profile")(CapacityProfile.from_csv)
