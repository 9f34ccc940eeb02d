"""The solution of a differential equation, followed only as far as somebody asks."""

from bisect import bisect_left
from collections.abc import Callable
from math import inf

import numpy as np
from scipy.integrate import DOP853, DenseOutput

from aimd_des.utils.errors import SimulationError
from aimd_des.utils.validation import FloatArray

_ACCURACY = 1e-6
# Within a longer step the interpolation is off by more than the step.
_STRIDE = 1.0

Slope = Callable[[float, FloatArray], FloatArray]


class Trajectory:
    """States over a variable that grows; what has been asked before changes none of them."""

    def __init__(self, slope: Slope, begin: float, state: FloatArray, end: float = inf) -> None:
        self._shape = state.shape
        self._solver = DOP853(
            lambda at, flat: slope(at, flat.reshape(self._shape)).ravel(),
            begin,
            state.ravel(),
            end,
            rtol=_ACCURACY,
            atol=_ACCURACY * float(np.abs(state).max()),
            max_step=_STRIDE,
        )
        self._steps: list[DenseOutput] = []
        self._ends: list[float] = []

    def __call__(self, at: float) -> FloatArray:
        """Give the state there, in the shape of the first one."""
        while self._solver.status == "running" and (not self._ends or self._ends[-1] < at):
            if (trouble := self._solver.step()) is not None:
                raise SimulationError(f"the way of the averages is lost: {trouble}")
            self._steps.append(self._solver.dense_output())
            self._ends.append(float(self._solver.t))
        step = self._steps[min(bisect_left(self._ends, at), len(self._steps) - 1)]
        return np.asarray(step(at)).reshape(self._shape)
