"""Costs are held against what they promise before anything runs: on samples of a box."""

import numpy as np

from aimd_des.problem.costs.base import Costs
from aimd_des.utils.errors import InputError
from aimd_des.utils.returned_values import said_by
from aimd_des.utils.validation import FloatArray

# Second derivatives by central differences are good to about 4e-11 of x * grad f; this leaves a margin.
_ROUNDING = 1e-8

# A central difference with this relative step is good to about 1e-9 of the derivative's scale;
# the tolerance leaves three digits for functions that are themselves rounded.
_STEP = np.cbrt(np.finfo(float).eps)
_TOLERANCE = 1e-6


def check_costs(costs: Costs, upper: FloatArray) -> None:
    """Refuse costs that do not keep to the contract on the box 0 < x^j <= upper^j."""
    if not costs.proven:
        _check_returned(costs, upper)
        check_gradient(costs, upper)
        check_on_box(costs, upper)


def _check_returned(costs: Costs, upper: FloatArray) -> None:
    """Look once at what the methods return: arrays of numbers, of their shapes, finite at the corner."""
    n, m = costs.n_agents, costs.n_resources
    for method, shape in (("value", (n,)), ("gradient", (n, m)), ("hessian", (n, m, m))):
        field = said_by(costs, method)
        with np.errstate(all="ignore"):  # what is not finite is refused by name
            returned = getattr(costs, method)(np.tile(upper, (n, 1)))
        if not isinstance(returned, np.ndarray) or returned.dtype.kind not in "iuf":
            raise InputError.of(field, returned, f"an array of numbers of shape {shape}")
        if returned.shape != shape:
            raise InputError.of(f"shape of {field}", returned.shape, f"{shape}")
        finite = np.isfinite(returned)
        if not finite.all():
            place = tuple(int(index) for index in np.argwhere(~finite)[0])
            where = np.array2string(upper, precision=6, separator=", ")
            name = f"{field} of agent {place[0]} at x = {where}"
            raise InputError.of(name, float(returned[place]), "finite where an agent holds all that there is")


def straddle(allocation: FloatArray, resource: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move one coordinate a step up and a step down; costs need not be defined below zero, so stop there."""
    own = allocation[:, resource]
    # A step in proportion to the coordinate; where that is next to nothing, to what others hold.
    step = _STEP * np.maximum(own, 1e-3 * own.max() or 1e-3)
    ahead, behind = allocation.copy(), allocation.copy()
    ahead[:, resource] += step
    behind[:, resource] = np.maximum(behind[:, resource] - step, 0.0)
    return ahead, behind, ahead[:, resource] - behind[:, resource]


def check_gradient(costs: Costs, upper: FloatArray) -> None:
    """Hold the gradient against central differences of the value on samples of the box."""
    for point in sample_box(upper, 8):
        allocation = np.tile(point, (costs.n_agents, 1))
        gradient = costs.gradient(allocation)
        scale = np.abs(gradient).max(axis=1)
        for resource in range(costs.n_resources):
            ahead, behind, width = straddle(allocation, resource)
            values = costs.value(ahead), costs.value(behind)
            slope = (values[0] - values[1]) / width
            # What rounding of the values themselves leaves in their difference.
            noise = 8 * np.finfo(float).eps * np.maximum(*np.abs(values)) / width
            wrong = ~(np.abs(slope - gradient[:, resource]) <= _TOLERANCE * scale + noise)
            if wrong.any():
                agent = int(np.argmax(wrong))
                where = np.array2string(point, precision=6, separator=", ")
                raise InputError.of(
                    f"{said_by(costs, 'gradient')} of agent {agent} by resource {resource} at x = {where}",
                    float(gradient[agent, resource]),
                    f"the derivative of value, {slope[agent]:.9g} by central differences",
                    "correct the gradient",
                )


def sample_box(upper: FloatArray, n_points: int) -> FloatArray:
    """Spread points over the box 0 < x^j <= upper^j, the upper corner first."""
    from scipy.stats import qmc  # slow to import, and not for costs whose properties are known

    unit = qmc.Sobol(len(upper), scramble=False).random_base2(int(np.ceil(np.log2(n_points + 1))))
    unit = 1.0 - unit[:n_points]  # (0, 1]: the first point of the sequence becomes the corner
    unit[n_points // 2 :] **= 3
    return np.asarray(unit * upper)


def check_on_box(costs: Costs, upper: FloatArray) -> None:
    """Check by sampling that every f_i is increasing and convex on the box 0 < x^j <= upper^j."""
    for point in sample_box(upper, 32):
        allocation = np.tile(point, (costs.n_agents, 1))
        where = f"x = {np.array2string(point, precision=6, separator=', ')}"
        with np.errstate(all="ignore"):  # what is not finite is refused by name
            value, gradient = costs.value(allocation), costs.gradient(allocation)
        finite = np.isfinite(value) & np.isfinite(gradient).all(axis=1)
        if not finite.all():
            agent = int(np.argmin(finite))
            raise InputError.of(
                f"cost of agent {agent} at {where}", float(value[agent]), "finite, with finite derivatives"
            )
        if (gradient <= 0).any():
            agent, resource = (int(index) for index in np.argwhere(gradient <= 0)[0])
            raise InputError.of(
                f"derivative of the cost of agent {agent} by resource {resource} at {where}",
                float(gradient[agent, resource]),
                "positive",
                "costs must increase with every resource",
            )
        # In shares of the point, so that units do not matter; held against what the cost grows by there.
        hessian = costs.hessian(allocation) * (point[:, None] * point)
        eigenvalues = np.linalg.eigvalsh(hessian)
        concave = eigenvalues[:, 0] < -_ROUNDING * (gradient * point).sum(axis=1)
        if concave.any():
            agent = int(np.argmax(concave))
            raise InputError.of(
                f"smallest eigenvalue of the Hessian of the cost of agent {agent} at {where}",
                float(eigenvalues[agent, 0]),
                "at least 0",
                "costs must be convex",
            )
