"""A study as data: a base scenario, the axes along which it varies, and how often each point is repeated."""

from typing import Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from aimd_des import checks
from aimd_des.errors import InputError
from aimd_des.scenario.base import described
from aimd_des.scenario.keys import split_key
from aimd_des.study.columns import LABELS, MEASURES, known_frame, known_measure
from aimd_des.study.where import Condition

__all__ = ["Axis", "Precision", "Setting", "Study", "Value"]

Value = bool | int | float | str

#: A position along an axis: how it is called in the column, and the keys of the scenario that it sets.
Setting = tuple[Value, dict[str, Any]]

# Columns hold numbers as doubles, which know all integers up to here.
_LARGEST = 2**53


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, json_schema_extra=described)


class Axis(_Table):
    """One of ``[[axes]]``: what varies.

    Attributes
    ----------
    name : str
        The column; the key unless given.
    key : str, optional
        The key of the scenario that varies, such as "channel.latency".
    values : list of numbers, of strings or of booleans, optional
        What it is set to.
    linspace : [first, last, number], optional
        As many numbers with equal distances, rounded to twelve digits; integers where all are whole.
    logspace : [first, last, number], optional
        Powers of ten with such exponents.
    cases : dict of dict, optional
        In place of a key: several keys of the scenario, and their values, by the name of the case.
    zip : str, optional
        Axes with the same word here vary together.

    Raises
    ------
    pydantic.ValidationError
        If not exactly one of the forms is given, or the values are not all different and of one kind.
    """

    name: str = ""
    key: str | None = None
    values: list[Value] | None = None
    linspace: tuple[float, float, int] | None = None
    logspace: tuple[float, float, int] | None = None
    cases: dict[str, dict[str, Any]] | None = None
    zip: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: Any) -> Any:
        """Give the axis the name of its key, and take lists, as TOML has them, for tuples."""
        if not isinstance(data, dict):
            return data
        ranges = {
            word: tuple(data[word])
            for word in ("linspace", "logspace")
            if isinstance(data.get(word), list) and len(data[word]) == 3
        }
        name = {"name": data["key"]} if "name" not in data and isinstance(data.get("key"), str) else {}
        return {**data, **ranges, **name}

    @model_validator(mode="after")
    def _check(self) -> Self:
        forms = [
            word for word in ("values", "linspace", "logspace", "cases") if getattr(self, word) is not None
        ]
        if len(forms) != 1:
            raise InputError.of(
                f"axis {self.name!r} has", forms, "exactly one of values, linspace, logspace and cases"
            )
        if (self.key is None) == (self.cases is None):
            reason = (
                "given with values, linspace and logspace, and left out with cases, which name their keys"
            )
            raise InputError.of("key", self.key, reason)
        if not self.name:
            raise InputError.of("name", self.name, "given: it is the column of the cases")
        if self.key == "seed" or any("seed" in case for case in (self.cases or {}).values()):
            raise InputError.of(
                "key",
                "seed",
                "another key",
                "seeds come from the study: see its seed, replications and paired",
            )
        if self.name in (*LABELS, *MEASURES):
            raise InputError.of("name", self.name, "another word: it is a column of every study")
        for word in ("linspace", "logspace"):
            if (given := getattr(self, word)) is not None:
                checks.integer(f"number of {word}", given[2], low=1)
        self._check_values()
        return self

    def _check_values(self) -> None:
        values = [value for value, _ in self.settings()]
        if not values:
            raise InputError.of(f"axis {self.name!r}", values, "one value or more")
        kinds = {self.kind(value) for value in values}
        if len(kinds) > 1:
            remedy = "give values of several kinds as cases"
            raise InputError.of(f"values of axis {self.name!r}", values, "of one kind", remedy)
        if "number" in kinds and not all(
            abs(value) <= _LARGEST for value in values if not isinstance(value, str)
        ):
            raise InputError.of(f"values of axis {self.name!r}", values, "finite numbers, at most 2**53")
        if len(set(values)) < len(values):
            raise InputError.of(f"values of axis {self.name!r}", values, "different from each other")

    @staticmethod
    def kind(value: Value) -> Literal["boolean", "number", "string"]:
        """Tell what a value is.

        Parameters
        ----------
        value : bool, int, float or str
            One of the axis.

        Returns
        -------
        {"boolean", "number", "string"}
            The kind of the column.
        """
        if isinstance(value, bool):
            return "boolean"
        return "string" if isinstance(value, str) else "number"

    def settings(self) -> list[Setting]:
        """List the positions along the axis.

        Returns
        -------
        list of (value, dict)
            What the column holds, and the keys of the scenario with their values.
        """
        if self.cases is not None:
            return list(self.cases.items())
        assert self.key is not None  # noqa: S101 - _check saw to it
        if self.values is not None:
            values = self.values
        else:
            first, last, number = self.linspace or self.logspace or (0.0, 0.0, 0)
            spread = np.linspace(first, last, number) if self.linspace else np.logspace(first, last, number)
            values = _rounded(spread.tolist())
        return [(value, {self.key: value}) for value in values]


def _rounded(values: list[float]) -> list[Value]:
    """Write 0.3 for 0.30000000000000004; integers where all are whole, for keys that take no others."""
    clean = [float(f"{value:.12g}") for value in values]
    whole = all(value.is_integer() and abs(value) <= _LARGEST for value in clean)
    return [int(value) for value in clean] if whole else [*clean]


class Precision(_Table):
    """``[precision]``: replications are added at each point until its mean is known well enough.

    Attributes
    ----------
    measure : str
        A column of the summary.
    resource : str
        Of which resource; "all" for each of them.
    half_width : float
        Of the confidence interval of the mean, in the unit of the measure.
    confidence : float
        Of the interval.
    at_most : int
        Replications of a point, whatever the interval.

    Raises
    ------
    pydantic.ValidationError
        If a value is outside its range.
    """

    measure: str
    resource: str = "all"
    half_width: float
    confidence: float = 0.95
    at_most: int

    @model_validator(mode="after")
    def _check(self) -> Self:
        known_measure("precision.measure", self.measure)
        checks.number("half_width", self.half_width, low=0.0, low_open=True)
        checks.number("confidence", self.confidence, low=0.0, high=1.0, low_open=True, high_open=True)
        checks.integer("at_most", self.at_most, low=2)
        return self


class Study(_Table):
    """Many runs as data.

    Attributes
    ----------
    title : str
        What the study is about, for people.
    replications : int
        Runs of each point, at least; they differ in their seeds.
    seed : int
        Decides the seeds of all runs, at least 0.
    paired : bool
        Whether replication r has the same seed at every point, so that differences between points are paired.
    measures : list of str, optional
        The columns of the summary to keep; all unless given.
    keep : list of str
        Frames of the results to keep besides.
    where : str, optional
        A condition over the names of the axes; points that do not fulfil it are left out.
    precision : Precision, optional
        Adds replications until means are known well enough.
    scenario : dict
        The base scenario, as a scenario file has it.  Unless it says otherwise agents run as a fleet, and
        only what is kept is recorded.
    axes : list of Axis
        What varies.

    Raises
    ------
    pydantic.ValidationError
        If anything is unknown, of a wrong type or outside its range.
    """

    title: str = ""
    replications: int = 1
    seed: int = 0
    paired: bool = True
    measures: list[str] | None = None
    keep: list[str] = Field(default_factory=list)
    where: str | None = None
    precision: Precision | None = None
    scenario: dict[str, Any]
    axes: list[Axis] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check(self) -> Self:
        checks.integer("replications", self.replications, low=1)
        checks.integer("seed", self.seed, low=0)
        for place, name in enumerate(self.measures or []):
            known_measure(f"measures[{place}]", name)
        for place, name in enumerate(self.keep):
            known_frame(f"keep[{place}]", name)
        for word in ("measures", "keep"):
            given = getattr(self, word) or []
            if len(set(given)) < len(given):
                raise InputError.of(word, given, "different from each other")
        if self.measures == []:
            raise InputError.of("measures", [], "one or more", "leave it out to keep all")
        self._check_precision()
        if "seed" in self.scenario:
            raise InputError("scenario.seed: has no meaning in a study, whose own seed decides; leave it out")
        self._check_axes()
        return self

    def _check_precision(self) -> None:
        if self.precision is None:
            return
        if not 2 <= self.replications <= self.precision.at_most:
            allowed = f"from 2 to precision.at_most = {self.precision.at_most}"
            raise InputError.of("replications", self.replications, allowed)
        if self.precision.measure not in self.columns():
            raise InputError.of(
                "precision.measure", self.precision.measure, "one of the measures that are kept"
            )

    def _check_axes(self) -> None:
        names = [axis.name for axis in self.axes]
        if len(set(names)) < len(names):
            raise InputError.of("names of the axes", names, "different from each other")
        set_by: list[tuple[str, tuple[str, ...]]] = []
        for axis in self.axes:
            keys = dict.fromkeys(key for _, setting in axis.settings() for key in setting)
            for parts in map(split_key, keys):
                for other, earlier in set_by:
                    if other != axis.name and parts[: len(earlier)] == earlier[: len(parts)]:
                        allowed = f"set by one axis only; {other!r} sets {'.'.join(earlier)!r}"
                        raise InputError.of(f"key of axis {axis.name!r}", ".".join(parts), allowed)
                set_by.append((axis.name, parts))
        if self.where is not None:
            Condition(self.where, names)
        for word in {axis.zip for axis in self.axes if axis.zip is not None}:
            lengths = {axis.name: len(axis.settings()) for axis in self.axes if axis.zip == word}
            if len(lengths) == 1:
                raise InputError.of("zip", word, "the same word at two axes or more, which vary together")
            if len(set(lengths.values())) > 1:
                raise InputError.of(f"numbers of values of the axes with zip = {word!r}", lengths, "equal")

    def columns(self) -> tuple[str, ...]:
        """Name the measures that are kept.

        Returns
        -------
        tuple of str
            Columns of the summary, in its order.
        """
        return tuple(name for name in MEASURES if self.measures is None or name in self.measures)

    def spoken(self) -> dict[str, Any]:
        """Spell out everything, for TOML and JSON.

        Returns
        -------
        dict
            An equal study can be made of it.
        """
        return self.model_dump(exclude_none=True)
