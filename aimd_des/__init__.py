"""Simulation of asynchronous AIMD resource allocation with one-bit capacity signals."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aimd_des import (interventions, latency, loss, theory, topology)
    from aimd_des.dynamics import averaging
    from aimd_des.dynamics import loss_compensation as compensation
    from aimd_des.fleet import Camera, Fleet
    from aimd_des.channel import BroadcastChannel
    from aimd_des.dynamics.clocks import Clocks
    from aimd_des.engine.control_unit import Crossing, Sampled
    from aimd_des.problem.costs import CoupledCosts, CustomCosts, PolynomialCosts
    from aimd_des.synchronous.synchronous import run_discrete
    from aimd_des.utils.errors import InputError, SimulationError
    from aimd_des.problem.optimum import Optimum, normalization_factors, solve_optimum
    from aimd_des.problem.problem import Problem, Resource
    from aimd_des.results.recording import Recording
    from aimd_des.scenario.models import model
    from aimd_des.results.result import Result
    from aimd_des.scenario import load_scenario
    from aimd_des.engine.simulation import Simulation
    from aimd_des.study import Study, load_study, run_study

__version__ = "0.1.0"

#: Raised when a scenario gives other results than before: see lines of the changelog tagged **Results**.
RESULT_VERSION = 1

# Where each public name lives.
_HOME = {
    "BroadcastChannel": "channel",
    "Camera": "agents",
    "Clocks": "clock",
    "CoupledCosts": "costs",
    "Crossing": "control_unit",
    "CustomCosts": "costs",
    "Fleet": "agents",
    "InputError": "errors",
    "Optimum": "optimum",
    "PolynomialCosts": "costs",
    "Problem": "problem",
    "Recording": "recording",
    "Resource": "problem",
    "Result": "results",
    "Sampled": "control_unit",
    "Simulation": "simulation",
    "SimulationError": "errors",
    "Study": "study",
    "load_scenario": "scenario",
    "load_study": "study",
    "model": "registry",
    "normalization_factors": "optimum",
    "run_discrete": "discrete",
    "run_study": "study",
    "solve_optimum": "optimum",
}
# Modules that are public as a whole.
_MODULES = {"averaging", "compensation", "interventions", "latency", "loss", "theory", "topology"}

__all__ = [
    "RESULT_VERSION",
    "BroadcastChannel",
    "Camera",
    "Clocks",
    "CoupledCosts",
    "Crossing",
    "CustomCosts",
    "Fleet",
    "InputError",
    "Optimum",
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
    "model",
    "normalization_factors",
    "run_discrete",
    "run_study",
    "solve_optimum",
    "theory",
    "topology",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for only then: the command line must start without NumPy and Numba."""
    if name in _HOME:
        return getattr(import_module(f"aimd_des.{_HOME[name]}"), name)
    if name in _MODULES:
        return import_module(f"aimd_des.{name}")
    raise AttributeError(f"module 'aimd_des' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
