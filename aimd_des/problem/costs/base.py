"""What a family of private costs must have, and what it may have besides."""

from typing import Protocol, runtime_checkable

from aimd_des.problem.costs.marginal import Marginal
from aimd_des.problem.costs.table import CostTable
from aimd_des.utils import validation
from aimd_des.utils.validation import FloatArray, IntArray

_NAMES = ("n_agents", "n_resources", "separable", "proven", "value", "gradient", "hessian")


@runtime_checkable
class Costs(Protocol):
    """The private costs f_i of n agents over m resources: what any family of them must have.

    It may have the methods of `CostMethods` besides.

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


class CostMethods(Protocol):
    """What a family of costs may have besides, each by itself; without, it is slower or does less.

    Besides these, ``compiled_gradient()`` may return a function of `numba.njit` with the parameters (agent,
    averages), an int and an array of shape (m,), that returns the m derivatives: fleets call it where there
    is no table.  With neither, a fleet is refused.  ``steepest_at_corners`` may be True where derivative over
    allocation is largest at a corner of every box: normalization factors are then found without a search.
    """

    def table(self) -> CostTable | None:
        """Lay out the derivatives for compiled code, of fleets and of the synchronous algorithm."""
        ...

    def marginal(self, agent: int) -> Marginal:
        """Return one agent's derivative, a function of (averages, resource), with the bits of the table."""
        ...

    def scaled(self, weights: FloatArray) -> Costs:
        """Multiply the costs by weights > 0 of shape (n, 1), or (n, m) if the family can do that."""
        ...

    def select(self, agents: IntArray) -> Costs:
        """Take out the costs of agents, by their indices in ascending order."""
        ...


def family(costs: Costs) -> Costs:
    """Take in costs of any family."""
    missing = [name for name in _NAMES if not hasattr(costs, name)]
    remedy = f"{type(costs).__name__} has no {', '.join(missing)}" if 0 < len(missing) < len(_NAMES) else ""
    allowed = "costs, such as PolynomialCosts or CustomCosts"
    return validation.instance("costs", costs, Costs, allowed, remedy)
