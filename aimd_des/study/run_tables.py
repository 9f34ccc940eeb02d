"""From a result to tables: a row for each resource, with the same columns for all runs of a study."""

from collections.abc import Callable, Sequence
from typing import Any

import pyarrow as pa

from aimd_des.results.measures import EXPECTED, MEASURES, RARE
from aimd_des.results.result import Result
from aimd_des.results.tracking import is_unchanged
from aimd_des.study.axis import Axis
from aimd_des.study.shared_parts import SharedProblem
from aimd_des.study.study import Study

#: The column of a file that says whether demand has run away from the capacity.
RUN_AWAY = "aimd_des.run_away"
#: And the one of the versions that made a run, as JSON.
VERSIONS = "aimd_des.versions"
#: Where the metadata of a file that an earlier version wrote hold the scenario of its run, as TOML.
SCENARIO = "aimd_des.scenario"

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


def stored_schema(schema: pa.Schema) -> pa.Schema:
    """Describe the columns of a file of rows: those of a run, and what else is known of it."""
    return schema.append(pa.field(RUN_AWAY, pa.bool_())).append(pa.field(VERSIONS, pa.string()))


def summary_of(
    result: Result,
    names: Sequence[str],
    shared: SharedProblem,
    expected: Callable[[], list[float]],
    rare: Callable[[], dict[str, list[Any]]],
) -> dict[str, list[Any]]:
    """Measure a run; theory, and an estimate of a rare event, are asked for only where they are wanted."""
    # Where interventions have left another problem, the run has an optimum of its own.
    unchanged = is_unchanged(result.problem, result.history[-1])
    optimum = shared.optimum if unchanged and any(MEASURES[name].needs_optimum for name in names) else None
    measures = {name: column.tolist() for name, column in result.measures(optimum, names).items()}
    if EXPECTED in measures:
        measures[EXPECTED] = expected() or measures[EXPECTED]
    if set(RARE) & set(measures):
        measures.update({name: column for name, column in rare().items() if name in measures})
    return {"resource": list(result.problem.resource_names), **measures}


def frame_table(key: str, result: Result, name: str) -> pa.Table:
    """Take a frame of a result, with the key of its run in front."""
    frame = pa.Table.from_pandas(getattr(result, name), preserve_index=False)
    keys = pa.DictionaryArray.from_arrays(pa.repeat(pa.scalar(0, pa.int8()), len(frame)), [key])
    return frame.replace_schema_metadata(None).add_column(0, "key", keys)
