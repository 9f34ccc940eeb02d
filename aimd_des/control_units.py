"""When capacity signals are broadcast: what `control_unit=` takes."""

from aimd_des.engine.control_unit import Crossing, Sampled
from aimd_des.engine.control_unit.early_detection import EarlyDetection

__all__ = ["Crossing", "EarlyDetection", "Sampled"]
