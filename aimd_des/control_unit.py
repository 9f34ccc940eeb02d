"""The control unit: it looks at total demand and broadcasts one bit where that is too high (Algorithm 1)."""

from dataclasses import dataclass
from itertools import count
from typing import Protocol

import numpy as np

from aimd_des.clock import Clock
from aimd_des.environment import Kind
from aimd_des.system import ProcessGenerator, System

__all__ = ["ControlUnit", "Sampled"]


class ControlUnit(Protocol):
    """Anything that decides when capacity signals are broadcast."""

    def process(self, system: System) -> ProcessGenerator:
        """Live: the SimPy process of the control unit."""
        ...


@dataclass(frozen=True)
class Sampled:
    """A control unit that looks at ``phase + q * period``.

    Parameters
    ----------
    period : float
        Time between two looks, greater than 0.
    phase : float
        Time of the first look, at least 0.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    period: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        clock = Clock(self.period, self.phase)
        object.__setattr__(self, "period", clock.period)
        object.__setattr__(self, "phase", clock.phase)

    def process(self, system: System) -> ProcessGenerator:
        """Look, and broadcast for each resource whose total demand is above its threshold.

        Parameters
        ----------
        system : System
            The run in progress.

        Yields
        ------
        simpy.Event
            The next look.
        """
        clock = Clock(self.period, self.phase)
        for look in count():
            yield system.env.at(clock.time(look), Kind.SENSE)
            for resource in np.flatnonzero(system.total_demand() > system.law.limit):
                system.broadcast(int(resource))
