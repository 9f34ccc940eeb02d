"""One run as data: complete, frozen, read from TOML, written beside every result, and read back."""

from aimd_des.scenario.dotted_keys import parse_setting, with_settings
from aimd_des.scenario.file import load_scenario
from aimd_des.scenario.run_folder import StoredRun, load_run, write_run
from aimd_des.scenario.scenario import Scenario, validate_scenario
from aimd_des.scenario.schema import scenario_schema
from aimd_des.utils.folders import Place, check_folder, new_folder

__all__ = [
    "Place",
    "Scenario",
    "StoredRun",
    "check_folder",
    "load_run",
    "load_scenario",
    "new_folder",
    "parse_setting",
    "scenario_schema",
    "validate_scenario",
    "with_settings",
    "write_run",
]
