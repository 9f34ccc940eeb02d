"""Checks of what a user gives, for models and parts of one's own: what is wrong is refused by its name."""

from aimd_des.utils.validation import array, integer, number, per_agent

__all__ = ["array", "integer", "number", "per_agent"]
