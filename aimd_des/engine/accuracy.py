"""The parts of a simulation as arguments of `theory.convergence`, or why theory does not cover them."""

from typing import Any

import numpy as np

from aimd_des.channel import BroadcastChannel
from aimd_des.channel.latency import Constant
from aimd_des.channel.loss import Bernoulli
from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.arguments import Arguments
from aimd_des.engine.control_unit import Crossing, Sampled
from aimd_des.theory import Convergence, convergence
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["convergence_of"]

_REMEDY = "theory covers nothing else"
# What may change a system in ways that theory does not know.
_LEFT_OUT = ("special", "interventions", "processes", "compensation")


def convergence_of(simulation: Arguments) -> Convergence:
    """Ask theory about a simulation."""
    for name in _LEFT_OUT:
        if given := getattr(simulation, name):
            many = list(given.values() if name == "special" else given) if name != "compensation" else [given]
            raise _uncovered(name, [_name(part) for part in many], "left out")
    agents = simulation.agents
    if agents is not AgentProcess and not hasattr(agents, "populate"):
        raise _uncovered("agents", _name(agents), "AgentProcess or Fleet")
    delay, loss = _channel(simulation)
    return convergence(
        simulation.problem,
        simulation.dynamics,
        **_timing(simulation, delay),
        loss=loss,
        averaging=simulation.averaging,
        response=simulation.response,
    )


def _uncovered(field: str, value: object, allowed: str) -> InputError:
    return InputError.of(field, value, allowed, _REMEDY)


def _name(part: Any) -> str:
    return str(getattr(part, "__name__", type(part).__name__))


def _channel(simulation: Arguments) -> tuple[float, FloatArray]:
    """Give how long signals take, sensing included, and with what probability copies are lost."""
    channel = simulation.channel
    if type(channel) is not BroadcastChannel:
        raise _uncovered(
            "channel", _name(channel), "a BroadcastChannel, over which copies do not share links"
        )
    latency, loss = channel.latency, channel.loss
    if type(latency) is not Constant:
        raise _uncovered("channel.latency", _name(latency), "constant")
    # A unit of one's own need not have a delay of its own, and is refused below.
    delays = np.asarray(latency.value) + getattr(simulation.control_unit, "sensing_delay", 0.0)
    if simulation.dynamics == "discrete":
        delays = np.ceil(delays)  # signals wait for the next tick
    if np.ptp(delays) > 0.0:
        raise _uncovered("channel.latency", latency.value, "the same for all agents")
    if type(loss) is not Bernoulli:
        raise _uncovered("channel.loss", _name(loss), "independent of all other losses")
    if np.any(channel.duplication):
        raise _uncovered("channel.duplication", channel.duplication, "0")
    return float(np.max(delays)), np.asarray(loss.probability)


def _timing(simulation: Arguments, delay: float) -> dict[str, Any]:
    """Say when signals are sent, and how long they take."""
    unit, clocks = simulation.control_unit, simulation.clocks
    if type(unit) not in (Sampled, Crossing):
        raise _uncovered("control_unit", _name(unit), "Sampled or Crossing")
    assert isinstance(unit, Sampled | Crossing)  # noqa: S101 - it is one of the two
    if clocks is not None:
        assert isinstance(unit, Sampled)  # noqa: S101 - a simulation refuses others on the clock
        if (unit.period, unit.phase) != (1.0, 0.0):
            raise _uncovered("control_unit", unit, "Sampled(period=1, phase=0) with agents that act at ticks")
        own = {"period": 1.0, "phase": 0.0, "drift": 0.0, "jitter": 0.0}
        for name, value in own.items():
            if isinstance(given := getattr(clocks, name), str) or not np.all(np.asarray(given) == value):
                raise _uncovered(f"clocks.{name}", given, f"{value:g} for all agents")
        return {"latency": delay}
    if isinstance(unit, Sampled):
        return {"latency": delay, "period": unit.period}
    if unit.longest_hold_off is not None:
        raise _uncovered("control_unit.longest_hold_off", unit.longest_hold_off, "left out")
    ideal = unit.hold_off == delay == 0.0
    return {"latency": delay, "hold_off": None if ideal else unit.hold_off}
