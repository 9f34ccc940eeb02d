"""What there is: kinds that a scenario can name, models, and what can be run in the working directory."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aimd_des.cli.set_option import read_if_there

if TYPE_CHECKING:
    from aimd_des.scenario.kinds import Kind


@dataclass(frozen=True)
class Topic:
    """Something that can be listed."""

    title: str  # what it is, and how a name of it is used
    group: str = ""  # the group of kinds; scenarios are none


#: What is listed, by the word for it.
TOPICS = {
    "models": Topic('Models, as in model = "NAME"; keys stand in [parameters]', "model"),
    "scenarios": Topic("Scenarios, as in python -m NAME or aimd-des run FILE"),
    "control_units": Topic('Control units, as in [control_unit] kind = "NAME"', "control_unit"),
    "latency": Topic('Latency, as in channel.latency = { kind = "NAME", ... }', "latency"),
    "loss": Topic('Loss, as in channel.loss = { kind = "NAME", ... }', "loss"),
    "networks": Topic('Networks, as in [channel.network] kind = "NAME"', "network"),
    "averaging": Topic('Averaging, as in [averaging] kind = "NAME"', "averaging"),
    "responses": Topic('Responses, as in [response] kind = "NAME"', "response"),
    "compensation": Topic('Compensation of losses, as in [compensation] kind = "NAME"', "compensation"),
    "interventions": Topic('Interventions, as in [[interventions]] kind = "NAME"', "intervention"),
    "costs": Topic('Private costs of a problem that is written out, as in [costs] kind = "NAME"', "costs"),
}

# Where files of scenarios and studies are looked for.
_FOLDERS = (".", "scenarios")


@dataclass(frozen=True)
class Key:
    """A parameter, as it is written in a scenario file."""

    name: str  # how it is called
    required: bool  # whether it must be given
    default: str  # what holds unless it is given, as TOML has it
    meaning: str  # in a line or more


@dataclass(frozen=True)
class CatalogEntry:
    """Something that has a name."""

    name: str  # as it is used
    meaning: str  # in one line
    parameters: tuple[Key, ...] = ()  # what it takes


def entries(topic: str) -> list[CatalogEntry]:
    """List what there is of one topic."""
    if topic == "scenarios":
        return [*_scripts(), *_files()]
    from aimd_des.scenario.kinds import kinds

    return [_entry(kind) for kind in kinds(TOPICS[topic].group)]


def _entry(kind: "Kind") -> CatalogEntry:
    keys = tuple(Key(key.name, key.required, key.default, key.meaning) for key in kind.parameters)
    return CatalogEntry(kind.name, kind.meaning, keys)


def _scripts() -> Iterator[CatalogEntry]:
    """Find the scripts of the folder `scenarios`, and folders in it that can be run; nothing is run."""
    folder = Path("scenarios")
    sources = {path.stem: path for path in folder.glob("[!_.]*.py")}
    sources |= {path.parent.name: path.with_name("__init__.py") for path in folder.glob("[!_.]*/__main__.py")}
    for name, source in sorted(sources.items()):
        try:
            text = ast.get_docstring(ast.parse(source.read_bytes())) or ""
        except (OSError, SyntaxError, ValueError, RecursionError):
            continue  # no module of Python
        yield CatalogEntry(f"scenarios.{name}", text.partition("\n")[0])


def _files() -> Iterator[CatalogEntry]:
    """Find files of scenarios and studies in the working directory and in its folder `scenarios`."""
    for path in sorted(path for folder in _FOLDERS for path in Path(folder).glob("*.toml")):
        data = read_if_there(path)
        if "until" in data or "axes" in data:
            yield CatalogEntry(str(path), str(data.get("title", "")))
