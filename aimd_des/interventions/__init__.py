"""What happens to a run from outside: capacities, agents, the control unit and the channel change.

Interventions are declared with their times and given to `Simulation`, or made by a process of one's own with
the functions here.
"""

from aimd_des.engine.declared import Intervention, check_absences, check_end
from aimd_des.engine.planned_changes import Planned
from aimd_des.interventions.actions import cut_off, fail, join, leave, reconnect, recover
from aimd_des.interventions.agents import Absence, Crash, Join, Prices, UnusualActivity
from aimd_des.interventions.capacity import CapacityProfile, CapacityRamp, CapacityStep
from aimd_des.interventions.changes import (
    ChangeChannel,
    ChangeHoldOff,
    ChangeThreshold,
    set_channel,
    set_hold_off,
)
from aimd_des.interventions.faults import Failover, Partition
from aimd_des.interventions.parameters import (
    set_capacity,
    set_decrease,
    set_increase,
    set_normalization,
    set_threshold,
)
from aimd_des.interventions.prices import set_costs, weigh

__all__ = [
    "Absence",
    "CapacityProfile",
    "CapacityRamp",
    "CapacityStep",
    "ChangeChannel",
    "ChangeHoldOff",
    "ChangeThreshold",
    "Crash",
    "Failover",
    "Intervention",
    "Join",
    "Partition",
    "Planned",
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
    "set_channel",
    "set_costs",
    "set_decrease",
    "set_hold_off",
    "set_increase",
    "set_normalization",
    "set_threshold",
    "weigh",
]
