"""The agents: one SimPy process each."""

from aimd_des.agents.camera import Camera

__all__ = ["Camera"]
