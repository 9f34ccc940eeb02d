"""A result of a run in Python, saved as `aimd-des run` saves one."""

from pathlib import Path

from aimd_des.engine.simulation import Simulation
from aimd_des.results.result import Result
from aimd_des.scenario.from_simulation import scenario_of
from aimd_des.scenario.run_folder import write_run
from aimd_des.scenario.scenario import Scenario
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.folders import check_folder


def save_result(result: Result, folder: str | Path, *, overwrite: bool, figures: bool) -> None:
    """Write the folder of a run; what ran must be a scenario, or one can describe it."""
    origin = result.origin
    if isinstance(origin, Simulation):
        scenario = scenario_of(origin, result.until)
    elif isinstance(origin, Scenario):
        scenario = origin
    else:
        allowed = "known: it is of results of Scenario.run and Simulation.run in the process that ran them"
        remedy = "or write the folder by scenario.write_run, which takes the scenario"
        raise InputError.of("what was run", origin, allowed, remedy)
    place = check_folder(validation.path("folder", folder), overwrite=overwrite)
    write_run(place, scenario, result, figures=figures)
