"""When capacity signals are broadcast: the contract, and the control units of the model."""

from aimd_des.engine.control_unit.base import ControlUnit, CrossingTable, SampledTable, table_of
from aimd_des.engine.control_unit.crossing import Crossing
from aimd_des.engine.control_unit.sampled import Sampled, SampledUnit

__all__ = [
    "ControlUnit",
    "Crossing",
    "CrossingTable",
    "Sampled",
    "SampledTable",
    "SampledUnit",
    "table_of",
]
