"""The plan of a study, and what it may become: a folder grows by values and replications."""

import logging
from collections.abc import Sequence
from typing import Any

import pandas as pd
import pyarrow as pa
import tomli_w

from aimd_des._version import RESULT_VERSION
from aimd_des.study.file import STUDY_FILE, read_study
from aimd_des.study.fingerprint import FORM, fingerprint
from aimd_des.study.points import PlannedRun, Point, expand, run_of
from aimd_des.study.run_tables import plan_schema, run_schema
from aimd_des.study.schedule import Schedule
from aimd_des.study.store import Store
from aimd_des.study.stored_rows import read_rows
from aimd_des.study.study import Study, shown_labels, stored_study
from aimd_des.utils.errors import InputError

_LOGGER = logging.getLogger("aimd_des")

# What a plan has behind the axes.
_LABELS = ("point", "replication", "seed", "key")

_REMEDY = "choose another folder, or say --overwrite (overwrite=True)"


def plan_table(study: Study, runs: Sequence[PlannedRun]) -> pa.Table:
    """List the runs of a study."""
    schema = plan_schema(study)
    labels = [run.labels for run in runs]
    return pa.Table.from_arrays(
        [pa.array([row[part.name] for row in labels], part.type) for part in schema], schema=schema
    )


def points_table(points: Sequence[Point]) -> pa.Table:
    """List the points with their scenarios, every value spelled out but the seeds, which runs have."""
    texts = [tomli_w.dumps(point.without_seed()) for point in points]
    return pa.table({"point": [point.name for point in points], "scenario": texts})


def earlier_replications(store: Store, study: Study, points: Sequence[Point]) -> dict[str, int]:
    """Hold a study against the one whose folder this is."""
    manifest, plan = store.manifest(), store.plan()
    if manifest is None and plan is None:
        return {}
    if manifest is not None:
        version, wanted = manifest["result_version"], RESULT_VERSION
        if version != wanted:
            allowed = f"{wanted}, that of the results of this version of aimd_des"
            raise InputError.of(f"result version of {store.folder}", version, allowed, _REMEDY)
        _hold_against(
            stored_study(manifest, store.folder),
            study,
        )
    elif (file := store.folder / STUDY_FILE).is_file():
        _hold_against(read_study(file), study)
    counts = {} if plan is None else _counts(plan, study, points)
    digests = (manifest or {}).get("digests", {})
    if digests.get("form") == FORM:
        _hold_problems_against(digests["problems"], points)
    else:
        _LOGGER.warning(
            "%s: holds no digests of its problems, or such as an earlier version made; whether models are as"
            " they were when its runs were made is not known",
            store.folder,
        )
    return counts


def _hold_against(earlier: Study, study: Study) -> None:
    """Refuse a study whose runs would have other columns than those of the folder."""
    for name in ("columns", "keep"):
        old, new = (
            sorted(getattr(one, name)() if name == "columns" else one.keep) for one in (earlier, study)
        )
        if old != new:
            word = "measures" if name == "columns" else name
            raise InputError.of(f"{word} of the study", new, f"{old}, as its folder has them", _REMEDY)


def digests_of(points: Sequence[Point]) -> dict[str, Any]:
    """Say what is shared at each point, for the manifest."""
    found: dict[str, dict[str, Any]] = {}
    for point in points:
        entry = found.setdefault(fingerprint(point.problem), {"points": [], "parts": point.problem})
        entry["points"].append(point.name)
    return {"form": FORM, "problems": found}


def _hold_problems_against(earlier: dict[str, Any], points: Sequence[Point]) -> None:
    """Refuse runs of another problem under the same words: what a model makes of them has changed."""
    before = {name: entry["parts"] for entry in earlier.values() for name in entry["points"]}
    for point in points:
        parts = before.get(point.name, point.problem)
        others = [name for name, digest in point.problem.items() if parts.get(name) != digest]
        if others:
            at = f"at {shown_labels(point.labels)}" if point.labels else "of the scenario"
            own = [name for name in others if "." in name]  # named by module and class
            what, changed, back = ("code", own[0], "it") if own else ("problem", "its model", "the model")
            raise InputError(
                f"the {what} {at} is not that of the runs in the folder ({', '.join(others)}),"
                f" since {changed} has changed; put {back} back as it was, or {_REMEDY}"
            )


def _counts(plan: pa.Table, study: Study, points: Sequence[Point]) -> dict[str, int]:
    names = [axis.name for axis in study.axes]
    columns = plan.column_names[: -len(_LABELS)]
    if columns != names:
        raise InputError.of("axes of the study", names, f"{columns}, as its folder has them", _REMEDY)
    by_name = {point.name: point for point in points}
    at_most = study.replications if study.precision is None else study.precision.at_most
    counts: dict[str, int] = {}
    for row in plan.to_pylist():
        shown = ", ".join(f"{axis.name} = {row[axis.name]}" for axis in study.axes) or "the scenario"
        point = by_name.get(row["point"])
        if point is None:
            raise InputError(f"the folder has runs at {shown}, which the study has not: {_REMEDY}")
        # Equal keys of the first replication mean equal scenarios and equal seeds, and so equal keys of all.
        if row["replication"] == 0 and row["key"] != run_of(study, point, 0).key:
            raise InputError(
                f"the scenario or the seed at {shown} is not that of the runs in the folder: {_REMEDY}"
            )
        if any(point.labels[axis.name] != row[axis.name] for axis in study.axes):
            raise InputError(f"the runs at {shown} have other names than in the folder: {_REMEDY}")
        if row["replication"] >= at_most:
            raise InputError(
                f"the folder has more replications at {shown} than the study ({at_most}): {_REMEDY}"
            )
        counts[point.name] = max(counts.get(point.name, 0), row["replication"] + 1)
    return counts


def planned(study: Study, store: Store) -> pd.DataFrame:
    """Say what a sweep would do."""
    store.check()
    points = expand(study)
    schedule = Schedule(study, points, earlier_replications(store, study, points))
    frame = plan_table(study, schedule.runs).to_pandas()
    done = read_rows(store, run_schema(study)).spans.keys()
    whole = {
        key
        for key in set(frame["key"]) & (done | store.failed())
        if not store.fault(key, study.keep, done=key in done)
    }
    frame["done"] = frame["key"].isin(whole & done)
    frame["failed"] = frame["key"].isin(whole - done)
    names = [*(axis.name for axis in study.axes), "point"]
    counts = frame.groupby(names, sort=False).agg(
        replications=("key", "count"), done=("done", "sum"), failed=("failed", "sum")
    )
    found: pd.DataFrame = counts.reset_index()
    return found
