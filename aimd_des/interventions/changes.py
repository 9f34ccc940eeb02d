"""The control unit and the channel, changed while a run goes on: hold-off, threshold, latency and losses."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from aimd_des.channel import Channel
from aimd_des.engine.control_unit import Crossing
from aimd_des.engine.planned_changes import Change, Memory
from aimd_des.engine.system import System
from aimd_des.interventions.bookkeeping import BeginsAt, note
from aimd_des.interventions.parameters import set_threshold
from aimd_des.problem.lookup import resource_index
from aimd_des.problem.problem import Problem
from aimd_des.results.event_log import Entry
from aimd_des.utils import rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.rng import Purpose


def set_hold_off(system: System, hold_off: float, longest_hold_off: float | None = None) -> None:
    """Change how long the control unit holds off after a signal.

    A hold-off that goes on ends when it would have ended.  Where hold-offs adapt, the present one is brought
    into the new bounds.

    Parameters
    ----------
    system : System
        The run in progress.
    hold_off : float
        At least 0, in units of time.
    longest_hold_off : float, optional
        Up to where it adapts, as for `Crossing`; default: it does not adapt.

    Raises
    ------
    InputError
        If the control unit has no hold-off, or a bound is out of its range.
    """
    bounds = Crossing(hold_off, longest_hold_off=longest_hold_off).bounds
    listeners = system.conditions.on_hold_off
    if not listeners:
        allowed = "left as it is unless the control unit is a Crossing: others have no hold-off"
        raise InputError.of("hold_off", hold_off, allowed)
    system.settle()
    system.conditions.retimed = True
    for tell in listeners:
        tell(*bounds)
    note(system, Entry.HOLD_OFF, value=bounds[0])


def set_channel(system: System, channel: Channel) -> None:
    """Let signals go over another channel from now on; copies that have been sent arrive as they would have.

    Parameters
    ----------
    system : System
        The run in progress.
    channel : Channel
        It begins now: bursts, records and the order of copies know nothing of what was sent before.

    Raises
    ------
    InputError
        If it is no channel, or does not fit the number of agents.
    """
    system.change_channel(_channel(channel))
    note(system, Entry.CHANNEL)


def _channel(channel: Channel) -> Channel:
    allowed = "a channel, such as BroadcastChannel or topology.tree(graph)"
    return validation.instance("channel", channel, Channel, allowed)


@built_in("intervention", "hold_off")
@dataclass(frozen=True)
class ChangeHoldOff(BeginsAt):
    """The control unit holds off for another time from now on; it must be a `Crossing`.

    A hold-off that goes on ends when it would have ended.

    Parameters
    ----------
    at : float
        When, at least 0.
    hold_off : float
        How long it holds off from then on, at least 0 and in units of time.
    longest_hold_off : float, optional
        Up to where it adapts, as for `Crossing`; default: it does not adapt.
    """

    of_hold_off: ClassVar[bool] = True  # by which a run refuses it where there is none

    at: float
    hold_off: float
    longest_hold_off: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        unit = Crossing(self.hold_off, longest_hold_off=self.longest_hold_off)
        object.__setattr__(self, "hold_off", unit.hold_off)
        object.__setattr__(self, "longest_hold_off", unit.longest_hold_off)

    def check(self, problem: Problem) -> None:
        """Accept any problem."""

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Change the hold-off when it is time."""
        yield self.at, lambda: set_hold_off(system, self.hold_off, self.longest_hold_off)


@built_in("intervention", "threshold")
@dataclass(frozen=True)
class ChangeThreshold(BeginsAt):
    """Signals are due at another share of the capacity from now on.

    Parameters
    ----------
    at : float
        When, at least 0.
    threshold : float
        gamma, greater than 0 and at most 1.
    resource : str or int, optional
        Of which resource; default: of all.
    """

    at: float
    threshold: float
    resource: str | int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        clean = validation.number(
            "ChangeThreshold.threshold", self.threshold, low=0.0, low_open=True, high=1.0
        )
        object.__setattr__(self, "threshold", clean)

    def check(self, problem: Problem) -> None:
        """Refuse a resource that there is not."""
        self._indices(problem)

    def _indices(self, problem: Problem) -> list[int]:
        if self.resource is None:
            return list(range(problem.n_resources))
        return [resource_index(problem, self.resource)]

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Change the threshold when it is time."""

        def change() -> None:
            for j in self._indices(system.problem):
                set_threshold(system, j, self.threshold)

        yield self.at, change


@built_in("intervention", "channel")
@dataclass(frozen=True)
class ChangeChannel(BeginsAt):
    """Signals go over another channel from now on; copies that have been sent arrive as they would have.

    Several of them give a channel with phases: better links, then worse ones.

    Parameters
    ----------
    at : float
        When, at least 0.
    channel : Channel
        The channel from then on, where it begins: bursts, records and the order of copies know nothing of
        what was sent before.  Random numbers have their addresses as ever.
    """

    at: float
    channel: Channel

    def __post_init__(self) -> None:
        super().__post_init__()
        _channel(self.channel)

    def check(self, problem: Problem) -> None:
        """Refuse a channel that does not fit the number of agents."""
        # Opened as a run would open it: the seed decides nothing of what can be refused.
        self.channel.open(problem.n_agents, {purpose: rng.key(0, purpose) for purpose in Purpose})

    def changes(self, system: System, memory: Memory) -> Iterator[Change]:
        """Change the channel when it is time."""
        yield self.at, lambda: set_channel(system, self.channel)
