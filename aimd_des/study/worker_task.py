"""One run in a worker: it writes the files itself, and tells only what the sweep has to know."""

import json
import logging
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import tomli_w

from aimd_des.scenario.run_folder import library_versions
from aimd_des.study import journal
from aimd_des.study.points import Job
from aimd_des.study.rare_event_file import rare_columns
from aimd_des.study.run_tables import RUN_AWAY, VERSIONS, frame_table, summary_of
from aimd_des.study.shared_parts import shared_parts
from aimd_des.study.store import Store, parquet
from aimd_des.study.warm_ups import warm_up_file
from aimd_des.utils.errors import OverloadWarning
from aimd_des.utils.returned_values import raised_in

_LOGGER = logging.getLogger("aimd_des")


@dataclass(frozen=True)
class Task:
    """What is the same for all runs of a study."""

    folder: str  # of the study
    sweep: str  # a word by which workers tell one sweep from another
    # Columns of the summary and frames to keep.
    measures: tuple[str, ...]
    keep: tuple[str, ...]
    measure: str | None  # what the sweep wants to know of each run, for all resources
    warm_ups: bool = False  # whether a warm-up is kept for other workers


@dataclass(frozen=True)
class Outcome:
    """What became of a run."""

    # "died": its worker did, and wrote nothing; "unwritten": the disk is full, or refuses.
    kind: Literal["done", "failed", "died", "unwritten"]
    message: str = ""  # why, unless it is done
    values: tuple[tuple[str, float], ...] = ()  # the measure the sweep wanted, of each resource
    saturated: bool = False  # whether response probabilities were above 1
    errno: int = 0  # of the system's refusal, if it is unwritten


def perform(task: Task, job: Job) -> Outcome:
    """Carry out a run and write what came out."""
    store = Store(Path(task.folder))
    try:
        with warnings.catch_warnings():
            # Their number is a column.
            warnings.filterwarnings("ignore", ".* responses had a probability above 1", RuntimeWarning)
            warnings.simplefilter("ignore", OverloadWarning)  # said once, of all runs
            parts = shared_parts(task.sweep)
            scenario = parts.scenario(job)
            shared = parts.problem(job, scenario)
            kept = warm_up_file(store.folder, job.labels["seed"]) if task.warm_ups else None
            result = parts.run(job, scenario, kept)
        summary = summary_of(
            result,
            task.measures,
            shared,
            lambda: parts.expected(job, scenario),
            lambda: rare_columns(scenario, shared.problem),
        )
        labels = {**job.labels, "digest": result.digest, VERSIONS: json.dumps(_versions())}
        record = journal.record_of(labels, {**summary, RUN_AWAY: result.run_away.tolist()})
        frames = {name: frame_table(job.key, result, name) for name in task.keep}
    except Exception as error:  # noqa: BLE001 - no error of one run may stop the others
        message = raised_in(error) or f"{type(error).__name__}: {error}"
        return _written(
            lambda: failure(store, job, message, traceback.format_exc()), Outcome("failed", message)
        )
    values = (
        () if task.measure is None else tuple(zip(summary["resource"], summary[task.measure], strict=True))
    )

    def write() -> None:
        for name, frame in frames.items():
            store.write(store.name(name, job.key), parquet(frame))
        # The rows come last: where they are, everything is.
        journal.append(store.folder / "runs", record)

    return _written(write, Outcome("done", values=values, saturated=bool(result.account.saturated.any())))


def _written(write: Callable[[], None], outcome: Outcome) -> Outcome:
    try:
        write()
    except OSError as error:
        return Outcome("unwritten", error.strerror or str(error), errno=error.errno or 0)
    return outcome


def failure(store: Store, job: Job, message: str, trace: str = "") -> None:
    """Record a run that failed."""
    record = {
        **job.labels,
        "message": message,
        "traceback": trace,
        "versions": _versions(),
        "scenario": tomli_w.dumps(job.scenario()),
    }
    content = f"{json.dumps(record, indent=2, ensure_ascii=False)}\n".encode("utf-8", "backslashreplace")
    store.write(store.name("failed", job.key), content)


def present(folder: str, key: str) -> bool:
    """Tell whether a worker sees the folder of a study."""
    return Path(folder, key).is_file()


# Reading them takes longer than many a run.
_versions = cache(library_versions)
