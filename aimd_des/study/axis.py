"""An axis of a study: what varies, and the values that it takes."""

from typing import Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, model_validator

from aimd_des.results.measures import MEASURES
from aimd_des.scenario.error_messages import InSentences
from aimd_des.scenario.old_keys import axis_with_new_keys
from aimd_des.scenario.parameters import as_data
from aimd_des.scenario.strict_table import described
from aimd_des.study.columns import LABELS
from aimd_des.utils import limits, validation
from aimd_des.utils.errors import InputError

Value = bool | int | float | str

#: A position along an axis: how it is called in the column, and the keys of the scenario that it sets.
Setting = tuple[Value, dict[str, Any]]

# Columns hold numbers as doubles, which know all integers up to here.
_LARGEST = 2**53


class StudyTable(InSentences):
    """A table of the file: every key is known, and every value has its type.

    What is outside its range is an `InputError`, whether it was given by name or as data.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, json_schema_extra=described)

    @model_validator(mode="before")
    @classmethod
    def _from_data(cls, data: Any) -> Any:
        """Take arrays and NumPy's numbers for what a file would have."""
        return as_data(data)


class Axis(StudyTable):
    """One of ``[[axes]]``: what varies.

    Attributes
    ----------
    name : str
        The column; default: the key.
    key : str, optional
        The key of the scenario that varies, such as "channel.latency".
    values : list of numbers, of strings or of booleans, optional
        What it is set to; from Python an array, a Series or a range will do.
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
    InputError
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
    def _from_data(cls, data: Any) -> Any:
        """Give the axis the name of its key, and take lists, as TOML has them, for tuples."""
        if not isinstance(data, dict):
            return data
        data = axis_with_new_keys(as_data(data))
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
        limits.text("name", self.name)
        for value, _ in self.settings():
            if isinstance(value, str):
                limits.text(f"value of axis {self.name!r}", value, empty=True)
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
                validation.integer(f"number of {word}", given[2], low=1)
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
