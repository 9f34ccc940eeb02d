"""What pydantic refuses, in sentences that name the key, what is allowed and the nearest known word."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from aimd_des.scenario.kind_tables import UNKNOWN_KIND, KindTable
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

_Form = TypeVar("_Form", bound=BaseModel)

#: A key of the scenario, part by part.
Place = tuple[str | int, ...]

# How pydantic begins what we end after "must be".
_MUST_BE = "Input should be "

# What pydantic says of that names classes and types of Python.
_NO_TABLE = {"dict_type", "model_type"}

# More is not read.
_MOST_SENTENCES = 20


class InSentences(BaseModel):
    """A table that refuses what pydantic does in sentences, whether it is given by name or as data."""

    model_config = ConfigDict(frozen=True)

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as refusal:
            raise refused(type(self), refusal, data) from None

    # A table in another one is made as pydantic makes it, so that errors keep their place.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """Make a table of data, as pydantic does.

        Parameters
        ----------
        obj : dict
            Tables and lists.
        **options
            Of pydantic.

        Returns
        -------
        Self
            Checked.

        Raises
        ------
        InputError
            If anything is unknown, of a wrong type or outside its range.
        """
        try:
            return super().model_validate(obj, **options)
        except ValidationError as refusal:
            raise refused(cls, refusal, obj) from None


def checked(
    form: type[_Form], data: Mapping[str, Any], source: str, lines: Mapping[Place, int] | None = None
) -> _Form:
    """Make a table of data, or say what is wrong with them: see `validate_scenario`."""
    data = with_new_keys(data, source)
    try:
        return TypeAdapter(form).validate_python(data)
    except ValidationError as refusal:
        raise refused(form, refusal, data, source, lines) from None


def refused(
    form: type[BaseModel],
    refusal: ValidationError,
    data: Mapping[str, Any],
    source: str = "",
    lines: Mapping[Place, int] | None = None,
) -> InputError:
    """Say in our own words what pydantic has refused."""
    found = list(_by_place(refusal.errors(include_url=False), data))
    known = {} if lines is None else lines
    sentences = []
    for place, details in found[:_MOST_SENTENCES]:
        line = next((known[place[:end]] for end in range(len(place), 0, -1) if place[:end] in known), None)
        where = source if line is None else f"{source}:{line}"
        sentences.append(f"{where}: {_sentence(form, place, details, data)}".removeprefix(": "))
    if len(found) > _MOST_SENTENCES:
        sentences.append(
            f"{source}: and {len(found) - _MOST_SENTENCES} keys more are refused".removeprefix(": ")
        )
    return InputError("\n".join(dict.fromkeys(sentences)))


def _by_place(
    errors: Sequence[ErrorDetails], data: Mapping[str, Any]
) -> Iterator[tuple[Place, list[ErrorDetails]]]:
    """Gather errors by key.

    Where a value may have several forms, each of them complains: what is nearest to the cause is kept, and
    what is said about one and the same value is said at once.
    """
    gathered: dict[Place, list[ErrorDetails]] = {}
    for error in errors:
        gathered.setdefault(_place(error, data), []).append(error)
    above = {place[:end] for place in gathered for end in range(len(place))}
    for place, details in gathered.items():
        of_a_form = all(len(error["loc"]) > len(place) for error in details)
        if not (place in above and of_a_form):
            yield place, details


def _place(error: ErrorDetails, data: Any) -> Place:
    """Find the key that is meant: pydantic puts the names of forms in between."""
    place: list[str | int] = []
    here = data
    for number, part in enumerate(error["loc"], start=1):
        in_a_list = isinstance(here, list) and isinstance(part, int) and part < len(here)
        if in_a_list or (isinstance(here, Mapping) and part in here):
            here = here[part]
        elif error["type"] != "missing" or number < len(error["loc"]):
            continue
        place.append(part)
    if error["type"] == UNKNOWN_KIND and isinstance(here, Mapping) and "kind" in here:
        place.append("kind")
    return tuple(place)


def _sentence(
    form: type[BaseModel], place: Place, details: Sequence[ErrorDetails], data: Mapping[str, Any]
) -> str:
    """Turn pydantic's errors at one key into a sentence of ours."""
    error, key = details[0], _dotted(place)
    prefix = f"{key}: " if key else ""
    if error["type"] == "extra_forbidden":
        known = _known_keys(form, place[:-1], data)
        hint = validation.nearest(place[-1], known) or f"known are {', '.join(known)}"
        return f"{prefix}unknown key {place[-1]!r}; {hint}"
    if error["type"] == "missing":
        return f"{prefix}is missing"
    if error["type"] == "value_error":
        return f"{prefix}{error['ctx']['error']}"
    if error["type"] == UNKNOWN_KIND:
        return _about_kind(key, error["input"], error["ctx"])
    allowed = [
        "a table" if one["type"] in _NO_TABLE else one["msg"].removeprefix(_MUST_BE)
        for one in details
        if one["msg"].startswith(_MUST_BE)
    ]
    if not allowed:
        return f"{prefix}{error['msg'][0].lower()}{error['msg'][1:]}"
    remedy = ""
    if error["type"] in _NO_TABLE and isinstance(error["input"], list):
        remedy = f"write [{key}] in place of [[{key}]]"
    if error["type"] == "list_type" and isinstance(error["input"], Mapping):
        remedy = f"write [[{key}]] in place of [{key}]"
    return str(InputError.of(key, error["input"], " or ".join(dict.fromkeys(allowed)), remedy))


def _dotted(place: Place) -> str:
    """Write a key as `split_key` reads it; what is no bare word in quotes, and on one line."""
    return ".".join(f"{part}" if re.fullmatch(r"[\w-]+", f"{part}") else repr(part) for part in place)


def _about_kind(key: str, given: Any, context: Mapping[str, Any]) -> str:
    if "refusal" in context:  # of a part of the user's own
        return f"{key.removesuffix('.kind')}.{context['refusal']}"
    if not isinstance(given, Mapping):
        return str(InputError.of(key, given, context["allowed"]))
    allowed = f"one of {context['kinds']}"
    if "kind" not in given:
        return f"{key}.kind: is missing; give {allowed}"
    kind = given["kind"]
    near = validation.nearest(kind, context["kinds"].split(", ")) if isinstance(kind, str) else ""
    remedy = near or "a part of your own is named by module and class"
    return str(InputError.of(key, kind, allowed, remedy))


def _known_keys(form: type[BaseModel], place: Place, data: Any) -> list[str]:
    """List the keys that the table at a place may have."""
    tables: list[type[BaseModel]] = [form]
    for part in place:
        data = data[part]
        if isinstance(part, str):
            annotations = (
                table.model_fields[part].annotation for table in tables if part in table.model_fields
            )
            # A key of a table of tables, such as the number of a resource, is no field: its tables are known.
            tables = [found for annotation in annotations for found in _models_in(annotation)] or tables
        if isinstance(data, Mapping):
            tables = [table.choose(data) if issubclass(table, KindTable) else table for table in tables]
    return list(dict.fromkeys(key for table in tables for key in table.model_fields))


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for argument in get_args(annotation) for found in _models_in(argument)]
