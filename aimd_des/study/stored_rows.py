"""The rows of all runs of a study: files of some hundred runs each, in the order of the plan, and journals.

Rows come into the journals of workers.  At the end of a sweep they go into files that are named by the runs
in them: new files are there before old ones and journals go, so that nothing is lost whenever it is stopped.
"""

import json
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from aimd_des.study import journal
from aimd_des.study.run_tables import RUN_AWAY, SCENARIO, VERSIONS, stored_schema
from aimd_des.study.store import AGAIN, Store, parquet
from aimd_des.utils.errors import InputError

_FOLDER = "runs"
# What a file that is damaged costs, against the time that many files take.
_RUNS_EACH = 256


@dataclass(frozen=True)
class StoredRows:
    """The rows that are there, read once."""

    table: pa.Table  # in the order of the files
    spans: dict[str, tuple[int, int]]  # first row of each run, and the one behind its last
    files: tuple[str, ...]  # those that are whole
    damaged: tuple[str, ...]  # and those that are not
    damage: tuple[str, ...]  # a sentence about each of these, and about each line that is damaged
    journals: dict[Path, int]  # and how much of each has been read
    scenarios: dict[str, str]  # of runs that an earlier version wrote

    def of(self, keys: Iterable[str]) -> pa.Table:
        """Give the rows of runs, in their order."""
        rows = [np.arange(*self.spans[key]) for key in keys]
        return self.table.take(np.concatenate(rows or [np.empty(0, np.int64)]))


def read_rows(store: Store, schema: pa.Schema) -> StoredRows:
    """Read the rows of all runs; what is damaged is left out, and named."""
    full = stored_schema(schema)
    # Journals come first: what a sweep puts into files meanwhile is read twice, and else would be missed.
    records, sizes, damage = _read_journals(store)
    columns = [
        pa.array([value for record in records for value in journal.values_of(record, part.name)], part.type)
        for part in full
    ]
    tables, damaged, scenarios = {}, {}, {}
    for name in sorted(f"{_FOLDER}/{file}" for file in store.names(_FOLDER)):
        try:
            tables[name], scenario = _read_file(store, name, full)
        except InputError as error:
            damaged[name] = str(error)
        else:
            if scenario is not None:
                scenarios[tables[name]["key"][0].as_py()] = scenario
    if not all(os.path.lexists(store.folder / name) for name in damaged):
        return read_rows(store, schema)  # a sweep has put rows in order meanwhile
    table = pa.concat_tables([*tables.values(), pa.Table.from_arrays(columns, schema=full)])
    said = (*damage, *damaged.values())
    return StoredRows(table, _spans(table), tuple(tables), tuple(damaged), said, sizes, scenarios)


def _read_journals(store: Store) -> tuple[list[dict[str, Any]], dict[Path, int], list[str]]:
    """Read all journals: their records, how long they are, and which of their lines are damaged."""
    records: list[dict[str, Any]] = []
    sizes: dict[Path, int] = {}
    damage: list[str] = []
    for path in journal.journals(store.folder / _FOLDER):
        with suppress(FileNotFoundError):  # a sweep has put its rows into files meanwhile
            content = path.read_bytes()
            found, wrong = journal.read(content, str(path), AGAIN)
            records += found
            damage += wrong
            sizes[path] = len(content)
    return records, sizes, damage


def _spans(table: pa.Table) -> dict[str, tuple[int, int]]:
    """Find the rows of each run; one that was written twice is the same twice."""
    keys, resources = (table[name].to_pylist() for name in ("key", "resource"))
    spans: dict[str, tuple[int, int]] = {}
    first = 0
    for row in range(1, len(keys) + 1):
        if row == len(keys) or keys[row] != keys[first] or resources[row] == resources[first]:
            spans.setdefault(keys[first], (first, row))
            first = row
    return spans


def _read_file(store: Store, name: str, schema: pa.Schema) -> tuple[pa.Table, str | None]:
    """Read a file of rows; one that an earlier version wrote holds one run, and its scenario."""
    table = store.table(name, AGAIN)
    metadata = table.schema.metadata or {}
    scenario = None
    try:
        if VERSIONS not in table.column_names:
            scenario = metadata.get(SCENARIO.encode(), b"").decode("utf-8", "replace")
            away = json.loads(metadata.get(RUN_AWAY.encode(), b"[]"))
            versions = metadata.get(VERSIONS.encode(), b"{}").decode()
            gone = [resource in away for resource in table["resource"].to_pylist()]
            table = table.append_column(RUN_AWAY, pa.array(gone, pa.bool_()))
            table = table.append_column(VERSIONS, pa.array([versions] * len(table), pa.string()))
        table = table.replace_schema_metadata(None).cast(schema)
    except (pa.ArrowException, ValueError, KeyError) as error:
        raise InputError(f"{store.folder / name}: has other columns ({error}); {AGAIN}") from None
    keys = list(dict.fromkeys(table["key"].to_pylist()))
    if Path(name).stem.rpartition("-")[2] not in (_digest(keys), *keys[:1][: len(keys) == 1]):
        raise InputError(f"{store.folder / name}: is another run's; {AGAIN}")
    return table, scenario


def _digest(keys: Sequence[str]) -> str:
    return sha256("\n".join(keys).encode()).hexdigest()[:16]


def put_in_order(store: Store, rows: StoredRows, planned: Sequence[str]) -> None:
    """Write the rows of all runs in the order of the plan, and remove what is then there twice."""
    order = [key for key in planned if key in rows.spans]
    order += sorted(rows.spans.keys() - set(order))  # of a plan that was lost
    names = []
    for place, first in enumerate(range(0, len(order), _RUNS_EACH)):
        keys = order[first : first + _RUNS_EACH]
        names.append(f"{_FOLDER}/{place:05}-{_digest(keys)}.parquet")
        if names[-1] not in rows.files:
            store.write(names[-1], parquet(rows.of(keys)))
    for name in set(rows.files) - set(names):
        store.forget(name)
    for path, size in rows.journals.items():
        if path.stat().st_size == size:  # else a worker still writes
            path.unlink()
