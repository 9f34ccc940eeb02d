"""From a result to tables: a row for each resource, with the same columns for all runs of a study."""

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Generic, TypeVar

import pyarrow as pa

from aimd_des.problem.optimum import Optimum, solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.results.measures import EXPECTED, MEASURES
from aimd_des.results.result import Result
from aimd_des.results.tracking import is_unchanged
from aimd_des.scenario import Scenario
from aimd_des.study.axis import Axis
from aimd_des.study.points import problem_words
from aimd_des.study.study import Study
from aimd_des.utils.errors import InputError, SimulationError

_LOGGER = logging.getLogger("aimd_des")
_Thing = TypeVar("_Thing")

#: Where the metadata of a file hold the scenario of its run, as TOML.
SCENARIO = b"aimd_des.scenario"
#: And where the versions that made it, as JSON.
VERSIONS = b"aimd_des.versions"
#: And the resources from whose capacity demand has run away, if there are any, as JSON.
RUN_AWAY = b"aimd_des.run_away"

_KINDS = {"boolean": pa.bool_(), "number": pa.float64(), "string": pa.string(), "integer": pa.int64()}


def axis_fields(study: Study) -> list[pa.Field]:
    """Describe the columns of the axes."""
    return [pa.field(axis.name, _KINDS[Axis.kind(axis.settings()[0][0])]) for axis in study.axes]


def plan_schema(study: Study) -> pa.Schema:
    """Describe the columns of the plan."""
    return pa.schema(
        [
            *axis_fields(study),
            pa.field("point", pa.string()),
            pa.field("replication", pa.int64()),
            pa.field("seed", pa.int64()),
            pa.field("key", pa.string()),
        ]
    )


def run_schema(study: Study) -> pa.Schema:
    """Describe the columns of a run's rows."""
    texts = [pa.field(name, pa.string()) for name in ("key", "digest", "resource")]
    measures = [pa.field(name, _KINDS[MEASURES[name].kind]) for name in study.columns()]
    return pa.schema(
        [
            *list(plan_schema(study))[:-1],
            *texts,
            *measures,
            pa.field("until", pa.float64()),
        ]
    )


@dataclass(frozen=True)
class _Described(Generic[_Thing]):
    """A thing, and the words by which it is recognised."""

    words: str
    thing: _Thing = field(compare=False)


# Runs come replication by replication, so that those that share their problem come together.
@lru_cache(maxsize=32)
def _optimum(problem: _Described[Problem]) -> Optimum:
    return solve_optimum(problem.thing)


@lru_cache(maxsize=32)
def _expected(scenario: _Described[Scenario]) -> list[float]:
    """Ask theory for the misallocation at the end: NaN where it does not cover the scenario."""
    try:
        return list(scenario.thing.convergence().misallocation(scenario.thing.until).mean.tolist())
    except (InputError, SimulationError) as refusal:
        _LOGGER.warning("no misallocation is expected: %s", refusal)
        return []


def summary_of(scenario: Scenario, result: Result, names: Sequence[str]) -> dict[str, list[Any]]:
    """Measure a run, with optimum and expectation solved only once for all runs that share them."""
    # Where interventions have left another problem, the run has one of its own.
    own = not is_unchanged(result.problem, result.history[-1])
    shared = not own and any(MEASURES[name].needs_optimum for name in names)
    optimum = _optimum(_Described(problem_words(scenario), result.problem)) if shared else None
    measures = {name: column.tolist() for name, column in result.measures(optimum, names).items()}
    if EXPECTED in measures:
        # The seed decides the problem by the parameters of its model, which are among the words.
        words = repr(scenario.model_copy(update={"seed": 0}).spoken())
        measures[EXPECTED] = _expected(_Described(words, scenario)) or measures[EXPECTED]
    return {"resource": list(result.problem.resource_names), **measures}


def run_table(
    schema: pa.Schema,
    labels: Mapping[str, Any],
    summary: Mapping[str, list[Any]],
    scenario: str,
    versions: Mapping[str, str],
    run_away: Sequence[str] = (),
) -> pa.Table:
    """Put the rows of a run together."""
    count = len(summary["resource"])
    every = {**{name: [value] * count for name, value in labels.items()}, **summary}
    arrays = [pa.array(every[part.name], part.type) for part in schema]
    metadata = {SCENARIO: scenario, VERSIONS: json.dumps(versions)}
    if run_away:
        metadata[RUN_AWAY] = json.dumps(run_away)
    return pa.Table.from_arrays(arrays, schema=schema.with_metadata(metadata))


def frame_table(key: str, result: Result, name: str) -> pa.Table:
    """Take a frame of a result, with the key of its run in front."""
    frame = pa.Table.from_pandas(getattr(result, name), preserve_index=False)
    keys = pa.DictionaryArray.from_arrays(pa.repeat(pa.scalar(0, pa.int8()), len(frame)), [key])
    return frame.replace_schema_metadata(None).add_column(0, "key", keys)
