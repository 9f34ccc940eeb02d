"""What is shared, by how many, and at what private cost: eq. (obj_fn1) of the paper.

minimise sum_i f_i(x_i)  subject to  sum_i x_i^j = C^j and x_i^j >= 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from aimd_des.problem.costs import Costs, check_costs, family
from aimd_des.utils import limits, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import locked, repeated
from aimd_des.utils.replaced import replaced
from aimd_des.utils.shown import Shown, ShowsItself, brief, spread
from aimd_des.utils.validation import FloatArray

# So many resources are named where there is one line for all of them.
_NAMED = 3


@brief
@dataclass(frozen=True, eq=False)
class Resource:
    """One shared resource and the AIMD parameters that go with it.

    Parameters
    ----------
    name : str
        What the frames and figures call it.
    capacity : float
        C > 0, in `unit`.
    increase : float or array_like, shape (n,)
        alpha > 0: what an agent adds per time step (discrete) or per unit of time (continuous),
        in `unit`.
    decrease : float or array_like, shape (n,)
        beta, 0 <= beta < 1: what a response multiplies the demand by.
    normalization : float
        Gamma > 0: scales derivatives of the cost to response probabilities.
    threshold : float
        gamma, 0 < gamma <= 1: a capacity event is due when total demand exceeds
        ``threshold * capacity``.
    unit : str
        The unit of capacity and demand, for labels.
    """

    name: str
    capacity: float
    increase: float | FloatArray
    decrease: float | FloatArray
    normalization: float
    threshold: float = 1.0
    unit: str = ""

    def __post_init__(self) -> None:
        limits.text("name of a resource", self.name)
        limits.text(f"unit of {self.name}", self.unit, empty=True)
        clean = {
            "capacity": validation.number(self._field("capacity"), self.capacity, low=0.0, low_open=True),
            "increase": validation.per_agent(
                self._field("increase"),
                self.increase,
                low=0.0,
                low_open=True,
                remedy="an agent that never adds demand cannot take part",
            ),
            "decrease": validation.per_agent(
                self._field("decrease"),
                self.decrease,
                low=0.0,
                high=1.0,
                high_open=True,
                remedy="a response must reduce the demand",
            ),
            "normalization": validation.number(
                self._field("normalization"), self.normalization, low=0.0, low_open=True
            ),
            "threshold": validation.number(
                self._field("threshold"), self.threshold, low=0.0, low_open=True, high=1.0
            ),
        }
        for name, value in clean.items():
            object.__setattr__(self, name, value)

    def _field(self, name: str) -> str:
        return f"{name} of {self.name}"


class Problem(ShowsItself):
    """n agents that share m resources.

    Parameters
    ----------
    resources : sequence of Resource
        The m resources, with different names.
    costs : Costs
        The private costs of all n agents.
    agent_names : sequence of str, optional
        n different names for the frames; default: "0", "1", ...

    Attributes
    ----------
    n_agents, n_resources : int
        n and m.
    capacity, threshold, normalization : ndarray, shape (m,)
        One value per resource; `threshold` is the share gamma, not its product with C.

    Raises
    ------
    InputError
        If there is no resource, names repeat, shapes do not fit the costs, or the costs are
        not convex and increasing (naming the agent and the point).
    """

    def __init__(
        self, resources: Sequence[Resource], costs: Costs, *, agent_names: Sequence[str] | None = None
    ) -> None:
        self.resources = validation.instances("resources", resources, Resource, "a Resource")
        self.costs = family(costs)
        names = [resource.name for resource in self.resources]
        if not names or len(set(names)) != len(names):
            raise InputError.of("names of the resources", names, "one or more, each different")
        if costs.n_resources != len(names):
            raise InputError.of(
                "costs.n_resources", costs.n_resources, f"{len(names)}, the number of resources"
            )
        self.n_agents, self.n_resources = costs.n_agents, costs.n_resources
        self.capacity = self._row("capacity")
        self.threshold = self._row("threshold")
        self.normalization = self._row("normalization")
        for resource in self.resources:
            for name in ("increase", "decrease"):
                field = f"{name} of {resource.name}"
                validation.fits(field, getattr(resource, name), self.n_agents)
        self._names = None if agent_names is None else self._names_of_agents(agent_names)
        check_costs(costs, self.capacity)

    def replace(self, **parts: Any) -> "Problem":
        """Make the same problem but for some of its arguments.

        Parameters
        ----------
        **parts
            Arguments that are others: `resources`, `costs` and `agent_names`.  Names that were not given
            follow the number of agents.

        Returns
        -------
        Problem
            All other arguments are those of this one.

        Raises
        ------
        InputError
            If there is no such argument, or as the constructor does.

        Examples
        --------
        >>> from dataclasses import replace
        >>> from models import smart_cameras
        >>> problem = smart_cameras(0)
        >>> first, *others = problem.resources
        >>> problem.replace(resources=[replace(first, capacity=20.0), *others]).capacity.tolist()
        [20.0, 20.0, 25.0]
        """
        return replaced(self, {"agent_names": None, **parts} if self.named_by_index else parts)

    @property
    def named_by_index(self) -> bool:
        """Whether agents have the names that they have where none are given: "0", "1", ..."""
        return self._names is None or self._names == self._indices

    def _shown(self) -> Shown:
        heads = ["resource", "capacity", "threshold", "increase", "decrease", "normalization"]
        rows = [
            [
                resource.name,
                capacity_words(resource),
                *(spread(getattr(resource, name)) for name in heads[2:]),
            ]
            for resource in self.resources
        ]
        return Shown(f"Problem: {self.n_agents:,} agents, {type(self.costs).__name__}", heads, rows)

    @property
    def resource_names(self) -> tuple[str, ...]:
        """Names of the resources, in order."""
        return tuple(resource.name for resource in self.resources)

    @property
    def limit(self) -> FloatArray:
        """Total demand above which a capacity event is due: threshold times capacity, shape (m,)."""
        return self.threshold * self.capacity

    @property
    def agent_names(self) -> tuple[str, ...]:
        """Names of the agents, in order."""
        return self._indices if self._names is None else self._names

    @property
    def increase(self) -> FloatArray:
        """What each agent adds to its demand per step or unit of time: alpha, shape (n, m)."""
        return self._increase

    @property
    def decrease(self) -> FloatArray:
        """What a response multiplies each agent's demand by: beta, shape (n, m)."""
        return self._decrease

    def by_resource(self, name: Literal["increase", "decrease"]) -> FloatArray:
        """Spread alpha or beta over the agents, with a row for each resource.

        Parameters
        ----------
        name : {"increase", "decrease"}
            Which of both.

        Returns
        -------
        ndarray, shape (m, n)
            Not to be written to; what is the same for all agents is one number in memory.
        """
        values = [getattr(resource, name) for resource in self.resources]
        if all(isinstance(value, float) for value in values):
            return repeated(values, self.n_agents)
        rows = np.empty((self.n_resources, self.n_agents))
        for row, value in zip(rows, values, strict=True):
            row[:] = value
        return locked(rows)

    # Made when they are read, since no run reads them: of a million agents they are a hundred megabytes.
    @cached_property
    def _indices(self) -> tuple[str, ...]:
        return tuple(map(str, range(self.n_agents)))

    @cached_property
    def _increase(self) -> FloatArray:
        return locked(self.by_resource("increase").T.copy())

    @cached_property
    def _decrease(self) -> FloatArray:
        return locked(self.by_resource("decrease").T.copy())

    def _row(self, name: str) -> FloatArray:
        row = np.array([getattr(resource, name) for resource in self.resources], dtype=np.float64)
        row.setflags(write=False)
        return row

    def _names_of_agents(self, given: Sequence[str]) -> tuple[str, ...]:
        # A string alone is no list of names, though it is one of letters.
        names = tuple(given) if validation.axes(given) else ()
        for i, name in enumerate(names):
            limits.text(f"agent_names[{i}]", name)
        if len(names) != self.n_agents or len(set(names)) != len(names):
            raise InputError.of("agent_names", given, f"{self.n_agents} different names")
        return names


def capacity_words(resource: Resource) -> str:
    """Write a capacity with its unit, which may begin with a number of its own, such as "10 GB"."""
    times = "× " if resource.unit[:1].isdigit() else ""
    return f"{resource.capacity:.6g} {times}{resource.unit}".rstrip()


def shared_words(problem: Problem) -> str:
    """Say how many agents share what, in one line."""
    first = [f"{one.name} {capacity_words(one)}" for one in problem.resources[:_NAMED]]
    more = problem.n_resources - len(first)
    return f"{problem.n_agents:,} agents share {', '.join(first)}{f' and {more:,} more' if more else ''}"
