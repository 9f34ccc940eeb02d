"""Costs of one's own: prices that rise exponentially with what an agent holds."""

from collections.abc import Sequence

import numba
import numpy as np

from aimd_des import CustomCosts, checks
from aimd_des.lowlevel import FloatArray, expm1, part


@part("costs")
def rising(weights: Sequence[float], n_resources: int = 1, steepness: float = 1.0) -> CustomCosts:
    """Costs w_i * sum_j (exp(s * x_j) - 1 - s * x_j), with s the steepness.

    Parameters
    ----------
    weights : sequence of float, shape (n,)
        w_i of each agent, greater than 0, in units of cost.
    n_resources : int
        m.
    steepness : float
        s, greater than 0, in 1 / the unit of the resources.
    """
    weight = checks.array("rising.weights", weights, (len(weights),), low=0.0, low_open=True)
    s = checks.number("rising.steepness", steepness, low=0.0, low_open=True)

    def value(agent: int, x: FloatArray) -> float:
        return float(weight[agent] * sum(expm1(s * one) - s * one for one in x))

    # Compiled, so that a fleet can call it; processes call the same code.
    @numba.njit
    def gradient(agent: int, x: FloatArray) -> FloatArray:
        out = np.empty(n_resources)
        for j in range(n_resources):
            out[j] = weight[agent] * s * expm1(s * x[j])
        return out

    def hessian(agent: int, x: FloatArray) -> FloatArray:
        return np.diag([weight[agent] * s * s * (1.0 + expm1(s * one)) for one in x])

    return CustomCosts(len(weight), n_resources, value, gradient, hessian, separable=True)
