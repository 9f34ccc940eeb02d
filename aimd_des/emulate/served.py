"""What of a scenario an emulation serves, checked before anything runs; the rest is refused by its name."""

import os
from collections.abc import Mapping
from dataclasses import dataclass

from aimd_des.channel import Broadcast, BroadcastChannel, Link
from aimd_des.channel.broadcast import CompiledLink
from aimd_des.channel.loss.kernels import Cause
from aimd_des.dynamics.averaging import Cumulative, Forgetting, Polynomial
from aimd_des.dynamics.loss_compensation import KnownLoss
from aimd_des.dynamics.responses import Derandomised, EventNormalised, Randomised
from aimd_des.emulate.agent import Divisor, EmulatedAgent, Holding, Rule
from aimd_des.emulate.averages import Average, Fading, OverAll, Rising
from aimd_des.emulate.wire import MOST_RESOURCES
from aimd_des.engine.control_unit import Crossing, Sampled
from aimd_des.problem.costs import marginal_cost
from aimd_des.problem.problem import Problem
from aimd_des.scenario.scenario import Scenario
from aimd_des.utils import rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Key, Purpose

#: More agents than this cannot be kept in time by one machine.
MOST_AGENTS = 10_000

MOST_PROCESSES = 64

# Seconds between two looks below which a process is late more often than not.
_SHORTEST_SPACING = 0.002

_SHORTEST_UNIT, _LONGEST_UNIT = 0.001, 3600.0


@dataclass(frozen=True)
class Emulation:
    """An emulation, checked."""

    scenario: Scenario  # every value filled in
    problem: Problem
    unit: float  # seconds for a unit of time
    processes: int  # how many hold agents
    control_unit: Sampled | Crossing
    channel: BroadcastChannel  # latency and loss, which receivers make
    average: Average
    rule: Rule  # without what each agent knows of its losses
    losses: tuple[float, ...]  # what each agent knows of its losses; empty where they do nothing about them

    @property
    def until(self) -> float:
        """The end of the run, in units of time."""
        return self.scenario.until

    @property
    def keys(self) -> Mapping[Purpose, Key]:
        """The keys of all random numbers: those that the simulation has."""
        return {purpose: rng.key(self.scenario.seed, purpose) for purpose in Purpose}

    def link(self) -> CompiledLink:
        """Begin a run of the channel."""
        return served_link(self.channel.open(self.problem.n_agents, self.keys))

    def prepare(self) -> None:
        """Have all compiled that processes need: one of them that had to wait for it would be late."""
        link, m = self.link(), self.problem.n_resources
        for resource in range(m):
            link.keep_order(link.draw(Broadcast(resource, 0, 0.0), 0.0))
            rng.uniforms(self.keys[Purpose.RESPONSE], resource, 0, self.problem.n_agents)
        self.agent(0).answer(0, 1.0, 0.5)

    def agent(self, index: int) -> EmulatedAgent:
        """Make an agent that holds nothing yet."""
        of = self.problem
        own = zip(
            of.increase[index].tolist(), of.decrease[index].tolist(), of.normalization.tolist(), strict=True
        )
        rule = self.rule
        if self.losses:
            rule = Rule(rule.cut, rule.divisor, 1.0 / (1.0 - self.losses[index]))
        return EmulatedAgent(
            [Holding(*row) for row in own], marginal_cost(of.costs, index), self.average, rule
        )

    def agents_of(self, process: int) -> range:
        """Say which agents a process holds: neighbours in blocks as even as can be."""
        n, many = self.problem.n_agents, self.processes
        return range(process * n // many, (process + 1) * n // many)


def check_setting(scenario: Scenario, *, unit: float, processes: int) -> Emulation:
    """Check that a scenario can be emulated; a part that is not served is named."""
    if not hasattr(os, "fork"):
        raise InputError.of("system", os.name, "one whose processes can fork, such as Linux or macOS")
    seconds = validation.number("unit", unit, low=_SHORTEST_UNIT, high=_LONGEST_UNIT)
    _check_parts(scenario)
    scenario = scenario.resolved()
    problem = scenario.problem()
    if problem.n_agents > MOST_AGENTS:
        raise InputError.of("n_agents", problem.n_agents, f"at most {MOST_AGENTS}", "emulate fewer agents")
    if problem.n_resources > MOST_RESOURCES:
        raise InputError.of("n_resources", problem.n_resources, f"at most {MOST_RESOURCES}")
    most = min(MOST_PROCESSES, problem.n_agents)
    many = validation.integer("processes", processes, low=1, high=most)
    average = _average(scenario)
    setting = Emulation(
        scenario,
        problem,
        seconds,
        many,
        _control_unit(scenario, seconds),
        _channel(scenario),
        average,
        _rule(scenario, average),
        _losses(scenario, problem.n_agents),
    )
    scenario.recording.build().times("demand", scenario.until, whole=False)
    setting.link()  # refuses what does not fit the number of agents
    return setting


def _check_parts(scenario: Scenario) -> None:
    remedy = "aimd-des run simulates it"
    if scenario.dynamics != "continuous":
        raise InputError.of("dynamics", scenario.dynamics, "'continuous' to be emulated", remedy)
    if scenario.interventions:
        allowed = "left out to be emulated"
        raise InputError.of("interventions", f"{len(scenario.interventions)} of them", allowed, remedy)
    if scenario.channel.network is not None:
        allowed = "left out to be emulated: signals go over sockets, and not from node to node"
        raise InputError.of("channel.network", scenario.channel.network.of.name, allowed, remedy)


def _refused(field: str, part: object, served: str) -> InputError:
    return InputError.of(field, part, f"{served} to be emulated", "aimd-des run simulates it")


def _control_unit(scenario: Scenario, unit: float) -> Sampled | Crossing:
    made: object = scenario.control_unit.build()
    # Exactly these: a class that is derived from one of them may do something else.
    if type(made) is Sampled:
        name, spacing = "period", made.period
    elif type(made) is Crossing:
        name, spacing = "hold_off", made.hold_off
        if made.longest_hold_off is not None:
            raise _refused("control_unit.longest_hold_off", made.longest_hold_off, "left out")
    else:
        raise _refused("control_unit.kind", scenario.control_unit.of.name, "'sampled' or 'crossing'")
    if spacing * unit < _SHORTEST_SPACING:
        allowed = f"at least {_SHORTEST_SPACING / unit:g} with {unit:g} s for a unit of time"
        raise InputError.of(f"control_unit.{name}", spacing, allowed, "choose a longer unit")
    return made


def served_link(link: Link) -> CompiledLink:
    """Refuse a channel with models of the user's own, whose draws are in the order of their calls."""
    if not isinstance(link, CompiledLink):
        raise _refused("channel", "models of your own", "of the models that `aimd-des list` names")
    return link


def _channel(scenario: Scenario) -> BroadcastChannel:
    made = scenario.channel.build()
    if type(made) is not BroadcastChannel:
        raise _refused("channel", type(made).__name__, "a BroadcastChannel")
    return made


def _average(scenario: Scenario) -> Average:
    made = scenario.averaging.build()
    if type(made) is Cumulative:
        return OverAll()
    if type(made) is Forgetting:
        return Fading(made.time_constant)
    if type(made) is Polynomial:
        return Rising(made.gain) if made.gain > 1.0 else OverAll()
    served = "'cumulative', 'forgetting' or 'polynomial'"
    raise _refused("averaging.kind", scenario.averaging.of.name, served)


def _rule(scenario: Scenario, average: Average) -> Rule:
    made = None if scenario.response is None else scenario.response.build()
    if made is None or type(made) is Randomised:
        return Rule()
    if type(made) is EventNormalised:
        rule = Rule("drawn", "signals")
    elif type(made) is Derandomised:
        at_events: Divisor = "cuts" if made.full else "signals"
        divisor = at_events if made.divisor == "events" else "average"
        rule = Rule("full" if made.full else "fractional", divisor)
    else:
        assert scenario.response is not None  # noqa: S101 - something was made of it
        served = "'randomised', 'event_normalised' or 'derandomised'"
        raise _refused("response.kind", scenario.response.of.name, served)
    if rule.divisor != "average" and average != OverAll():
        served = "'cumulative' with a response that averages demand at signals"
        raise _refused("averaging.kind", scenario.averaging.of.name, served)
    return rule


def _losses(scenario: Scenario, n_agents: int) -> tuple[float, ...]:
    if scenario.compensation is None:
        return ()
    made = scenario.compensation.build()
    if type(made) is not KnownLoss:
        raise _refused("compensation.kind", scenario.compensation.of.name, "'known'")
    return tuple(made.parameters(n_agents).loss.tolist())


def records_losses(link: CompiledLink) -> bool:
    """Tell whether losses are read from a record, row by row."""
    return bool((link.table.loss.cause == Cause.RECORD).any())
