"""Simulation of asynchronous AIMD resource allocation with one-bit capacity signals."""

from importlib import import_module

from aimd_des import _deprecated
from aimd_des._version import RESULT_VERSION
from aimd_des._version import __version__ as __version__
from aimd_des.utils.actions import register

# As type checkers take it; `typing` takes longer to import than all else here.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from aimd_des import averaging, compensation, interventions, latency, loss, lowlevel, theory, topology
    from aimd_des.channel import BroadcastChannel
    from aimd_des.dynamics.clocks import Clocks
    from aimd_des.engine.agent_process import AgentProcess
    from aimd_des.engine.agent_process import Camera as Camera
    from aimd_des.engine.control_unit import Crossing, Sampled
    from aimd_des.engine.simulation import Simulation
    from aimd_des.fleet import Fleet
    from aimd_des.problem import Problem, Resource
    from aimd_des.problem.costs import CoupledCosts, CustomCosts, PolynomialCosts
    from aimd_des.problem.optimum import Optimum, normalization_factors, solve_optimum
    from aimd_des.results import Recording, Result
    from aimd_des.scenario import load_scenario
    from aimd_des.scenario.models import model
    from aimd_des.study import Study, load_study, run_study
    from aimd_des.synchronous import run_synchronous
    from aimd_des.utils.errors import InputError, OverloadWarning, SimulationError

# Where each public name lives.
_HOME = {
    "BroadcastChannel": "channel",
    "AgentProcess": "engine.agent_process",
    "Clocks": "dynamics.clocks",
    "CoupledCosts": "problem.costs",
    "Crossing": "engine.control_unit",
    "CustomCosts": "problem.costs",
    "Fleet": "fleet",
    "InputError": "utils.errors",
    "Optimum": "problem.optimum",
    "OverloadWarning": "utils.errors",
    "PolynomialCosts": "problem.costs",
    "Problem": "problem",
    "Recording": "results",
    "Resource": "problem",
    "Result": "results",
    "Sampled": "engine.control_unit",
    "Simulation": "engine.simulation",
    "SimulationError": "utils.errors",
    "Study": "study",
    "load_scenario": "scenario",
    "load_study": "study",
    "model": "scenario.models",
    "normalization_factors": "problem.optimum",
    "run_study": "study",
    "run_synchronous": "synchronous",
    "solve_optimum": "problem.optimum",
}
# Other names of the same things: they are not shown.
_ALIASES = {"Camera": "AgentProcess"}
# Modules that are public as a whole.
_MODULES = {"averaging", "compensation", "interventions", "latency", "loss", "lowlevel", "theory", "topology"}

__all__ = [
    "RESULT_VERSION",
    "AgentProcess",
    "BroadcastChannel",
    "Clocks",
    "CoupledCosts",
    "Crossing",
    "CustomCosts",
    "Fleet",
    "InputError",
    "Optimum",
    "OverloadWarning",
    "PolynomialCosts",
    "Problem",
    "Recording",
    "Resource",
    "Result",
    "Sampled",
    "Simulation",
    "SimulationError",
    "Study",
    "averaging",
    "compensation",
    "interventions",
    "latency",
    "load_scenario",
    "load_study",
    "loss",
    "lowlevel",
    "model",
    "normalization_factors",
    "run_study",
    "run_synchronous",
    "solve_optimum",
    "theory",
    "topology",
]


def __getattr__(name: str) -> "Any":
    """Import what is asked for only then: the command line must start without NumPy and Numba."""
    if name in _HOME:
        return getattr(import_module(f"aimd_des.{_HOME[name]}"), name)
    if name in _MODULES:
        return import_module(f"aimd_des.{name}")
    if (new := _ALIASES.get(name) or _deprecated.new_name(name)) is not None:
        return __getattr__(new)
    raise AttributeError(f"module 'aimd_des' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


_deprecated.install()

# What upper wings do for results and simulations, which import none of them.
register("plot", "aimd_des.plots.overview", "plot_result")
register("save", "aimd_des.scenario.saving", "save_result")
register("fleet", "aimd_des.fleet", "Fleet")
