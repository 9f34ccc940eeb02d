"""Costs from the user's own functions, one agent at a time."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.checks import straddle
from aimd_des.problem.costs.marginal import Marginal
from aimd_des.utils import validation
from aimd_des.utils.compiled_call import is_compiled
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


class CustomCosts:
    """Costs given by functions of (agent, allocation).

    Parameters
    ----------
    n_agents : int
        Number of agents, n.
    n_resources : int
        Number of resources, m.
    value : callable
        ``value(agent, allocation) -> float``: f_i at the agent's allocation, an (m,) array in
        units of the resources.
    gradient : callable
        ``gradient(agent, allocation) -> (m,)``: its partial derivatives.
    hessian : callable, optional
        ``hessian(agent, allocation) -> (m, m)``: its second derivatives; default: central differences of the
        gradient.
    separable : bool
        Whether no f_i couples resources; only tells, nothing is faster for it.

    Raises
    ------
    InputError
        If a size is no positive integer, or something that should be a function cannot be called.

    Notes
    -----
    `Problem` holds the gradient against finite differences of the value and checks that the
    costs are convex and increasing, on samples of the box that the capacities span.

    Examples
    --------
    >>> costs = CustomCosts(
    ...     2, 1, value=lambda i, x: (i + 1) * x[0] ** 2, gradient=lambda i, x: [2 * (i + 1) * x[0]]
    ... )
    >>> costs.gradient(np.array([[1.0], [1.0]])).tolist()
    [[2.0], [4.0]]
    """

    proven = False

    def __init__(
        self,
        n_agents: int,
        n_resources: int,
        value: Callable[[int, FloatArray], float],
        gradient: Callable[[int, FloatArray], npt.ArrayLike],
        hessian: Callable[[int, FloatArray], npt.ArrayLike] | None = None,
        *,
        separable: bool = False,
    ) -> None:
        self.n_agents = validation.integer("n_agents", n_agents, low=1)
        self.n_resources = validation.integer("n_resources", n_resources, low=1)
        for name, function in (("value", value), ("gradient", gradient), ("hessian", hessian)):
            if not callable(function) and not (name == "hessian" and function is None):
                raise InputError.of(name, function, "a function of (agent, allocation)")
        self.agent_value = value
        self.agent_gradient = gradient
        self.agent_hessian = hessian
        self.separable = validation.flag("separable", separable)

    def value(self, allocation: FloatArray) -> FloatArray:
        """Evaluate f_i(x_i).

        Parameters
        ----------
        allocation : ndarray, shape (n, m)
            In units of the resources.

        Returns
        -------
        ndarray, shape (n,)
            In units of cost.
        """
        return _of_all("value", self.agent_value, allocation, ())

    @described_like(value)
    def gradient(self, allocation: FloatArray) -> FloatArray:
        """Evaluate grad_j f_i(x_i).

        Returns
        -------
        ndarray, shape (n, m)
            In units of cost per unit of the resource.
        """
        return _of_all("gradient", self.agent_gradient, allocation, (self.n_resources,))

    @described_like(value)
    def hessian(self, allocation: FloatArray) -> FloatArray:
        """Evaluate the second derivatives of f_i at x_i, by differences where no function is given.

        Returns
        -------
        ndarray, shape (n, m, m)
            In units of cost per product of the two resources' units.
        """
        if self.agent_hessian is not None:
            shape = (self.n_resources, self.n_resources)
            return _of_all("hessian", self.agent_hessian, allocation, shape)
        columns = []
        for resource in range(self.n_resources):
            ahead, behind, width = straddle(allocation, resource)
            columns.append((self.gradient(ahead) - self.gradient(behind)) / width[:, None])
        half = np.stack(columns, axis=2)
        return np.asarray(0.5 * (half + half.transpose(0, 2, 1)))

    def marginal(self, agent: int) -> Marginal:
        """Return one agent's partial derivative, as a process calls it.

        Parameters
        ----------
        agent : int
            i.

        Returns
        -------
        callable
            A function of (averages, resource).
        """
        own = self.agent_gradient
        return lambda averages, resource: float(np.asarray(own(agent, np.array(averages)))[resource])

    def compiled_gradient(self) -> Callable[..., Any] | None:
        """Return the gradient function as a fleet calls it.

        Returns
        -------
        callable or None
            Compiled if it was decorated with `numba.njit`; None otherwise.
        """
        return self.agent_gradient if is_compiled(self.agent_gradient) else None


def _of_all(
    name: str,
    function: Callable[[int, FloatArray], npt.ArrayLike],
    allocation: FloatArray,
    shape: tuple[int, ...],
) -> FloatArray:
    """Call a function of the user's for every agent; refuse what it returns if it has another shape."""
    table = np.empty((len(allocation), *shape))
    for agent, row in enumerate(allocation):
        returned = function(agent, row)
        field = f"{name}(agent={agent})"
        try:
            if returned is None:  # which NumPy takes for not a number
                raise TypeError
            clean = np.asarray(returned, dtype=float)
        except (TypeError, ValueError):
            allowed = f"numbers of shape {shape}" if shape else "a number"
            raise InputError.of(field, returned, allowed) from None
        if clean.shape != shape:
            raise InputError.of(f"shape of {field}", clean.shape, f"{shape}")
        table[agent] = clean
    return table
