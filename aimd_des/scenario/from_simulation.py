"""A simulation that was put together in Python as a scenario, where files can say all that it is made of."""

from typing import Any

from aimd_des.channel import BroadcastChannel
from aimd_des.channel.latency import Constant
from aimd_des.channel.loss import Bernoulli, Combined
from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.run_file import fingerprint
from aimd_des.engine.simulation import Simulation
from aimd_des.fleet import Fleet
from aimd_des.problem.problem import Problem
from aimd_des.scenario.kinds import our_kinds
from aimd_des.scenario.parameters import as_data
from aimd_des.scenario.scenario import Scenario, validate_scenario
from aimd_des.utils.errors import InputError

_REMEDY = "describe it by a Scenario, whose results are saved with it"
_RESOURCE = ("name", "capacity", "increase", "decrease", "normalization", "threshold", "unit")
_AGENTS = {AgentProcess: "process", Fleet: "fleet"}


def scenario_of(simulation: Simulation, until: float) -> Scenario:
    """Describe a simulation by data, or say which of its parts no file can describe."""
    data: dict[str, Any] = {
        "until": until,
        "seed": simulation.seed,
        "dynamics": simulation.dynamics,
        "agents": _agents(simulation),
        "control_unit": _table("control_unit", simulation.control_unit),
        "channel": _channel(simulation.channel),
        "averaging": _table("averaging", simulation.averaging),
        "interventions": [_table("intervention", one) for one in simulation.interventions],
        "recording": _fields(simulation.recording, ("demand", "allocations", "tail", "overshoot", "events")),
        **_problem(simulation.problem),
    }
    for name in ("response", "compensation"):
        if (part := getattr(simulation, name)) is not None:
            data[name] = _table(name, part)
    if simulation.clocks is not None:
        data["clocks"] = _fields(simulation.clocks, ("period", "phase", "drift", "jitter"))
    scenario = validate_scenario(as_data(data), "save")
    # Built again, so that what is written gives the same result to the last bit.
    if fingerprint(scenario.simulation()) != fingerprint(simulation):
        raise InputError(f"save: a scenario file cannot say all that this simulation is made of; {_REMEDY}")
    return scenario


def _agents(simulation: Simulation) -> str:
    for name in ("special", "processes"):
        if given := getattr(simulation, name):
            raise InputError.of(name, given, "empty to be saved: they are functions of your own", _REMEDY)
    if simulation.agents not in _AGENTS:
        raise InputError.of("agents", simulation.agents, "AgentProcess or Fleet to be saved", _REMEDY)
    return _AGENTS[simulation.agents]


def _problem(problem: Problem) -> dict[str, Any]:
    if not problem.named_by_index:
        raise InputError.of("agent_names", problem.agent_names, "left out to be saved", _REMEDY)
    return {
        "resources": [_fields(resource, _RESOURCE) for resource in problem.resources],
        "costs": _table("costs", problem.costs),
    }


def _channel(channel: Any) -> dict[str, Any]:
    if type(channel) is not BroadcastChannel:
        raise InputError.of("channel", channel, "a BroadcastChannel to be saved", _REMEDY)
    losses = channel.loss.losses if isinstance(channel.loss, Combined) else (channel.loss,)
    if len(losses) == 1:
        loss = _number_or_table("loss", losses[0])
    else:  # a list of numbers would be one probability for each agent
        loss = [_table("loss", one) for one in losses]
    return {
        "latency": _number_or_table("latency", channel.latency),
        "loss": loss,
        "duplication": channel.duplication,
        "fifo": channel.fifo,
    }


def _number_or_table(group: str, model: Any) -> Any:
    """Write a constant latency and an independent loss as numbers, as files have them."""
    if type(model) is Constant:
        return model.value
    if type(model) is Bernoulli:
        return model.probability
    return _table(group, model)


def _table(group: str, part: Any) -> dict[str, Any]:
    """Write a part of the framework by its kind, with what its constructor takes."""
    for kind in our_kinds(group):
        if kind.of.make is type(part):
            return {"kind": kind.name, **_fields(part, tuple(kind.own))}
    raise InputError.of(group, part, "a part of aimd_des that files can name, to be saved", _REMEDY)


def _fields(part: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Take what a part was given, as its attributes of the same names have it."""
    missing = [name for name in names if not hasattr(part, name)]
    if missing:
        raise InputError.of(type(part).__name__, missing, "kept by the part to be saved", _REMEDY)
    return {name: given for name in names if (given := getattr(part, name)) is not None}
