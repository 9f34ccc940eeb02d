"""One run as data: complete, frozen, read from TOML and written beside every result."""

from aimd_des.scenario.file import load_scenario
from aimd_des.scenario.messages import validate_scenario
from aimd_des.scenario.scenario import Scenario

__all__ = ["Scenario", "load_scenario", "validate_scenario"]
