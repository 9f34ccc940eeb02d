"""One run as data: complete, frozen, read from TOML and written beside every result."""

from aimd_des.scenario.file import load_scenario
from aimd_des.scenario.one_run import Scenario
from aimd_des.scenario.refusals import validate_scenario

__all__ = ["Scenario", "load_scenario", "validate_scenario"]
