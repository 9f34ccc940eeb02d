"""What a family of private costs must have, and what it may have besides."""

from typing import Protocol, runtime_checkable

from aimd_des.utils import validation
from aimd_des.utils.validation import FloatArray

__all__ = ["Costs", "family"]

_NAMES = ("n_agents", "n_resources", "separable", "proven", "value", "gradient", "hessian")


@runtime_checkable
class Costs(Protocol):
    """The private costs f_i of n agents over m resources: what any family of them must have.

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

    Notes
    -----
    A family may have besides, and is slower, or does less, without:

    - ``table()``, a `CostTable`: compiled code, of a fleet and of the synchronous algorithm, evaluates it;
    - ``compiled_gradient()``, a function of `numba.njit` with the parameters (agent, averages), an int and
      an array of shape (m,), that returns the m derivatives: a fleet calls it.  With neither, a fleet is
      refused;
    - ``marginal(agent)``, a function of (averages, resource) that returns one derivative: processes call it.
      It must have the bits of the table, or of the compiled gradient;
    - ``scaled(weights)``, the costs times weights > 0 of shape (n, 1), or (n, m) if the family can do that;
    - ``select(agents)``, the costs of agents by their indices;
    - ``steepest_at_corners``, True where derivative over allocation is largest at a corner of every box:
      normalization factors then are found without a search.
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


def family(costs: Costs) -> Costs:
    """Take in costs of any family."""
    missing = [name for name in _NAMES if not hasattr(costs, name)]
    remedy = f"{type(costs).__name__} has no {', '.join(missing)}" if 0 < len(missing) < len(_NAMES) else ""
    allowed = "costs, such as PolynomialCosts or CustomCosts"
    return validation.instance("costs", costs, Costs, allowed, remedy)
