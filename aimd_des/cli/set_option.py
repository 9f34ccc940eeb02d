"""The option `--set` of commands that read a file: values in place of the file's, by their dotted keys."""

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from aimd_des.utils.errors import InputError

_Function = TypeVar("_Function", bound=Callable[..., Any])

# What a study file has at its top and a scenario file has not.
_OF_A_STUDY = {"axes", "base", "extends", "precision", "replications", "scenario"}

# Tables are no deeper than this: channel, loss, a number, its kind.
_DEPTH = 6


def holds_a_study(path: Path) -> bool:
    """Tell files of studies and of scenarios apart."""
    from aimd_des.scenario.file import read_toml

    return bool(_OF_A_STUDY & set(read_toml(path)[0]))


def check_command(path: Path, *, study: bool) -> None:
    """Refuse the file of a study where that of a scenario is due, and the reverse."""
    if holds_a_study(path) != study:
        found, command = ("scenario", "run") if study else ("study", "sweep")
        raise InputError(f"{path}: is the file of a {found}: say aimd-des {command} {path}")


def set_option(examples: str) -> Callable[[_Function], _Function]:
    """Make the option, for a command whose first argument is the file."""
    return click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        shell_complete=_complete,
        help=f"Replaces a value of the file, such as {examples}; may be repeated.",
    )


def changes(settings: Sequence[str], **options: Any) -> dict[str, Any]:
    """Put together what the command line says about a file."""
    from aimd_des.scenario.dotted_keys import parse_setting

    given = {name: value for name, value in options.items() if value is not None}
    return {**dict(map(parse_setting, settings)), **given}


def _complete(context: click.Context, _: click.Parameter, incomplete: str) -> "list[CompletionItem[str]]":
    """Offer the keys that begin so; a value is the user's own affair."""
    from aimd_des.cli.schema import schema_of

    # The first argument is the file, and called by what it holds.
    kind = next(str(part.name) for part in context.command.params if isinstance(part, click.Argument))
    try:
        schema = schema_of(kind)
    except InputError:  # a module around is broken, which other commands say
        return []
    found: dict[str, str] = {}
    # The option that is being typed lacks its value: click then gives arguments as they are.
    path = context.params.get(kind) or next(iter(context.args), None)
    # The file says how many tables a list has, and which model it is.
    for key, meaning in _keys(schema, schema["definitions"], read_if_there(path)):
        found.setdefault(key, meaning)
    return [
        CompletionItem(f"{key}=", help=meaning)
        for key, meaning in found.items()
        if key.startswith(incomplete)
    ]


def read_if_there(path: Any) -> dict[str, Any]:
    """Read a file of TOML; of what is none, nothing."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except (OSError, TypeError, ValueError, RecursionError):
        return {}


def _keys(
    part: Mapping[str, Any], definitions: Mapping[str, Any], data: Any, above: str = "", depth: int = 0
) -> Iterator[tuple[str, str]]:
    """Name every key that a part of a schema allows, with its meaning."""
    if depth > _DEPTH:
        return
    if "$ref" in part:
        part = {**part, **definitions[part["$ref"].rpartition("/")[2]]}
    for form in (form for word in ("allOf", "anyOf", "oneOf") for form in part.get(word, ())):
        yield from _keys(form, definitions, data, above, depth + 1)
    for name, inner in part.get("properties", {}).items():
        here = f"{above}.{name}" if above else name
        yield here, inner.get("description", "")
        below = data.get(name) if isinstance(data, dict) else None
        if here.endswith("parameters") and isinstance(data, dict):
            yield from _parameters(here, data.get("model"))
        yield from _keys(inner, definitions, below, here, depth + 1)
    if isinstance(data, list):
        for place, item in enumerate(data):
            if isinstance(item, dict):
                yield from _keys(part.get("items", {}), definitions, item, f"{above}.{place}", depth + 1)


def _parameters(above: str, model: Any) -> Iterator[tuple[str, str]]:
    """Name the parameters of a model."""
    from aimd_des.scenario.models import model_parameters

    try:
        names = model_parameters(str(model), {}, 0)
    except InputError:
        return
    yield from ((f"{above}.{name}", "") for name in names)
