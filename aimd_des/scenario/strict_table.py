"""What all tables of a scenario share: every key is known, every value has its type, nothing is ignored."""

from collections import OrderedDict
from threading import Lock
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, model_validator

from aimd_des.scenario.kinds import describe
from aimd_des.utils.errors import InputError

#: What TOML promises to hold.
Integer = Annotated[int, Field(ge=-(2**63), lt=2**63), WithJsonSchema({"type": "integer"})]


def described(schema: dict[str, Any], table: type[BaseModel]) -> None:
    """Take descriptions from the docstring: its first paragraph, and what it says about each key."""
    meanings = describe(table.__doc__)
    schema["description"] = " ".join((table.__doc__ or "").strip().partition("\n\n")[0].split())
    for name, part in schema.get("properties", {}).items():
        if name in meanings:
            part["description"] = meanings[name]


class Table(BaseModel):
    """A table of a scenario: every key is known, every value has its type, nothing is ignored."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, json_schema_extra=described)

    def idle(self) -> tuple[str, ...]:
        """Name the keys that have no meaning beside the others.

        Returns
        -------
        tuple of str
            None of them may be given.
        """
        return ()

    @model_validator(mode="after")
    def _nothing_ignored(self) -> Self:
        for name in self.idle():
            if name in self.model_fields_set:
                raise InputError(f"{name}: has no meaning beside the other settings; leave it out")
        return self

    def spoken(self) -> dict[str, Any]:
        """Spell out every key that has a meaning.

        Returns
        -------
        dict
            Ready to be written as TOML.
        """
        idle = self.idle()
        return {name: _spoken(value) for name, value in self if value is not None and name not in idle}


def _spoken(value: Any) -> Any:
    if isinstance(value, Table):
        return value.spoken()
    if isinstance(value, dict):  # TOML has no word for None
        return {key: _spoken(item) for key, item in value.items() if item is not None}
    return [_spoken(item) for item in value] if isinstance(value, list) else value


# A scenario has fewer tables, and a study of many points must not hold what all of them describe.
_MOST_KEPT = 32
_kept: OrderedDict[int, tuple["MadeTable", Any]] = OrderedDict()
_lock = Lock()


class MadeTable(Table):
    """A table that describes an object, and checks itself by making it.

    What was made to check a table is what a run gets: it is frozen, and made once.
    """

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build_to_check()
        return self

    def build_to_check(self) -> None:
        """Refuse, by making it, what cannot be made."""
        self.build()

    def build(self) -> Any:
        """Give the object that the table describes; the latest are kept and need not be made again."""
        with _lock:
            # An entry holds its table, so that no other has that address meanwhile.
            if id(self) in _kept:
                _kept.move_to_end(id(self))
                return _kept[id(self)][1]
        made = self.make()
        with _lock:
            _kept[id(self)] = self, made
            while len(_kept) > _MOST_KEPT:
                _kept.popitem(last=False)
        return made

    def make(self) -> Any:
        """Make the object that the table describes."""
        raise NotImplementedError
