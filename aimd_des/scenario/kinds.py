"""Everything that a scenario names by a kind, in one list: tables, checks, schema and help are made of it."""

import inspect
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from aimd_des import interventions
from aimd_des.channel import latency, loss, topology
from aimd_des.dynamics import averaging
from aimd_des.dynamics import loss_compensation as compensation
from aimd_des.engine.control_unit import Crossing, Sampled
from aimd_des.scenario.models import models_of, named_model
from aimd_des.scenario.module_source import modules_in
from aimd_des.scenario.networks import over_network
from aimd_des.scenario.prices import RedrawnPrices

__all__ = ["KINDS", "Kind", "Parameter", "describe", "kinds", "kinds_of"]

# Where models are looked for that nobody has named.
_MODELS = "models"


@dataclass(frozen=True)
class Parameter:
    """A key of a kind.

    Attributes
    ----------
    name : str
        The key.
    required : bool
        Whether it must be given.
    default : str
        What holds unless it is given, as TOML has it; empty where nothing stands there.
    meaning : str
        From the documentation.
    """

    name: str
    required: bool
    default: str
    meaning: str


@dataclass(frozen=True)
class Kind:
    """Something that a scenario can name.

    Attributes
    ----------
    group : str
        Of which it is one: "model", "control_unit", "latency", "loss", "network", "averaging",
        "compensation" or "intervention".
    name : str
        What `kind` says, or `model`.
    make : callable
        The class or function that makes it.
    defaults : mapping
        What holds in a scenario where `make` asks for a value.
    then : callable, optional
        What is done with what was made; its first parameter.
    """

    group: str
    name: str
    make: Callable[..., Any]
    defaults: Mapping[str, Any] = field(default_factory=dict)
    then: Callable[..., Any] | None = None

    @property
    def meaning(self) -> str:
        """One line about it."""
        return (inspect.getdoc(self.make) or "").partition("\n")[0]

    @cached_property
    def own(self) -> frozenset[str]:
        """The keys that `make` takes; `then` takes the others."""
        return frozenset(inspect.signature(self.make).parameters)

    @cached_property
    def signature(self) -> dict[str, inspect.Parameter]:
        """The keys, with types and defaults."""
        found = dict(inspect.signature(self.make).parameters)
        if self.then is not None:
            found |= dict(list(inspect.signature(self.then).parameters.items())[1:])
        return {
            name: parameter.replace(default=self.defaults.get(name, parameter.default))
            for name, parameter in found.items()
            if not name.startswith("_")
        }

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The keys, with defaults and meanings."""
        meanings = describe(self.make.__doc__) | describe(self.then.__doc__ if self.then else None)
        return tuple(
            Parameter(name, given.default is given.empty, _as_toml(given.default), meanings.get(name, ""))
            for name, given in self.signature.items()
        )


#: All but the models, which are looked for.
KINDS: tuple[Kind, ...] = (
    Kind("control_unit", "sampled", Sampled),
    Kind("control_unit", "crossing", Crossing, {"hold_off": 1.0}),
    Kind("latency", "constant", latency.Constant),
    Kind("latency", "uniform", latency.Uniform),
    Kind("latency", "exponential", latency.Exponential),
    Kind("latency", "gamma", latency.ShiftedGamma),
    Kind("latency", "lognormal", latency.LogNormal),
    Kind("latency", "pareto", latency.Pareto),
    Kind("latency", "empirical", latency.Empirical),
    Kind("latency", "measured", latency.Empirical.from_csv),
    Kind("loss", "bernoulli", loss.Bernoulli),
    Kind("loss", "gilbert_elliott", loss.GilbertElliott),
    Kind("loss", "common", loss.CommonMode),
    Kind("loss", "trace", loss.Trace),
    Kind("loss", "recorded", loss.Trace.from_csv),
    Kind("network", "star", topology.star, then=over_network),
    Kind("network", "balanced_tree", topology.balanced_tree, then=over_network),
    Kind("network", "grid", topology.grid, then=over_network),
    Kind("network", "random_geometric", topology.random_geometric, then=over_network),
    Kind("network", "graphml", topology.from_graphml, then=over_network),
    Kind("network", "edges", topology.from_edges, then=over_network),
    Kind("averaging", "cumulative", averaging.Cumulative),
    Kind("averaging", "window", averaging.Window),
    Kind("averaging", "forgetting", averaging.Forgetting),
    Kind("compensation", "known", compensation.KnownLoss),
    Kind("compensation", "estimated", compensation.EstimatedLoss),
    Kind("intervention", "capacity_step", interventions.CapacityStep),
    Kind("intervention", "capacity_ramp", interventions.CapacityRamp),
    Kind("intervention", "capacity_profile", interventions.CapacityProfile),
    Kind("intervention", "capacity_profile", interventions.CapacityProfile.from_csv),
    Kind("intervention", "join", interventions.Join),
    Kind("intervention", "absence", interventions.Absence),
    Kind("intervention", "crash", interventions.Crash),
    Kind("intervention", "unusual_activity", interventions.UnusualActivity),
    Kind("intervention", "prices", RedrawnPrices),
    Kind("intervention", "failover", interventions.Failover),
    Kind("intervention", "partition", interventions.Partition),
)


def kinds() -> tuple[Kind, ...]:
    """Describe everything that a scenario can name."""
    return (*_models(), *KINDS)


def kinds_of(group: str) -> tuple[Kind, ...]:
    """List one group."""
    return tuple(kind for kind in KINDS if kind.group == group)


def _models() -> Iterator[Kind]:
    """Import the modules that register a model, and no others, and yield what they register."""
    for module in dict.fromkeys((_MODELS, *modules_in(_MODELS), *modules_in())):
        for name in models_of(module):
            yield Kind("model", name, named_model(name))


def describe(docstring: str | None) -> dict[str, str]:
    """Read what a docstring says about each parameter or attribute.

    Examples
    --------
    >>> describe(Sampled.__doc__)["period"]
    'Time between two looks, greater than 0.'
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
