"""What a simulation is made of, and a run of it, for those that copy, save and predict runs.

They stand below both: a `Simulation` begins runs, and a `Run` is forked and saved.
"""

from collections.abc import Callable
from typing import Any, Protocol

from aimd_des.channel import Channel
from aimd_des.dynamics.averaging import Averaging
from aimd_des.dynamics.clocks import Clocks
from aimd_des.dynamics.demand import Dynamics
from aimd_des.dynamics.loss_compensation import Compensation
from aimd_des.dynamics.responses import Response
from aimd_des.engine.control_unit import ControlUnit
from aimd_des.engine.declared import Intervention
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.system import System
from aimd_des.problem.problem import Problem
from aimd_des.results.recording import Recording


class Arguments(Protocol):
    """What a simulation was made of, with what holds where nothing was given."""

    problem: Problem
    dynamics: Dynamics
    control_unit: ControlUnit
    channel: Channel
    agents: Any
    special: dict[int, Any]
    clocks: Clocks | None
    averaging: Averaging
    compensation: Compensation | None
    response: Response | None
    interventions: tuple[Intervention, ...]
    seed: int
    recording: Recording
    processes: tuple[Callable[[System], ProcessGenerator], ...]


class Begun(Protocol):
    """A run that has begun."""

    @property
    def simulation(self) -> Arguments:
        """Of which it is a run."""
        ...

    @property
    def system(self) -> System:
        """What happens in it."""
        ...

    @property
    def salts(self) -> tuple[int, ...]:
        """Of the forks that have led to it and were given draws of their own."""
        ...
