"""All standard agents of a run in compiled code: the events of agents that are processes, much faster."""

from aimd_des.fleet.fleet import Fleet

__all__ = ["Fleet"]
