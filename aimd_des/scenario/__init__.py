"""One run as data: complete, frozen, read from TOML and written beside every result."""

from aimd_des.scenario.file import load_scenario
from aimd_des.scenario.one_run import Scenario

__all__ = ["Scenario", "load_scenario"]
