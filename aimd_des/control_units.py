"""When capacity signals are broadcast: what `control_unit=` takes."""

from aimd_des.engine.control_unit import Crossing, EarlyDetection, Sampled

__all__ = ["Crossing", "EarlyDetection", "Sampled"]
