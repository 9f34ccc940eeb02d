"""Everything that a scenario names by a kind: tables, checks, schema and help are made of it.

Parts register themselves, those of the framework where their modules are imported, which is done here.
"""

import inspect
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import aimd_des.channel.topology
import aimd_des.control_units
import aimd_des.costs
import aimd_des.dynamics.averaging
import aimd_des.dynamics.loss_compensation
import aimd_des.dynamics.responses
import aimd_des.interventions
import aimd_des.scenario.prices  # noqa: F401 - like those above, it registers its parts
from aimd_des.scenario.named import MODELS, PARTS, modules_around
from aimd_des.scenario.networks import over_network
from aimd_des.utils import returned_values
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import GROUPS, MODEL, Registered, keys_of, registered


@dataclass(frozen=True)
class Parameter:
    """A key of a kind."""

    name: str
    required: bool  # whether it must be given
    default: str  # as TOML has it; empty where nothing stands there
    meaning: str  # from the documentation


@dataclass(frozen=True)
class Kind:
    """Something that a scenario can name."""

    of: Registered  # the class or function that makes it
    name: str  # what `kind` says, or `model`

    @property
    def group(self) -> str:
        """Of which it is one: "model", or one of `GROUPS`."""
        return self.of.group

    @property
    def is_own(self) -> bool:
        """Whether it is no part of this package."""
        return "." in self.name

    @property
    def goes_over(self) -> bool:
        """Whether broadcasts go over what it makes: a graph, and no channel that is complete."""
        return self.group == "network" and not hasattr(self.of.make, "open")

    @property
    def meaning(self) -> str:
        """One line about it."""
        return (inspect.getdoc(self.of.make) or "").partition("\n")[0]

    @cached_property
    def own(self) -> dict[str, inspect.Parameter]:
        """The keys that the class or function takes."""
        return {
            name: given.replace(default=self.of.defaults.get(name, given.default))
            for name, given in keys_of(self.of.make).items()
        }

    @cached_property
    def signature(self) -> dict[str, inspect.Parameter]:
        """The keys, with types and defaults; where broadcasts go over a graph, with those that say how."""
        over = list(keys_of(over_network).items())[1:] if self.goes_over else []
        return {**self.own, **dict(over)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The keys, with defaults and meanings."""
        over = over_network.__doc__ if self.goes_over else None
        meanings = describe(self.of.make.__doc__) | describe(over)
        return tuple(
            Parameter(name, given.default is given.empty, _as_toml(given.default), meanings.get(name, ""))
            for name, given in self.signature.items()
        )

    def make(self, **given: Any) -> Any:
        """Make what a table describes."""
        own = {name: value for name, value in given.items() if name in self.own}
        try:
            made = self.of.make(**own)
        except InputError:
            raise
        except (Exception, SystemExit) as error:  # all that it does not check itself
            cause = f"{type(error).__name__}: {error}".rstrip(": ")
            raise InputError(f"{self.name} makes nothing of these parameters ({cause})") from error
        if self.is_own:
            returned_values.having(f"what {self.name} makes", made, GROUPS[self.group])
        if not self.goes_over:
            return made
        return over_network(made, **{name: value for name, value in given.items() if name not in self.own})


@cache
def _kind(of: Registered) -> Kind:
    return Kind(of, of.name)


def our_kinds(group: str = "") -> tuple[Kind, ...]:
    """List what the framework has of one group, or of all, in the order of the groups."""
    groups = (group,) if group else tuple(GROUPS)
    found = (_kind(one) for name in groups for one in registered(name))
    return tuple(kind for kind in found if not kind.is_own)


def own_kinds(group: str) -> tuple[Kind, ...]:
    """List what users have: imports the modules around that register parts, and no others."""
    for module in modules_around():
        for name in PARTS.within(module):
            PARTS.find(name)
    found = (_kind(one) for name in ((group,) if group else GROUPS) for one in registered(name))
    return tuple(kind for kind in found if kind.is_own)


def kinds(group: str = "") -> tuple[Kind, ...]:
    """Describe everything that a scenario can name, or what it can name of one group."""
    models = tuple(_models()) if group in ("", MODEL) else ()
    return models if group == MODEL else (*models, *our_kinds(group), *own_kinds(group))


def kind_of(group: str, name: str) -> Kind:
    """Find a part of the user's own, and import its module."""
    kind = _kind(PARTS.find(name))
    if kind.group != group:
        raise InputError.of("kind", name, f"a part of group {group}, and this is one of group {kind.group}")
    return kind


def _models() -> Iterator[Kind]:
    """Import the modules that register a model, and no others, and yield what they register."""
    for module in modules_around():
        for name in MODELS.within(module):
            yield Kind(MODELS.find(name), name)


def describe(docstring: str | None) -> dict[str, str]:
    """Read what a docstring says about each parameter or attribute.

    Examples
    --------
    >>> from aimd_des import Sampled
    >>> describe(Sampled.__doc__)["period"]
    'Time between two samples, greater than 0.'
    """
    text = inspect.cleandoc(docstring or "")
    meanings: dict[str, str] = {}
    for section in re.split(r"\n\n(?=[A-Z][a-z]+\n-+\n)", text):
        head, _, body = section.partition("\n")
        if head not in ("Parameters", "Attributes"):
            continue
        for entry in re.split(r"\n(?=\S)", body.partition("\n")[2]):
            names, _, meaning = entry.partition("\n")
            for name in names.split(" : ")[0].split(", "):
                meanings[name] = " ".join(meaning.split())
    return meanings


def _as_toml(value: object) -> str:
    """Write a default as it would stand in a file."""
    if value is inspect.Parameter.empty or value is None:
        return ""
    return json.dumps(value, default=repr)  # which TOML reads likewise
