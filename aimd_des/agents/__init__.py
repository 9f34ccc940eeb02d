"""The agents: one SimPy process each, or all of them as a fleet."""

from aimd_des.agents.autopilot import Autopilot
from aimd_des.agents.camera import Camera
from aimd_des.agents.fleet import Fleet

__all__ = ["Autopilot", "Camera", "Fleet"]
