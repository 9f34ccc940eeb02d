"""Checks of what the closed forms are given: numbers or arrays of any shape that broadcast together."""

from typing import TypedDict, get_args

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import Dynamics
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


class _Range(TypedDict, total=False):
    low: float
    high: float
    low_open: bool
    high_open: bool


_POSITIVE: _Range = {"low": 0.0, "low_open": True}
_NOT_NEGATIVE: _Range = {"low": 0.0}
_BELOW_ONE: _Range = {"low": 0.0, "high": 1.0, "high_open": True}
_PROBABILITY: _Range = {"low": 0.0, "low_open": True, "high": 1.0}

# A name means the same in all formulas, so its range stands here once.
_RANGES: dict[str, _Range] = {
    "average": _POSITIVE,
    "capacity": _POSITIVE,
    "decrease": _BELOW_ONE,
    "elasticity": _POSITIVE,
    "increase": _POSITIVE,
    "latency": _NOT_NEGATIVE,
    "loss": _BELOW_ONE,
    "multiplier": _POSITIVE,
    "n_agents": {"low": 1.0},
    "normalization": _POSITIVE,
    "packet_loss": _PROBABILITY,
    "period": _NOT_NEGATIVE,
    "probability": _PROBABILITY,
    "rate": _POSITIVE,
    "hold_off": _NOT_NEGATIVE,
    "share": _PROBABILITY,
    "signal_share": _BELOW_ONE,
}


def arguments(**given: npt.ArrayLike) -> list[FloatArray]:
    """Check the arguments of a formula."""
    clean = [_clean(name, value) for name, value in given.items()]
    try:
        np.broadcast_shapes(*(values.shape for values in clean))
    except ValueError:
        shapes = [values.shape for values in clean]
        raise InputError.of(f"shapes of {', '.join(given)}", shapes, "such that they broadcast") from None
    return clean


def _clean(name: str, value: npt.ArrayLike) -> FloatArray:
    axes = validation.axes(value)
    if axes == 0:
        return np.array(validation.number(name, value, **_RANGES[name]))
    return validation.array(name, value, [f"axis {axis}" for axis in range(axes)], **_RANGES[name])


def check_dynamics(dynamics: str) -> None:
    """Refuse a name of dynamics that is not known."""
    validation.choice("dynamics", dynamics, get_args(Dynamics))
