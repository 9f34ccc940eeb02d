"""The centralised optimum: eq. (obj_fn1) of the paper, by a method that is linear in n.

minimise sum_i f_i(x_i)  subject to  sum_i x_i^j = C^j and x_i^j >= 0.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des.problem.optimum.interior_point import follow_central_path
from aimd_des.problem.optimum.newton import NEAR, newton_steps
from aimd_des.problem.optimum.scaled_costs import Candidate, ScaledCosts
from aimd_des.problem.optimum.starting_point import power_law_start
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import SimulationError
from aimd_des.utils.shown import Shown, ShowsItself, spread
from aimd_des.utils.validation import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(ShowsItself):
    """The solution of the centralised problem.

    Attributes
    ----------
    allocation : ndarray, shape (n, m)
        x*, in units of the resources.  All are positive: what should be 0 is a rounding error of
        the equal share C / n.
    multipliers : ndarray, shape (m,)
        nu: the derivative of the cost common to all agents that hold some of the resource, in
        units of cost per unit of the resource.
    cost : float
        sum_i f_i(x*_i), in units of cost.
    kkt_residual : float
        How far the Karush-Kuhn-Tucker conditions are from holding, as `solve_optimum` defines it.
    iterations : int
        Newton steps taken; 0 where the start was already as good as asked for.
    """

    allocation: FloatArray
    multipliers: FloatArray
    cost: float
    kkt_residual: float
    iterations: int

    def _shown(self) -> Shown:
        n, m = self.allocation.shape
        title = f"Optimum: {n:,} agents, cost {self.cost:.6g}, KKT residual {self.kkt_residual:.2g}"
        rows = [[str(j), f"{self.multipliers[j]:.6g}", spread(self.allocation[:, j])] for j in range(m)]
        return Shown(title, ["resource", "multiplier", "allocation of an agent"], rows)


def solve_optimum(
    problem: Problem,
    *,
    capacity: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_iterations: int = 500,
) -> Optimum:
    """Minimise the total cost of using up the capacities.

    Parameters
    ----------
    problem : Problem
        The agents' costs and the capacities.
    capacity : array_like, shape (m,), optional
        Capacities > 0 to use instead of the problem's, in units of the resources: with the totals
        of the averages in a run, the optimum that `misallocation` compares with.
    tolerance : float
        The KKT residual to reach, 1e-14 to 1e-2.
    max_iterations : int
        Newton steps after which to give up; 1 to 15 are usual, 50 are many.

    Returns
    -------
    Optimum
        Allocation, multipliers, cost and the residual reached.

    Raises
    ------
    InputError
        If a capacity, the tolerance or the number of iterations is outside its range.
    SimulationError
        If the residual stays above the tolerance; the message names the residual reached.

    Notes
    -----
    The KKT residual is the largest, over agents i and resources j, of

    - feasibility: abs(sum_i x_i^j - C^j) / C^j,
    - stationarity, nonnegativity and complementarity in one: abs(min(s, d)),
    - complementarity once more, as a part of what an equal share costs: s * max(d, 0),

    with the share s = x_i^j / (C^j / n) and the reduced gradient d = grad_j f_i(x_i) / nu^j - 1.
    It is free of units and 0 exactly at an optimum.  Where the costs are strictly convex the
    optimum is unique; where they are not, the allocation is one of several of the same cost.

    Floats reach their limit, and the error may follow, for costs that couple resources and are linear in
    some direction, if prices C^j nu^j differ by a factor of 1e12 or more.

    Source: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., 2006, chapters 14 and 19.

    Examples
    --------
    With costs x**2 and 3 x**2 the second agent gets a third of what the first gets:

    >>> from aimd_des import PolynomialCosts
    >>> from aimd_des.problem import Problem, Resource
    >>> memory = Resource("memory", capacity=4.0, increase=0.01, decrease=0.5, normalization=0.01)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]], [[3.0]]]))
    >>> solve_optimum(problem).allocation.round(6).tolist()
    [[3.0], [1.0]]
    """
    validation.instance("problem", problem, Problem, "a Problem")
    given = problem.capacity if capacity is None else capacity
    total = validation.array("capacity", given, (problem.n_resources,), low=0.0, low_open=True)
    wanted = validation.number("tolerance", tolerance, low=1e-14, high=1e-2)
    last = validation.integer("max_iterations", max_iterations, low=1)
    scaled = ScaledCosts(problem.costs, total / problem.n_agents)
    # Trial points may overflow steep costs: the line search turns back from values that are not
    # finite, and a residual that is not finite ends in the error below.
    with np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore"):
        point, iterations = _search(scaled, wanted, last)
    if not point.residual <= wanted:
        raise SimulationError(
            f"optimum not found: KKT residual {point.residual:.3g} after {iterations} iterations, wanted at"
            f" most {wanted:g}; check that the costs are convex, increasing, smooth and finite up to the"
            " capacities, or raise tolerance or max_iterations"
        )
    allocation = _read_only(point.shares * scaled.equal_share)
    return Optimum(
        allocation=allocation,
        multipliers=_read_only(point.multipliers / scaled.equal_share),
        cost=float(problem.costs.value(allocation).sum()),
        kkt_residual=point.residual,
        iterations=iterations,
    )


def _search(scaled: ScaledCosts, tolerance: float, max_iterations: int) -> tuple[Candidate, int]:
    """Take plain Newton steps where the start is near, and follow the central path where they fail."""
    start, taken = power_law_start(scaled), 0
    if start.residual < NEAR:
        point, taken = newton_steps(scaled, start, tolerance, max_iterations)
        if point is not None:
            return point, taken
    found, more = follow_central_path(scaled, start, tolerance, max_iterations - taken)
    return found, taken + more


def _read_only(values: FloatArray) -> FloatArray:
    values.setflags(write=False)
    return values
