"""When capacity signals are broadcast: what `control_unit=` takes."""

from aimd_des.engine.control_unit import Crossing, Sampled

__all__ = ["Crossing", "Sampled"]
