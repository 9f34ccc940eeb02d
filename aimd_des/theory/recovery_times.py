"""How averages recover from a step of capacities, costs or membership, in the mean over runs.

Before the step averages are where they were bound for; after it they follow the mean dynamics of the new
problem.  Demand beyond the new level is taken away at once, by signals, and what is missing grows.  Agents
that come begin with nothing, and their averages with their own age.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.optimum.nearby_optima import optimal_allocations
from aimd_des.theory.accuracy import Convergence
from aimd_des.theory.mean_dynamics import MeanPath, Origin
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

# Agents that come are looked at after this part of the time in which demand fills the capacity.
_NEW = 1e-3
# A recovery is looked for in decades, from a small part of the age on, and not beyond so many ages.
_SOONEST, _LONGEST = 1e-4, 1e9
_LOOKS = 60


@dataclass(frozen=True, eq=False)
class Recovery:
    """Averages after a step, in the mean over runs; made by `recovery`.

    Attributes
    ----------
    after : Convergence
        What averages are bound for after the step.
    path : MeanPath
        The way there.
    age : float
        Age of the run at the step, in steps or units of time.
    """

    after: Convergence
    path: MeanPath
    age: float

    def average(self, since: npt.ArrayLike) -> FloatArray:
        """Compute the averages after the step.

        Parameters
        ----------
        since : array_like, shape (k,)
            Ascending times >= 0 since the step.

        Returns
        -------
        ndarray, shape (k, n, m)
            In units of the resources, of the agents that are here after the step.
        """
        return self.path.at(self.age + validation.array("since", since, ["k"], low=0.0))

    def time(
        self,
        measure: Literal["level", "relative_error", "misallocation"] = "level",
        within: float = 0.05,
        of: Literal["level", "change"] = "level",
    ) -> FloatArray:
        """Compute how long averages take until they stay within a limit.

        Parameters
        ----------
        measure : {"level", "relative_error", "misallocation"}
            What has to be small, as for `Result.recovery`, of the averages in the mean over runs: what noise
            adds in a single run says `Convergence.misallocation`.
        within : float
            How small, between 0 and 1.
        of : {"level", "change"}
            As for `Result.recovery`.

        Returns
        -------
        ndarray, shape (m,)
            Since the step, in steps or units of time; inf where averages are bound for a place beyond the
            limit.
        """
        validation.known("measure", measure, ("level", "relative_error", "misallocation"))
        validation.known("of", of, ("level", "change"))
        near = validation.number("within", within, low=0.0, low_open=True, high=1.0, high_open=True)
        first = self._distance(measure, self.average([0.0]))[0]
        limit = np.full(len(first), near) if of == "level" else near * first
        result = np.full(len(first), np.inf)
        possible = self._distance(measure, self.after.steady.average[None])[0] <= limit
        begin, known = _SOONEST * self.age, np.where(first > limit, -1.0, 0.0)
        while begin < _LONGEST * self.age and (np.isinf(result) & possible).any():
            since = np.concatenate([[0.0], np.geomspace(_SOONEST * self.age, 10.0 * begin, _LOOKS)])
            away = self._distance(measure, self.average(since))
            for j in np.flatnonzero(np.isinf(result) & possible).tolist():
                known[j] = _last_crossing(since, away[:, j], float(limit[j]))
                if known[j] <= begin:  # nothing more happened for a decade
                    result[j] = known[j]
            begin *= 10.0
        return result

    def _distance(self, measure: str, average: FloatArray) -> FloatArray:
        """Measure averages, (k, n, m) -> (k, m)."""
        problem = self.after.problem
        if measure == "level":
            return np.asarray(np.abs(average.sum(axis=1) / problem.capacity - 1.0))
        if measure == "relative_error":
            best = solve_optimum(problem).allocation[None]
        else:
            best = optimal_allocations(problem, average.sum(axis=1))
        return np.asarray(np.abs(average - best).sum(axis=1) / best.sum(axis=1))


def _last_crossing(since: FloatArray, away: FloatArray, limit: float) -> float:
    """Compute from when on a distance stays within a limit; inf if it does not."""
    outside = np.flatnonzero(away > limit)
    if not len(outside):
        return 0.0
    last = int(outside[-1])
    if last == len(since) - 1:
        return np.inf
    share = (away[last] - limit) / (away[last] - away[last + 1])
    return float(since[last] + share * (since[last + 1] - since[last]))


def recovery(before: Convergence, after: Convergence, age: float) -> Recovery:
    """Predict how averages recover when one problem takes the place of another.

    Parameters
    ----------
    before, after : Convergence
        What averages are bound for before and after the step: the problems may differ in capacities, costs
        and agents, which are known by their names.
    age : float
        Age > 0 of the run at the step, in steps or units of time.

    Returns
    -------
    Recovery
        The averages after it, and how long they take.

    Raises
    ------
    InputError
        If resources, dynamics or ways of averaging differ, or averages are over a window, whose past is not
        followed: see `recovery_time` and `flow`.

    Notes
    -----
    Neglects that averages scatter, and on the clock the few steps in which demand falls to a lower level.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Problem, Resource
    >>> from aimd_des.theory import convergence
    >>> def settled(capacity):
    ...     memory = Resource("memory", capacity=capacity, increase=0.02, decrease=0.7, normalization=0.06)
    ...     return convergence(Problem([memory], PolynomialCosts([2], [[[1.0]]] * 60)), "continuous")
    >>> found = recovery(settled(30.0), settled(18.0), age=120.0)
    >>> bool(500.0 < found.time()[0] < 1500.0)
    True
    """
    for name, given in (("before", before), ("after", after)):
        validation.instance(name, given, Convergence, "a Convergence, such as theory.convergence(problem)")
    begin = validation.number("age", age, low=0.0, low_open=True)
    old, new = before.problem, after.problem
    if new.resource_names != old.resource_names:
        raise InputError.of("resources after", new.resource_names, f"{old.resource_names}, as before")
    if after.memory != before.memory or after.setting.discrete != before.setting.discrete:
        raise InputError.of("averaging after", after.memory, "as before, and so the dynamics")
    if after.memory.window is not None:
        remedy = "see theory.recovery_time for capacities, and theory.flow"
        raise InputError.of("window", after.memory.window, "left out: its past is not followed", remedy)
    return Recovery(
        after, MeanPath(after.setting, after.steady, after.memory, _origin(before, after, begin)), begin
    )


def _origin(before: Convergence, after: Convergence, age: float) -> Origin:
    """Take the state over to the new agents and to a level that is not above the new one."""
    problem, limit = after.problem, after.steady.found.sum(axis=0)
    young = _NEW * float((limit / problem.increase.sum(axis=0)).max())
    place = {name: row for row, name in enumerate(before.problem.agent_names)}
    rows = np.array([place.get(name, -1) for name in problem.agent_names])
    known = (rows >= 0)[:, None]
    old = np.stack([before.average(age), before.steady.found, before.steady.found])[:, rows]
    grown = young * problem.increase
    state = np.where(known, old, np.stack([0.5 * grown, grown, grown]))
    state = MeanPath(after.setting, after.steady, after.memory).fallen(state)
    return Origin(age, state, np.where(known, 0.0, age - young))
