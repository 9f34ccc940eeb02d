"""The agents: one SimPy process each, or all of them as a fleet."""

from aimd_des.fleet.control_process import Autopilot
from aimd_des.engine.agent_process import Camera
from aimd_des.fleet.fleet import Fleet

__all__ = ["Autopilot", "Camera", "Fleet"]
