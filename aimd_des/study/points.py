"""The points of a study and the runs of each: settings, seeds and keys, a function of the study alone."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from aimd_des._version import RESULT_VERSION
from aimd_des.interventions import Intervention
from aimd_des.scenario import Scenario, validate_scenario
from aimd_des.scenario.canonical import with_seed
from aimd_des.scenario.kind_tables import own_parts
from aimd_des.scenario.old_keys import with_first_keys
from aimd_des.scenario.simulations import before
from aimd_des.study.axis import Value
from aimd_des.study.fingerprint import fingerprint, problem_digests
from aimd_des.study.study import Study, place_of, shown_labels
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

# What a seed is for: the first word of its spawn key. They never change.
_PAIRED, _UNPAIRED = 0, 1


@dataclass(frozen=True)
class Point:
    """A position along each axis."""

    name: str  # a hash of the settings: the same with any values besides, and in any order
    labels: dict[str, Value]  # the value of each axis by its name
    scenario: Scenario  # the run at this point, with seed 0
    problem: dict[str, str]  # digests of the problem with seed 0, field by field, and of the user's own parts

    @cached_property
    def tables(self) -> dict[str, Any]:
        """Spell out the scenario; the seed is still 0."""
        return self.scenario.resolved().spoken()

    def without_seed(self) -> dict[str, Any]:
        """Spell out the scenario but for what the seed of a run decides."""
        found = {key: value for key, value in self.tables.items() if key != "seed"}
        if self.own_seed:
            found["parameters"] = {k: v for k, v in found["parameters"].items() if k != "seed"}
        return found

    @cached_property
    def own_seed(self) -> bool:
        """Tell whether each run has a problem of its own."""
        return self.scenario.has_own_seed()

    def key(self, seed: int) -> str:
        """Hash the scenario of a run, and the version of results."""
        return sha256(b"%d\n" % RESULT_VERSION + self._canonical(seed)).hexdigest()[:32]

    @cached_property
    def _canonical(self) -> Callable[[int], bytes]:
        return self.scenario.canonical_at()


@dataclass(frozen=True)
class Job:
    """A run as it is sent to a worker: tables of scenarios are made by each process for itself."""

    labels: dict[str, Any]  # what the columns hold that say which run it is
    tables: dict[str, Any]  # the scenario of the point, every value spelled out
    own_seed: bool  # whether the seed of the run is that of the model, too

    @property
    def key(self) -> str:
        """The name of the run's files."""
        return str(self.labels["key"])

    def scenario(self) -> dict[str, Any]:
        """Spell out the scenario of the run."""
        return with_seed(self.tables, self.labels["seed"], own=self.own_seed)


@dataclass(frozen=True)
class PlannedRun:
    """One replication of a point."""

    point: Point  # where
    replication: int  # which, from 0
    seed: int  # decides all that is random in it
    key: str  # a hash of the scenario and of the version of results: the name of the files

    def job(self) -> Job:
        """Say what a worker has to know."""
        return Job(self.labels, self.point.tables, self.point.own_seed)

    @property
    def scenario(self) -> Scenario:
        """The scenario, resolved."""
        return self.point.scenario.model_copy(update={"seed": self.seed}).resolved()

    @property
    def labels(self) -> dict[str, Any]:
        """What the columns hold that say which run it is."""
        own = {"point": self.point.name, "replication": self.replication, "key": self.key}
        return {**self.point.labels, **own, "seed": self.seed, "until": self.point.scenario.until}

    def __str__(self) -> str:
        return f"{shown_labels(self.point.labels)} (replication {self.replication})".lstrip()


def expand(study: Study) -> list[Point]:
    """List the points of a study, each with its scenario checked."""
    points: list[Point] = []
    problems: dict[str, dict[str, str]] = {}
    first: dict[str, Point] = {}
    for labels, settings in study.positions():
        point = _point(study, labels, settings, problems)
        same = first.setdefault(run_of(study, point, 0).key, point)
        if same is not point:
            pair = f"{shown_labels(same.labels)} and {shown_labels(labels)}"
            raise InputError(f"axes: the points {pair} are the same scenario; leave one out")
        points.append(point)
    if not points:
        raise InputError.of("where", study.where, "fulfilled by one point or more")
    if study.warm_up is not None:
        _check_shared(points, study.warm_up)
    return points


def _check_shared(points: Sequence[Point], warm_up: float) -> None:
    """Refuse points at which something else acts before the warm-up is over, which they share."""
    problem = points[0].scenario.problem()  # that of all: no axis can change it
    words = [shared_words(point.scenario, point.scenario.changes(problem)) for point in points]
    for point, found in zip(points, words, strict=True):
        if found != words[0]:
            pair = f"{shown_labels(points[0].labels)} and {shown_labels(point.labels)}"
            reason = f"the points {pair} differ in interventions that act before its end, {warm_up:g}"
            raise InputError(f"warm_up: {reason}; let them act later, or leave the warm-up out")


def shared_words(scenario: Scenario, interventions: Sequence[Intervention]) -> bytes:
    """Describe the warm-up of a scenario but for the seed: where it is equal, runs of a seed share it."""
    return before(scenario, interventions).model_copy(update={"seed": 0}).canonical()


def _point(
    study: Study,
    labels: dict[str, Value],
    settings: dict[str, Any],
    problems: dict[str, dict[str, str]],
) -> Point:
    where = place_of(labels)
    data = _lean(study.scenario_at(settings), [*study.keep, *study.columns()])
    scenario = validate_scenario(data, where)
    try:
        problem = _check_problem(study, scenario.model_copy(update={"seed": 0}).resolved(), problems)
    except InputError as refusal:
        raise InputError(f"{where}: {refusal}") from None
    problem = problem | {name: fingerprint(make) for name, make in sorted(own_parts(scenario).items())}
    text = json.dumps(
        _plain(with_first_keys(settings)), sort_keys=True, separators=(",", ":"), ensure_ascii=True
    )
    return Point(sha256(text.encode()).hexdigest()[:16], labels, scenario, problem)


def _check_problem(study: Study, scenario: Scenario, known: dict[str, dict[str, str]]) -> dict[str, str]:
    """Build the problem, and hold against it what refers to it; once where only the channel changes."""
    words = repr((problem_words(scenario), scenario.compensation, scenario.interventions))
    if words not in known:
        problem = scenario.problem()
        names = problem.resource_names
        if study.precision is not None and study.precision.resource != "all":
            allowed = f"all or one of {', '.join(names)}"
            validation.known("precision.resource", study.precision.resource, names, allowed)
        known[words] = problem_digests(problem)
    return known[words]


def problem_words(scenario: Scenario) -> str:
    """Describe the problem of a scenario."""
    return repr((scenario.model, scenario.parameters, scenario.resources, scenario.costs))


def _lean(data: dict[str, Any], keep: Sequence[str]) -> dict[str, Any]:
    """Add what holds in a study unless the scenario says otherwise: no result depends on it."""
    wanted = set(keep)
    recording: dict[str, Any] = {}
    if not wanted & {"demand"}:
        recording["demand"] = "end"
    if not wanted & {"allocations", "tracking", "recovery_time"}:
        recording["allocations"] = "end"
    if len(recording) == 2:
        recording["tail"] = 0
    if "events" in wanted:
        recording["events"] = True
    given = data.get("recording", {})
    agents = {} if data.get("dynamics") == "synchronous" else {"agents": "fleet"}
    # What is no table is left for the scenario to refuse.
    return {**agents, **data, "recording": {**recording, **given} if isinstance(given, dict) else given}


def _plain(value: Any) -> Any:
    """Write whole numbers in one way, so that 1 and 1.0 are the same setting."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def run_of(study: Study, point: Point, replication: int) -> PlannedRun:
    """Make one run."""
    if study.paired:
        spawn_key: tuple[int, ...] = (_PAIRED, replication)
    else:
        words = (int(point.name[:8], 16), int(point.name[8:], 16))
        spawn_key = (_UNPAIRED, *words, replication)
    state = np.random.SeedSequence(study.seed, spawn_key=spawn_key).generate_state(1, np.uint64)
    seed = int(state[0] >> np.uint64(1))
    return PlannedRun(point, replication, seed, point.key(seed))
