"""Simulation of asynchronous AIMD resource allocation with one-bit capacity signals."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aimd_des.costs import CoupledCosts, CustomCosts, PolynomialCosts
    from aimd_des.discrete import run_discrete
    from aimd_des.errors import InputError, SimulationError
    from aimd_des.optimum import Optimum, solve_optimum
    from aimd_des.problem import Problem, Resource
    from aimd_des.recording import Recording
    from aimd_des.results import Result

__version__ = "0.1.0"

_HOME = {
    "CoupledCosts": "costs",
    "CustomCosts": "costs",
    "InputError": "errors",
    "Optimum": "optimum",
    "PolynomialCosts": "costs",
    "Problem": "problem",
    "Recording": "recording",
    "Resource": "problem",
    "Result": "results",
    "SimulationError": "errors",
    "run_discrete": "discrete",
    "solve_optimum": "optimum",
}

__all__ = [
    "CoupledCosts",
    "CustomCosts",
    "InputError",
    "Optimum",
    "PolynomialCosts",
    "Problem",
    "Recording",
    "Resource",
    "Result",
    "SimulationError",
    "run_discrete",
    "solve_optimum",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for only then: the command line must start without NumPy and Numba."""
    if name in _HOME:
        return getattr(import_module(f"aimd_des.{_HOME[name]}"), name)
    raise AttributeError(f"module 'aimd_des' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
