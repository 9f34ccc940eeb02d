"""Tables with a kind: made from the signatures of what they describe, so that they cannot lag behind.

A group is open: the class of its tables reads the kind, and finds the class that checks all other keys, among
those of the framework or, where the kind is module and class, in the registry.
"""

import inspect
import re
from collections.abc import Mapping, Sequence
from functools import cache, reduce
from operator import or_
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, cast, get_args, get_origin

import numpy as np
import numpy.typing as npt
from pydantic import Discriminator, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag, create_model
from pydantic.fields import Field
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

from aimd_des.scenario.kinds import Kind, kind_of, kinds, our_kinds
from aimd_des.scenario.networks import refuse_vast
from aimd_des.scenario.parameters import as_data
from aimd_des.scenario.strict_table import Integer, MadeTable, Table
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import ARRAY_LIKE

#: The type of the error where a value is none of the forms, or names no kind.
UNKNOWN_KIND = "unknown_kind"

# Larger networks are built when the run begins: up to here it takes half a second at most.
_BUILT_AT_ONCE = 20_000

# Arrays of truth values, and those of which only the part itself knows how many axes they have.
_RECORD = list[bool | Integer] | list[list[bool | Integer]]
_NUMBERS = float | list[float] | list[list[float]] | list[list[list[float]]] | list[list[list[list[float]]]]
_ARRAYS: dict[tuple[str, str], Any] = {("trace", "lost"): _RECORD}

# Forms that are no tables with a kind.
_NUMBER, _LIST, _TABLE, _TABLES = "(number)", "(list)", "(table)", "(tables)"

# What holds where a table of a group names no kind.
_DEFAULTS = {"control_unit": "sampled", "costs": "polynomial"}

# Objects that a parameter may be, and the tables by which they stand in a file.
_NESTED: dict[Any, type[MadeTable]] = {}

# Modules of the user's own are named with dots: nothing is known of what they have before they are read.
_OWN = {"type": "object", "properties": {"kind": {"type": "string", "pattern": r"\."}}, "required": ["kind"]}


class KindTable(MadeTable):
    """A table whose key `kind` says what it describes.

    Attributes
    ----------
    group : str
        What all tables of the class describe.
    of : Kind
        What a table describes, where that is one and the same.
    """

    group: ClassVar[str]
    of: ClassVar[Kind]

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        if "of" in vars(cls) or "group" not in vars(cls):
            return handler(source)
        return core_schema.no_info_plain_validator_function(cls.read)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        if schema["type"] != "function-plain":
            return handler(schema)
        tables = [_table(cls, kind) for kind in kinds(cls.group)]
        forms = [handler(table.__pydantic_core_schema__) for table in tables]
        return {"oneOf": [*forms, _OWN]}

    @classmethod
    def read(cls, value: Any) -> "KindTable":
        """Take in a table of this group, or data with a kind of it."""
        if isinstance(value, KindTable) and value.group == cls.group:
            return value
        return cls.choose(value).model_validate(value)

    @classmethod
    def choose(cls, value: Any) -> "type[KindTable]":
        """Find the class for data with a kind."""
        name = value.get("kind", _DEFAULTS.get(cls.group)) if isinstance(value, Mapping) else None
        if isinstance(name, str) and "." in name:
            try:
                return _table(cls, kind_of(cls.group, name))
            except InputError as error:
                raise PydanticCustomError(UNKNOWN_KIND, "{refusal}", {"refusal": str(error)}) from error
        tables = [_table(cls, kind) for kind in our_kinds(cls.group) if kind.name == name]
        if len(tables) > 1:  # with values, and with a file
            tables = [table for table in tables if ("path" in table.model_fields) == ("path" in value)]
        if not tables:
            words = {"kinds": _names(cls.group), "allowed": _allowed(cls.group)}
            raise PydanticCustomError(UNKNOWN_KIND, "must be {allowed}", words)
        return tables[0]

    def make(self) -> Any:
        """Make the object that the table describes."""
        given = {name: _for_call(self.of, name, value) for name, value in self if name != "kind"}
        if "path" in given:
            _refuse_no_file(given["path"])
        return self.of.make(**given)


def _names(group: str) -> str:
    return ", ".join(dict.fromkeys(kind.name for kind in our_kinds(group)))


def _allowed(group: str) -> str:
    return f"a table whose kind is one of {_names(group)}"


class NetworkSettings(KindTable):
    """``[channel.network]``: see `aimd_des.topology`."""

    group = "network"

    def build_to_check(self) -> None:
        """Refuse, by making it unless it is large, what cannot be made."""
        if self._is_small():
            self.build()

    def build(self) -> Any:
        """Give the network; one that is large is made anew, as it is not to be kept."""
        return super().build() if self._is_small() else self.make()

    def _is_small(self) -> bool:
        return self.of.is_own or refuse_vast(self.of.name, dict(self)) <= _BUILT_AT_ONCE


def _refuse_no_file(path: str) -> None:
    """Refuse what cannot be read to an end: devices and pipes, besides what is not there."""
    try:
        found = Path(path).is_file()
    except (OSError, ValueError):  # a name that no file can have
        found = False
    if not found:
        raise InputError.of("path", path, "the name of a file that exists")


def stands_as(kind: Any, table: type[MadeTable]) -> None:
    """Let a parameter that is such an object stand in a file as a table, which makes it."""
    _NESTED[kind] = table


def _for_call(kind: Kind, name: str, value: Any) -> Any:
    """Make a tuple or an array of a list where that is asked for: nodes of a grid have such names."""
    hint = kind.signature[name].annotation
    if isinstance(value, MadeTable):
        return value.build()
    if not isinstance(value, list):
        return value
    if kind.is_own and np.ndarray in (hint, get_origin(hint)):
        return validation.array(name, value, ("...",) * validation.axes(value))
    return tuple(value) if tuple in (hint, get_origin(hint)) else value


def _as_data(hint: Any, kind: Kind) -> Any:
    """Say how a parameter stands in a file."""
    if hint == ARRAY_LIKE[1]:
        return _as_data(npt.ArrayLike, kind) | None
    origin, arguments = get_origin(hint), get_args(hint)
    if np.ndarray in (hint, origin) or hint == npt.ArrayLike:
        ours = float | list[float] if hint == npt.ArrayLike else list[float]
        if kind.group == "costs" and hint == npt.ArrayLike:
            ours = _NUMBERS
        return _NUMBERS | _RECORD if kind.is_own else ours
    inner = [
        _as_data(argument, kind) for argument in arguments if argument is not ... and origin is not Literal
    ]
    many = None if origin is not tuple or ... in arguments else len(arguments)
    if origin in (Union, UnionType):
        return reduce(or_, dict.fromkeys(inner))
    if origin in (list, Sequence, tuple):
        elements: Any = list[reduce(or_, inner[:many])]  # type: ignore[misc]  # made while running
        return elements if many is None else Annotated[elements, Field(min_length=many, max_length=many)]
    if origin in (dict, Mapping):
        return dict[inner[0], inner[1]]  # type: ignore[valid-type]
    plain = {int: Integer, Path: str, inspect.Parameter.empty: Any, tuple: list[Any], **_NESTED}
    return plain.get(hint, hint)


@cache
def _table(group: type[KindTable], kind: Kind) -> type[KindTable]:
    """Make the class of the tables of one kind."""
    default = kind.name if kind.name == _DEFAULTS.get(kind.group) else ...
    fields: dict[str, Any] = {"kind": (Literal[kind.name], Field(default, description=kind.meaning))}
    meanings = {parameter.name: parameter.meaning for parameter in kind.parameters}
    for name, parameter in kind.signature.items():
        standing = ... if parameter.default is parameter.empty else as_data(parameter.default)
        hint = _ARRAYS.get((kind.name, name)) or _as_data(parameter.annotation, kind)
        fields[name] = (hint, Field(standing, description=meanings[name]))
    words = re.split(r"[_.]", f"{kind.name}_{'file_' if 'path' in fields else ''}{kind.group}")
    return create_model(
        "".join(word[:1].upper() + word[1:] for word in words),
        __base__=group,
        __doc__=kind.meaning,
        __module__=__name__,
        of=(ClassVar[Kind], kind),
        **fields,
    )


@cache
def _of_group(group: str) -> type[KindTable]:
    """Make the class that reads the tables of one group."""
    if group == NetworkSettings.group:
        return NetworkSettings
    name = "".join(word.capitalize() for word in group.split("_"))
    return create_model(f"{name}Table", __base__=KindTable, __module__=__name__, group=(ClassVar[str], group))


def kind_table(group: str, name: str) -> KindTable:
    """Make a table of a kind, with what holds unless it is given."""
    return _of_group(group).read({"kind": name})


def one_of(group: str, *, plain: bool = False, several: bool = False) -> Any:
    """Make the type of a key that holds a table of one of the kinds of a group."""
    table: Any = _of_group(group)
    if not plain:
        return table
    forms = {_TABLE: table, _NUMBER: float, _LIST: list[float], **({_TABLES: list[table]} if several else {})}
    union = reduce(or_, [cast(Any, Annotated[form, Tag(tag)]) for tag, form in forms.items()])
    allowed = f"a number, a list with one for each agent, or {_allowed(group)}"
    allowed += ", or a list of such tables" if several else ""
    refusal: dict[str, int | str | float] = {"kinds": _names(group), "allowed": allowed}
    return Annotated[
        union,
        Discriminator(
            _form,
            custom_error_type=UNKNOWN_KIND,
            custom_error_message="must be {allowed}",
            custom_error_context=refusal,
        ),
    ]


def own_parts(value: Any) -> dict[str, Any]:
    """Find the classes and functions of the user's own that tables name, by their names."""
    inner = value if isinstance(value, list) else []
    if isinstance(value, Table):
        inner = [part for _, part in value]
    found = {name: make for part in inner for name, make in own_parts(part).items()}
    if isinstance(value, KindTable) and value.of.is_own:
        found[value.of.name] = value.of.of.make
    return found


def _form(value: Any) -> str | None:
    """Tell numbers, lists and tables apart; nothing is returned for what is none."""
    if isinstance(value, KindTable | Mapping):
        return _TABLE
    if isinstance(value, list):
        return _TABLES if any(isinstance(part, Mapping | KindTable) for part in value) else _LIST
    return _NUMBER if isinstance(value, int | float) else None
