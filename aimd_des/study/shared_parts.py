"""What runs of a study have in common, made once in each worker: scenarios, problems and their optima."""

import logging
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property, lru_cache
from pathlib import Path
from threading import Lock

from aimd_des.engine.run_in_progress import Run, resume
from aimd_des.interventions import Intervention
from aimd_des.problem.optimum import Optimum, solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.results.result import Result
from aimd_des.scenario import Scenario
from aimd_des.scenario.canonical import with_seed
from aimd_des.scenario.simulations import gone_on, warm_up_of, warmed
from aimd_des.study.points import Job, problem_words, shared_words
from aimd_des.utils.errors import InputError, SimulationError

_LOGGER = logging.getLogger("aimd_des")

# Problems are kept as long as they have no more agents together: runs come replication by replication, so
# that those that share a problem come together.
_MOST_AGENTS = 100_000
# Of the replication at hand, and the one that others may still be at.
_MOST_WARMED = 2


class SharedProblem:
    """A problem, and its optimum once it is needed."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @cached_property
    def optimum(self) -> Optimum:
        """Solve for it."""
        return solve_optimum(self.problem)


class _SharedPoint:
    """The scenario of a point, checked once for all of its runs."""

    def __init__(self, job: Job) -> None:
        self.scenario = Scenario.model_validate(job.tables)
        self.words = problem_words(self.scenario)
        self.expected: dict[int, list[float]] = {}
        self.warm_up: bytes | None = None  # in words, once it has been asked for

    def with_seed(self, job: Job) -> Scenario:
        """Give the scenario of a run."""
        seeded = with_seed({"parameters": self.scenario.parameters}, job.labels["seed"], own=job.own_seed)
        return self.scenario.model_copy(update=seeded)


class SharedParts:
    """What one sweep has made so far in this process."""

    def __init__(self) -> None:
        self._points: dict[str, _SharedPoint] = {}
        self._problems: OrderedDict[tuple[str, int], SharedProblem] = OrderedDict()
        self._warmed: OrderedDict[tuple[bytes, int], Run] = OrderedDict()
        # Workers may be threads.
        self._lock, self._warming = Lock(), Lock()

    def scenario(self, job: Job) -> Scenario:
        """Give the scenario of a run."""
        return self._point(job).with_seed(job)

    def problem(self, job: Job, scenario: Scenario) -> SharedProblem:
        """Give the problem of a run."""
        key = (self._point(job).words, job.labels["seed"] if job.own_seed else 0)
        with self._lock:
            found = self._problems.pop(key, None)
        if found is None:
            found = SharedProblem(scenario.problem())
        with self._lock:
            self._problems[key] = found
            agents = sum(one.problem.n_agents for one in self._problems.values())
            while agents > _MOST_AGENTS and len(self._problems) > 1:
                agents -= self._problems.popitem(last=False)[1].problem.n_agents
        return found

    def run(self, job: Job, scenario: Scenario, kept: Path | None = None) -> Result:
        """Carry out a run, of which others may have had the warm-up before; `kept` is its file, if any."""
        problem = self.problem(job, scenario).problem
        if scenario.warm_up is None:
            return scenario.run(problem=problem)
        point, interventions = self._point(job), scenario.changes(problem)
        if point.warm_up is None:
            point.warm_up = shared_words(point.scenario, interventions)
        key = point.warm_up, job.labels["seed"]
        with self._warming:
            if key not in self._warmed:
                self._warmed[key] = _warmed(kept, scenario, problem, interventions)
                while len(self._warmed) > _MOST_WARMED:
                    self._warmed.popitem(last=False)
            begun = gone_on(scenario, self._warmed[key], interventions)
        return begun.result()

    def expected(self, job: Job, scenario: Scenario) -> list[float]:
        """Ask theory for the misallocation at the end: empty where it does not cover the scenario."""
        known, seed = self._point(job).expected, job.labels["seed"] if job.own_seed else 0
        if seed not in known:
            from aimd_des.scenario.expected import expected_of  # theory is slow to import

            try:
                theory = expected_of(scenario, self.problem(job, scenario).problem.n_agents)
                mean = theory.misallocation(scenario.until).mean
                known[seed] = list(mean.tolist())
            except (InputError, SimulationError) as refusal:
                _LOGGER.warning("no misallocation is expected: %s", refusal)
                known[seed] = []
        return known[seed]

    def _point(self, job: Job) -> _SharedPoint:
        name = job.labels["point"]
        if name not in self._points:
            self._points[name] = _SharedPoint(job)
        return self._points[name]


def _warmed(
    kept: Path | None, scenario: Scenario, problem: Problem, interventions: Sequence[Intervention]
) -> Run:
    """Run a warm-up, or go on from what another worker has left of it, to the same bits."""
    if kept is not None and kept.is_file():
        with suppress(InputError):  # the machine went down while it was written, say
            return resume(kept, warm_up_of(scenario, problem, interventions))
    run = warmed(scenario, problem, interventions)
    if kept is not None:
        # What cannot be saved, as costs of the user's own that are set on the way, is run by each worker.
        with suppress(InputError):
            run.save(kept)
    return run


@lru_cache(maxsize=1)
def shared_parts(sweep: str) -> SharedParts:  # noqa: ARG001 - another sweep may have other models by the same names
    """Give what a sweep shares; parts of another one are forgotten."""
    return SharedParts()
