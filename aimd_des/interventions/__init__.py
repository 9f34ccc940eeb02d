"""What happens to a run from outside: capacities, agents, the control unit and the channel change.

Interventions are declared with their times and given to `Simulation`, or made by a process of one's own with
the functions here.
"""

from typing import Protocol, runtime_checkable

from aimd_des.interventions.agents import (Absence, Crash, Join, Prices, UnusualActivity)
from aimd_des.interventions.capacity import CapacityProfile, CapacityRamp, CapacityStep
from aimd_des.interventions.actions import (cut_off, fail, join, leave, reconnect, recover)
from aimd_des.interventions.faults import Failover, Partition
from aimd_des.engine.absences import check_absences, check_end
from aimd_des.interventions.parameters import (set_capacity, set_decrease, set_increase, set_normalization, set_threshold)
from aimd_des.interventions.prices import set_costs, weigh
from aimd_des.problem.problem import Problem
from aimd_des.engine.system import System
from aimd_des.engine.delivery import ProcessGenerator

__all__ = [
    "Absence",
    "CapacityProfile",
    "CapacityRamp",
    "CapacityStep",
    "Crash",
    "Failover",
    "Intervention",
    "Join",
    "Partition",
    "Prices",
    "UnusualActivity",
    "check_absences",
    "check_end",
    "cut_off",
    "fail",
    "join",
    "leave",
    "reconnect",
    "recover",
    "set_capacity",
    "set_costs",
    "set_decrease",
    "set_increase",
    "set_normalization",
    "set_threshold",
    "weigh",
]


@runtime_checkable
class Intervention(Protocol):
    """Anything that is declared and changes a run."""

    def check(self, problem: Problem) -> None:
        """Refuse, before anything runs, what does not fit the problem."""
        ...

    def process(self, system: System) -> ProcessGenerator:
        """Live: the SimPy process of the intervention."""
        ...
