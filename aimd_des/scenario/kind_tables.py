"""Tables with a kind: made from the signatures of what they describe, so that they cannot lag behind."""

from collections.abc import Callable, Sequence
from functools import cache, reduce
from operator import or_
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, cast, get_args, get_origin

import numpy.typing as npt
from pydantic import Discriminator, Tag, create_model
from pydantic.fields import Field

from aimd_des.scenario.base import Integer, Part
from aimd_des.scenario.kinds import Kind, kinds_of
from aimd_des.scenario.networks import refuse_vast
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["UNKNOWN_KIND", "KindTable", "NetworkSettings", "kind_table", "one_of"]

#: The type of the error where a value is none of the forms, or names no kind.
UNKNOWN_KIND = "unknown_kind"

# Larger networks are built when the run begins: up to here it takes half a second at most.
_BUILT_AT_ONCE = 20_000

# Arrays of other things than floats.
_RECORD = list[bool | Integer] | list[list[bool | Integer]]
_OTHER_ARRAYS: dict[str, Any] = {"lost": _RECORD}

# Forms that are no tables with a kind; no kind is written in parentheses.
_NUMBER, _LIST, _TABLES = "(number)", "(list)", "(tables)"


class KindTable(Part):
    """A table whose key `kind` says what it describes.

    Attributes
    ----------
    of : Kind
        What that is.
    form : str
        The word by which tables of this class are told from others of their group.
    """

    of: ClassVar[Kind]
    form: ClassVar[str]

    def make(self) -> Any:
        """Make the object that the table describes."""
        given = {name: _for_call(self.of, name, value) for name, value in self if name != "kind"}
        if "path" in given:
            _refuse_no_file(given["path"])
        made = self.of.make(**{name: value for name, value in given.items() if name in self.of.own})
        if self.of.then is None:
            return made
        return self.of.then(made, **{name: value for name, value in given.items() if name not in self.of.own})


class NetworkSettings(KindTable):
    """``[channel.network]``: see `aimd_des.topology`."""

    def build_to_check(self) -> None:
        """Refuse, by making it unless it is large, what cannot be made."""
        if self._is_small():
            self.build()

    def build(self) -> Any:
        """Give the network; one that is large is made anew, as it is not to be kept."""
        return super().build() if self._is_small() else self.make()

    def _is_small(self) -> bool:
        return refuse_vast(self.of.name, dict(self)) <= _BUILT_AT_ONCE


def _refuse_no_file(path: str) -> None:
    """Refuse what cannot be read to an end: devices and pipes, besides what is not there."""
    try:
        found = Path(path).is_file()
    except (OSError, ValueError):  # a name that no file can have
        found = False
    if not found:
        raise InputError.of("path", path, "the name of a file that exists")


def _for_call(kind: Kind, name: str, value: Any) -> Any:
    """Make a tuple of a list where that is asked for: nodes of a grid have such names."""
    return tuple(value) if get_origin(kind.signature[name].annotation) is tuple else value


def _as_data(hint: Any) -> Any:
    """Say how a parameter stands in a file."""
    arguments = get_args(hint)
    plain = {int: Integer, Path: str, FloatArray: list[float]}
    if hint == npt.ArrayLike:
        return float | list[float]
    if hint in plain:
        return plain[hint]
    if get_origin(hint) in (Union, UnionType):
        return reduce(or_, dict.fromkeys(map(_as_data, arguments)))
    if get_origin(hint) is Sequence:
        return list[_as_data(arguments[0])]  # type: ignore[misc]  # made while running
    if get_origin(hint) is tuple:
        many = len(arguments)
        return Annotated[list[_as_data(arguments[0])], Field(min_length=many, max_length=many)]  # type: ignore[misc]
    return hint


def _made(kind: Kind, default: str | None) -> type[KindTable]:
    """Make the class of the tables of one kind."""
    saying = Field(kind.name if kind.name == default else ..., description=kind.meaning)
    fields: dict[str, Any] = {"kind": (Literal[kind.name], saying)}
    meanings = {parameter.name: parameter.meaning for parameter in kind.parameters}
    for name, parameter in kind.signature.items():
        hint = _OTHER_ARRAYS.get(name) or _as_data(parameter.annotation)
        required = parameter.default is parameter.empty
        standing = list(parameter.default) if isinstance(parameter.default, tuple) else parameter.default
        fields[name] = (hint, Field(... if required else standing, description=meanings[name]))
    form = f"{kind.name}_file" if "path" in fields else kind.name
    words = f"{form}_{kind.group}".split("_")
    made = create_model(
        "".join(word.capitalize() for word in words),
        __base__=NetworkSettings if kind.group == "network" else KindTable,
        __doc__=kind.meaning,
        __module__=__name__,
        **fields,
    )
    made.of, made.form = kind, form
    return made


@cache
def _tables(group: str, default: str | None) -> tuple[type[KindTable], ...]:
    return tuple(_made(kind, default) for kind in kinds_of(group))


def kind_table(group: str, name: str, default: str | None = None) -> KindTable:
    """Make a table of a kind, with what holds unless it is given."""
    table = next(table for table in _tables(group, default) if table.of.name == name)
    return table.model_validate({"kind": name})


def one_of(group: str, default: str | None = None, *, plain: bool = False, several: bool = False) -> Any:
    """Make the type of a key that holds a table of one of the kinds of a group."""
    tables = _tables(group, default)
    union: Any = reduce(or_, [cast(Any, Annotated[table, Tag(table.form)]) for table in tables])
    choose = _chooser(tables, default)
    kinds = ", ".join(dict.fromkeys(table.of.name for table in tables))
    allowed = f"a table whose kind is one of {kinds}"
    one = Annotated[union, _discriminator(choose, kinds, allowed)]
    if plain:
        union |= Annotated[float, Tag(_NUMBER)] | Annotated[list[float], Tag(_LIST)]
        allowed = f"a number, a list with one for each agent, or {allowed}"
    if several:
        union |= Annotated[list[one], Tag(_TABLES)]
        allowed += ", or a list of such tables"
    return Annotated[union, _discriminator(choose, kinds, allowed)]


class _Context(dict[str, Any]):
    """What an error tells, in words; types that are made of others, such as unions, ask for a hash."""

    def __hash__(self) -> int:  # type: ignore[override]  # it is never changed
        return id(self)


def _discriminator(choose: Callable[[Any], str | None], kinds: str, allowed: str) -> Discriminator:
    return Discriminator(
        choose,
        custom_error_type=UNKNOWN_KIND,
        custom_error_message="must be {allowed}",
        custom_error_context=_Context(kinds=kinds, allowed=allowed),
    )


def _chooser(tables: Sequence[type[KindTable]], default: str | None) -> Callable[[Any], str | None]:
    """Tell forms apart, and kinds; nothing is returned for what is none."""

    def choose(value: Any) -> str | None:
        if isinstance(value, KindTable):
            return value.form
        if isinstance(value, dict):
            kind = value.get("kind", default)
            forms = [table for table in tables if table.of.name == kind]
            if len(forms) > 1:  # with values, and with a file
                forms = [table for table in forms if ("path" in table.model_fields) == ("path" in value)]
            return forms[0].form if forms else None
        if isinstance(value, list):
            return _TABLES if any(isinstance(part, dict) for part in value) else _LIST
        return _NUMBER if isinstance(value, int | float) else None

    return choose
