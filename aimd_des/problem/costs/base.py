"""What all cost families have in common, and the check that costs are convex and increasing."""

from typing import Protocol, runtime_checkable

import numpy as np
from scipy.stats import qmc

from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["Costs", "check_on_box", "sample_box"]

# Second derivatives by central differences are good to about 4e-11 of x * grad f; this leaves a margin.
_ROUNDING = 1e-8


@runtime_checkable
class Costs(Protocol):
    """The private costs f_i of n agents over m resources.

    Attributes
    ----------
    n_agents : int
        Number of agents, n.
    n_resources : int
        Number of resources, m.
    separable : bool
        Whether every f_i is a sum of functions of one resource each (its Hessian is diagonal).
    proven : bool
        Whether the family's parameters alone prove the costs convex and increasing on x >= 0,
        so that no sampling is needed.
    """

    @property
    def n_agents(self) -> int: ...  # noqa: D102 - described with the class

    @property
    def n_resources(self) -> int: ...  # noqa: D102

    @property
    def separable(self) -> bool: ...  # noqa: D102

    @property
    def proven(self) -> bool: ...  # noqa: D102

    def value(self, allocation: FloatArray) -> FloatArray:
        """Evaluate f_i(x_i): (n, m) in units of the resources -> (n,) in units of cost."""
        ...

    def gradient(self, allocation: FloatArray) -> FloatArray:
        """Evaluate grad_j f_i(x_i): (n, m) -> (n, m), cost per unit of the resource."""
        ...

    def hessian(self, allocation: FloatArray) -> FloatArray:
        """Evaluate the second derivatives: (n, m) -> (n, m, m)."""
        ...


def sample_box(upper: FloatArray, n_points: int) -> FloatArray:
    """Spread points over the box 0 < x^j <= upper^j, the upper corner first."""
    unit = qmc.Sobol(len(upper), scramble=False).random_base2(int(np.ceil(np.log2(n_points + 1))))
    unit = 1.0 - unit[:n_points]  # (0, 1]: the first point of the sequence becomes the corner
    unit[n_points // 2 :] **= 3
    return np.asarray(unit * upper)


def check_on_box(costs: Costs, upper: FloatArray, n_points: int = 32) -> None:
    """Check by sampling that every f_i is increasing and convex on the box 0 < x^j <= upper^j."""
    for point in sample_box(upper, n_points):
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
