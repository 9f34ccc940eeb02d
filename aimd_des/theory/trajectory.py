"""The solution of a differential equation, followed only as far as it is needed."""

from bisect import bisect_left
from collections.abc import Callable
from math import inf

import numpy as np
from scipy.integrate import RK45, DenseOutput

from aimd_des.utils.errors import SimulationError
from aimd_des.utils.validation import FloatArray

_ACCURACY = 3e-5
# Within a longer step the interpolation is off by more than the step.
_STRIDE = 0.5
# What moves by no more than this part of itself is at rest.
_RESTS = 1e-13

Slope = Callable[[float, FloatArray], FloatArray]


class Trajectory:
    """States over a variable that grows; what has been asked before changes none of them."""

    def __init__(self, slope: Slope, begin: float, state: FloatArray, end: float = inf) -> None:
        # Resources have units of their own.
        self._scale = np.broadcast_to(np.abs(state).max(axis=1, keepdims=True), state.shape)
        self._solver = RK45(
            lambda at, flat: (slope(at, self._unscaled(flat)) / self._scale).ravel(),
            begin,
            (state / self._scale).ravel(),
            end,
            rtol=_ACCURACY,
            atol=_ACCURACY,
            max_step=_STRIDE,
        )
        self._steps: list[DenseOutput] = []
        self._ends: list[float] = []

    def __call__(self, at: float) -> FloatArray:
        """Give the state there, in the shape of the first one."""
        while not self._ends or (self._ends[-1] < at and not self._at_rest()):
            if (trouble := self._solver.step()) is not None:
                raise SimulationError(f"the way of the averages is lost: {trouble}")
            self._steps.append(self._solver.dense_output())
            self._ends.append(float(self._solver.t))
        step = self._steps[min(bisect_left(self._ends, at), len(self._steps) - 1)]
        return self._unscaled(step(min(at, self._ends[-1])))

    def _unscaled(self, flat: FloatArray) -> FloatArray:
        return np.asarray(flat.reshape(self._scale.shape) * self._scale)

    def _at_rest(self) -> bool:
        solver = self._solver
        return solver.status != "running" or bool((np.abs(solver.f) <= _RESTS * np.abs(solver.y)).all())
