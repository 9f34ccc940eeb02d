"""What is asked of costs of any family: its own method does it, or a slower one that any family has.

Nothing here asks of which family costs are.
"""

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs.base import Costs, family
from aimd_des.problem.costs.marginal import Marginal, table_marginal
from aimd_des.problem.costs.table import CostTable, no_table
from aimd_des.utils import validation
from aimd_des.utils.compiled_call import is_compiled
from aimd_des.utils.errors import InputError
from aimd_des.utils.returned_values import calling, said_by
from aimd_des.utils.validation import FloatArray, IntArray


def _own(costs: Costs, method: str, *given: Any) -> Any:
    """Ask the family; None where it has no such method."""
    own = getattr(costs, method, None)
    return None if own is None else own(*given)


def cost_table(costs: Costs) -> CostTable:
    """Lay out the costs for compiled code; with no agents where the family does not."""
    table = _own(costs, "table")
    if table is None:
        return no_table()
    field = said_by(costs, "table")
    validation.instance(field, table, CostTable, "a CostTable, or None")
    shape, wanted = table.slopes.shape[::2], (costs.n_resources, costs.n_agents)
    if shape != wanted:
        raise InputError.of(f"resources and agents of {field}", shape, f"{wanted}")
    return table  # type: ignore[no-any-return]  # it is one


def compiled_gradient(costs: Costs) -> Callable[..., Any] | None:
    """Return the gradient of one agent as compiled code can call it, if the family has one."""
    gradient: Callable[..., Any] | None = _own(costs, "compiled_gradient")
    if gradient is not None and not is_compiled(gradient):
        allowed = "a function decorated with numba.njit, or None"
        raise InputError.of(said_by(costs, "compiled_gradient"), gradient, allowed)
    return gradient


def steepest_at_corners(costs: Costs) -> bool:
    """Tell whether derivative over allocation is known to be largest at a corner of every box."""
    return bool(getattr(costs, "steepest_at_corners", False))


def marginal_cost(costs: Costs, agent: int) -> Marginal:
    """Return one agent's partial derivative in plain Python, bit for bit what compiled code computes."""
    own: Marginal | None = _own(costs, "marginal", agent)
    if (table := cost_table(costs)).n_agents:
        return table_marginal(table, agent) if own is None else own
    if own is not None:
        return _checked(costs, own)
    if (gradient := compiled_gradient(costs)) is not None:
        return _checked(costs, lambda averages, j: gradient(agent, np.array(averages))[j])
    shape = costs.n_agents, 1
    return _checked(costs, lambda averages, j: costs.gradient(np.tile(averages, shape))[agent, j])


def _checked(costs: Costs, derivative: Callable[[Sequence[float], int], Any]) -> Marginal:
    """Refuse what is no derivative, where no table says that all are."""
    field = said_by(costs, "gradient")

    def marginal(averages: Sequence[float], resource: int) -> float:
        with calling(field):
            returned = derivative(averages, resource)
        return validation.number(field, returned)

    return marginal


def weighted_costs(costs: Costs, weights: npt.ArrayLike) -> Costs:
    """Scale the costs of each agent.

    Parameters
    ----------
    costs : Costs
        Of any family.
    weights : array_like, shape (n,) or (n, m)
        Greater than 0; with a column for each resource only for families that can do that: all of ours but
        `CoupledCosts` and `CustomCosts`.

    Returns
    -------
    Costs
        Of the same family where that has a method ``scaled``, as all of ours have.

    Raises
    ------
    InputError
        If the weights do not fit these costs.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts
    >>> costs = PolynomialCosts([2], [[[1.0]], [[1.0]]])
    >>> weighted_costs(costs, [1.0, 3.0]).gradient(np.array([[1.0], [1.0]])).tolist()
    [[2.0], [6.0]]
    """
    n, m = family(costs).n_agents, costs.n_resources
    shape = (n,) if validation.axes(weights) == 1 else (n, m)
    table = validation.array("weights", weights, shape, low=0.0, low_open=True).reshape(n, -1)
    own: Costs | None = _own(costs, "scaled", table)
    return _Scaled(costs, one_each(table)) if own is None else own


def one_each(weights: FloatArray) -> FloatArray:
    """Take weights that are the same for all resources, (n, m) -> (n,), or refuse them."""
    if (weights != weights[:, :1]).any():
        raise InputError.of(
            "weights", "that differ from resource to resource", "one number for each agent with these costs"
        )
    return weights[:, 0]


def selected_costs(costs: Costs, chosen: npt.ArrayLike) -> Costs:
    """Take out the costs of some agents.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts
    >>> costs = PolynomialCosts([2], [[[1.0]], [[2.0]], [[3.0]]])
    >>> selected_costs(costs, [True, False, True]).gradient(np.array([[1.0], [1.0]])).tolist()
    [[2.0], [6.0]]
    """
    kept = np.flatnonzero(chosen)
    own: Costs | None = _own(costs, "select", kept)
    return _Selected(costs, kept) if own is None else own


class _Derived:
    """Costs made from others of any family."""

    def __init__(self, costs: Costs, n_agents: int) -> None:
        self.inner = costs
        self.n_agents, self.n_resources = n_agents, costs.n_resources
        self.separable, self.proven = costs.separable, costs.proven


class _Scaled(_Derived):
    """Each agent's costs times a factor."""

    def __init__(self, costs: Costs, factors: FloatArray) -> None:
        super().__init__(costs, costs.n_agents)
        self.factors = factors

    def value(self, allocation: FloatArray) -> FloatArray:
        return self.factors * self.inner.value(allocation)

    def gradient(self, allocation: FloatArray) -> FloatArray:
        return self.factors[:, None] * self.inner.gradient(allocation)

    def hessian(self, allocation: FloatArray) -> FloatArray:
        return self.factors[:, None, None] * self.inner.hessian(allocation)

    def table(self) -> CostTable | None:
        table = cost_table(self.inner)
        return table.scaled(self.factors) if table.n_agents else None

    def marginal(self, agent: int) -> Marginal | None:
        if cost_table(self.inner).n_agents:
            return None  # as the scaled table has it, to the last bit
        factor, own = float(self.factors[agent]), marginal_cost(self.inner, agent)
        return lambda averages, resource: factor * own(averages, resource)

    def compiled_gradient(self) -> Callable[..., Any] | None:
        own, factors, m = compiled_gradient(self.inner), self.factors, self.n_resources
        if own is None:
            return None
        import numba

        @numba.njit  # type: ignore[untyped-decorator]  # numba has no type information
        def gradient(agent: int, averages: FloatArray) -> FloatArray:
            values, scaled = own(agent, averages), np.empty(m)
            for j in range(m):
                scaled[j] = factors[agent] * values[j]
            return scaled

        return cast(Callable[..., Any], gradient)


class _Selected(_Derived):
    """The costs of some agents, evaluated among those of all."""

    def __init__(self, costs: Costs, kept: IntArray) -> None:
        super().__init__(costs, len(kept))
        self.kept = kept

    def _of_all(self, allocation: FloatArray) -> FloatArray:
        # Others are evaluated somewhere, and dropped: where the first of those that are kept is.
        everybody = np.tile(allocation[0], (self.inner.n_agents, 1))
        everybody[self.kept] = allocation
        return everybody

    def value(self, allocation: FloatArray) -> FloatArray:
        return self.inner.value(self._of_all(allocation))[self.kept]

    def gradient(self, allocation: FloatArray) -> FloatArray:
        return self.inner.gradient(self._of_all(allocation))[self.kept]

    def hessian(self, allocation: FloatArray) -> FloatArray:
        return self.inner.hessian(self._of_all(allocation))[self.kept]
