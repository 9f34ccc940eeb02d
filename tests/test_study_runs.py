"""Studies carried out: the same bytes whoever runs them, and nothing lost whatever happens meanwhile."""

import errno
import json
import os
import shutil
import signal
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd
import pyarrow.dataset as ds
import pytest
import tomli_w

import aimd_des
from aimd_des import InputError, SimulationError, Study, load_study, run_study
from aimd_des.scenario import validate_scenario, with_settings
from aimd_des.study import StudyResults, Tally
from aimd_des.study.executor import execute
from aimd_des.study.locks import alone
from aimd_des.study.plan_table import planned
from aimd_des.study.run_tables import run_schema, stored_schema
from aimd_des.study.seal import write_sealed
from aimd_des.study.store import Store, parquet
from aimd_des.study.stored_rows import StoredRows, put_in_order, read_rows
from aimd_des.study.worker_task import Outcome, Task
from aimd_des.study.workers import dask_executor
from tests.conftest import INLINE, ROOT, python, quietly

BASE = {**{key: value for key, value in tomllib.loads(INLINE).items() if key != "seed"}, "until": 30}
DESIGN: dict[str, Any] = {
    "title": "small",
    "replications": 2,
    "keep": ["signals", "demand"],
    "scenario": BASE,
    "axes": [
        {"name": "latency", "key": "channel.latency", "values": [0, 2]},
        {"name": "kind", "cases": {"ticks": {}, "flow": {"dynamics": "continuous"}}},
    ],
}


def design(**changes: Any) -> Study:
    return Study.model_validate({**DESIGN, **changes})


def in_a_thread(study: Study, out: Path, **options: Any) -> StudyResults:
    with ThreadPoolExecutor(1) as executor:
        return run_study(study, out, executor, 1, **options)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def stored(folder: Path) -> StoredRows:
    """Read the rows of all runs of a folder."""
    return read_rows(Store(folder), run_schema(load_study(folder).study))


def forget(folder: Path, key: str) -> None:
    """Take the rows of a run out of a folder."""
    rows = stored(folder)
    rest = {other: span for other, span in rows.spans.items() if other != key}
    put_in_order(Store(folder), replace(rows, spans=rest), load_study(folder).plan["key"].tolist())


def leftovers(folder: Path) -> list[Path]:
    return list(folder.rglob(".*.tmp"))


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    return in_a_thread(design(), tmp_path_factory.mktemp("reference") / "study")


# -- what comes out --------------------------------------------------------------------------------------


def test_a_row_for_each_run_and_resource(reference: StudyResults) -> None:
    runs = reference.runs
    assert list(runs.columns) == run_schema(design()).names
    assert len(runs) == 4 * 2 * 2
    assert not runs.isna().any(axis=None)
    assert runs["latency"].dtype == "int64"
    assert runs["kind"].cat.categories.tolist() == ["ticks", "flow"]
    assert runs["resource"].cat.categories.tolist() == ["memory", "disk"]
    assert reference.missing.empty
    assert reference.failed.empty
    assert runs.groupby("replication")["seed"].nunique().tolist() == [1, 1]


def test_every_run_can_be_repeated_alone_from_its_row(reference: StudyResults) -> None:
    for key, rows in reference.runs.groupby("key"):
        scenario = reference.scenario(str(key))
        result = quietly(scenario.run)
        assert rows["digest"].unique().tolist() == [result.digest]
        assert rows["seed"].unique().tolist() == [scenario.seed]
        summary = result.summary().reset_index(drop=True)
        found = rows[list(summary.columns)].reset_index(drop=True)
        pd.testing.assert_frame_equal(found, summary, check_exact=True, check_names=False)
    with pytest.raises(InputError, match="that of a run in"):
        reference.scenario("0" * 32)


def test_a_run_can_be_repeated_with_changes(reference: StudyResults) -> None:
    key = str(reference.runs["key"].iloc[0])
    logged = reference.scenario(key, **{"recording.events": True})
    assert logged == validate_scenario(
        with_settings(reference.scenario(key).spoken(), {"recording.events": True}), "mine"
    )
    assert len(quietly(logged.run).events)
    with pytest.raises(InputError, match=f"^run {key}: recording.event: unknown key 'event'; did you mean"):
        reference.scenario(key, **{"recording.event": True})


def test_frames_of_all_runs_with_their_labels(reference: StudyResults) -> None:
    signals = reference.frame("signals")
    assert list(signals.columns) == ["latency", "kind", "replication", "key", "time", "resource", "number"]
    counts = signals.groupby(["key", "resource"], observed=True).size()
    expected = reference.runs.set_index(["key", "resource"])["signals"]
    assert {at: count for at, count in expected.items() if count} == counts.to_dict()
    with pytest.raises(InputError, match="one of what the study keeps"):
        reference.frame("allocations")
    with pytest.raises(InputError, match="did you mean 'demand'"):
        reference.frame("demands")


def test_frames_of_before_go_on_in_a_study_with_the_column_of_agents_of_now(tmp_path: Path) -> None:
    study = design(keep=["allocations"], axes=[])
    now = in_a_thread(study, tmp_path / "out").frame("allocations")
    store = Store(tmp_path / "out")
    key = now["key"].iloc[0]
    table = store.frame("allocations", key)
    names = ["camera" if name == "agent" else name for name in table.column_names]
    store.write(store.name("allocations", key), parquet(table.rename_columns(names)))
    again = in_a_thread(study, tmp_path / "out").frame("allocations")
    assert "agent" in again
    pd.testing.assert_frame_equal(again, now)


def test_the_folder_is_one_data_set_for_others(reference: StudyResults) -> None:
    files = reference.folder / "runs" / "*.parquet"
    query = f"select key, resource, utilisation from '{files}' order by key, resource"
    rows = duckdb.sql(query).fetchall()
    ours = reference.runs[["key", "resource", "utilisation"]].astype({"resource": str})
    assert rows == list(ours.sort_values(["key", "resource"]).itertuples(index=False, name=None))
    arrow = ds.dataset(reference.folder / "runs").to_table()
    assert arrow.schema.remove_metadata() == stored_schema(run_schema(reference.study))
    assert len(arrow) == len(rows)
    assert duckdb.sql(f"from '{reference.folder / 'plan.parquet'}'").fetchall()[0][:2] == (0.0, "ticks")


def test_only_the_measures_that_are_asked_for(tmp_path: Path) -> None:
    results = in_a_thread(design(measures=["signals", "utilisation"], keep=[], axes=[]), tmp_path / "out")
    labels = ["point", "replication", "seed", "key", "digest", "resource"]
    assert list(results.runs.columns) == [*labels, "signals", "utilisation", "until"]
    assert {path.name for path in results.folder.iterdir()} == {
        *(".lock", "manifest.json", "plan.parquet", "points.parquet", "study.toml", "runs", "failed")
    }


def test_the_study_in_the_folder_is_the_study(reference: StudyResults, tmp_path: Path) -> None:
    again = Study.model_validate(tomllib.loads((reference.folder / "study.toml").read_text()))
    assert again == reference.study == design()
    manifest = json.loads((reference.folder / "manifest.json").read_text())
    assert (manifest["runs"], manifest["result_version"]) == (8, aimd_des.RESULT_VERSION)
    assert reference.versions["aimd_des"] == aimd_des.__version__


def test_precision_adds_the_same_runs_however_often_it_is_stopped(tmp_path: Path) -> None:
    precision = {"measure": "utilisation", "half_width": 0.02, "at_most": 12}
    study = design(precision=precision, keep=[], measures=["utilisation"])
    whole = in_a_thread(study, tmp_path / "whole")
    counts = whole.plan["point"].value_counts()
    assert counts.min() < counts.max() <= 12

    def interrupt(tally: Tally) -> None:
        if tally.done == 5:
            signal.raise_signal(signal.SIGINT)

    for _ in range(20):
        try:
            in_a_thread(study, tmp_path / "parts", watch=interrupt)
            break
        except KeyboardInterrupt:
            assert load_study(tmp_path / "parts").runs.size
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


# -- who runs it -----------------------------------------------------------------------------------------

MODEL = """
import multiprocessing, os, signal
from pathlib import Path
from aimd_des import PolynomialCosts, Problem, Resource, model

@model
def deadly(how="", seed=0):
    if multiprocessing.parent_process() is not None:
        once = Path(f"died.{seed}")
        if how == "always" or how == "once" and not once.exists():
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if how == "raises":
            raise ValueError("no such device")
    return Problem([Resource("memory", 4.0, 0.03, 0.5, 0.02)], PolynomialCosts([2], [[[1.0]], [[2.0]]]))
"""


def test_processes_write_the_same_bytes(reference: StudyResults, tmp_path: Path) -> None:
    run_study(design(), tmp_path / "out", workers=2)
    assert contents(tmp_path / "out") == contents(reference.folder)


def test_who_kills_workers_is_found_and_the_rest_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "deadly_model.py").write_text(MODEL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    axis = {"name": "how", "key": "parameters.how", "values": ["", "once", "raises", "always"]}
    scenario = {"model": "deadly_model", "until": 20}
    study = Study.model_validate({"scenario": scenario, "axes": [axis]})
    results = run_study(study, tmp_path / "out", workers=2)
    assert results.runs["how"].value_counts().to_dict() == {"": 1, "once": 1, "raises": 0, "always": 0}
    failed = results.failed.set_index("how")["message"]
    assert failed["raises"].endswith("deadly_model makes no problem of them (ValueError: no such device)")
    assert failed["always"].startswith("the worker process died")
    assert results.missing.empty
    record = json.loads(next((tmp_path / "out/failed").iterdir()).read_text())
    assert "Traceback" in record["traceback"] or record["message"].startswith("the worker")
    assert results.scenario(record["key"]).seed == record["seed"]
    # What has failed is left alone, unless it is asked for.
    tallies: list[tuple[int, int]] = []
    watch = lambda tally: tallies.append((tally.done, tally.failed))  # noqa: E731
    in_a_thread(study, tmp_path / "out", watch=watch)
    assert tallies[-1] == (0, 0)
    results = in_a_thread(study, tmp_path / "out", retry_failed=True, watch=watch)
    assert tallies[-1] == (2, 0)
    assert results.failed.empty


@pytest.mark.slow
def test_a_dask_cluster_writes_the_same_bytes_also_when_a_worker_is_killed(
    reference: StudyResults, tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill(tally: Tally) -> None:
        if tally.done == 3 and not killed:
            killed.extend(executor._client.run(os.getpid).values())  # type: ignore[attr-defined]
            os.kill(killed[0], signal.SIGKILL)

    with dask_executor(workers=2) as (executor, workers):
        assert workers == 2
        run_study(design(), tmp_path / "out", executor, workers, watch=kill)
    assert len(killed) == 2
    assert contents(tmp_path / "out") == contents(reference.folder)


def test_dask_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"install 'aimd-des\[dask\]'"), dask_executor(workers=2):
        pass


@dataclass(frozen=True)
class _Number:
    """In place of a run."""

    number: int

    def job(self) -> int:
        return self.number


class _Dying(Executor):
    """An executor whose workers die of run 5, together with all that is in flight."""

    def __init__(self, size: int) -> None:
        self.size, self.broken, self.flying = size, False, []

    def submit(self, call: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        if self.broken:
            raise BrokenExecutor
        future: Future[Any] = Future()
        if not (args and isinstance(args[0], Task)):
            future.set_result(call(*args))
            return future
        self.flying.append((future, args[1]))
        if len(self.flying) == self.size:
            self.broken = any(number == 5 for _, number in self.flying)
            for flown, _ in self.flying:
                if self.broken:
                    flown.set_exception(BrokenExecutor())
                else:
                    flown.set_result(Outcome("done"))
            self.flying.clear()
        return future


class _DyingPool:
    workers = 2

    def __init__(self) -> None:
        self.sizes: list[int] = []

    def start(self, workers: int) -> Executor:
        self.sizes.append(workers)
        return _Dying(4 if workers == 2 else 1)

    def stop(self, executor: Executor) -> None:
        assert isinstance(executor, _Dying)

    def end_at_once(self) -> None:
        raise AssertionError


def test_innocent_runs_are_tried_again_and_the_culprit_is_not_tried_for_ever() -> None:
    due = iter(map(_Number, range(12)))
    taken: list[tuple[int, str]] = []
    pool = _DyingPool()

    def take(run: Any, outcome: Outcome) -> None:
        taken.append((run.number, outcome.kind))

    def next_one() -> Any:
        return next(due, None)

    execute(pool, Task("", "", (), (), None), next_one, take, lambda: False)
    assert taken == [(number, "died" if number == 5 else "done") for number in range(12)]
    # All, one for 4 and the first try of 5, one for the second try, one for 6 and 7, and all again.
    assert pool.sizes == [2, 1, 1, 1, 2]


def test_an_executor_that_is_broken_ends_the_study_with_a_sentence(tmp_path: Path) -> None:
    class Broken(Executor):
        def submit(self, call: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
            future: Future[Any] = Future()
            if args and isinstance(args[0], Task):
                future.set_exception(BrokenExecutor("gone"))
            elif call.__class__.__name__ == "partial":
                raise BrokenExecutor("gone")
            else:
                future.set_result(call(*args))
            return future

    with pytest.raises(SimulationError, match="no worker can be started"):
        run_study(design(), tmp_path / "out", Broken())
    assert len(load_study(tmp_path / "out").missing) == 8


def test_workers_that_do_not_see_the_folder_are_refused(tmp_path: Path) -> None:
    class Elsewhere(Executor):
        def submit(self, call: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_result(False)
            return future

    with pytest.raises(InputError, match="seen by the workers of the executor"):
        run_study(design(), tmp_path / "out", Elsewhere())


# -- whatever happens meanwhile --------------------------------------------------------------------------


def test_ctrl_c_waits_for_what_is_under_way_and_a_second_one_does_not(
    reference: StudyResults, tmp_path: Path
) -> None:
    out = tmp_path / "out"

    def press(times: int) -> Callable[[Tally], None]:
        def watch(tally: Tally) -> None:
            if tally.done == 1:
                for _ in range(times):
                    signal.raise_signal(signal.SIGINT)

        return watch

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        in_a_thread(design(), out, watch=press(1))
    assert len(load_study(out).plan) - len(load_study(out).missing) == 2  # a window of two
    with pytest.raises(KeyboardInterrupt):
        in_a_thread(design(), out, watch=press(2))
    assert signal.getsignal(signal.SIGINT) is before
    in_a_thread(design(), out)
    assert contents(out) == contents(reference.folder)


def test_a_disk_that_is_full_stops_the_study_and_it_goes_on_from_there(
    reference: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, sync = tmp_path / "out", os.fsync
    written: list[int] = []

    def fill(descriptor: int) -> None:
        written.append(descriptor)
        if len(written) > 10:  # in the middle of a run's files
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fill)
        with pytest.raises(OSError, match="No space left on device"):
            in_a_thread(design(), out)
    assert leftovers(out) == []
    assert len(load_study(out).missing) == 6
    in_a_thread(design(), out)
    assert contents(out) == contents(reference.folder)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with 160 kB, where tests may mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    if not shutil.which("mount"):
        pytest.skip("there is no mount")
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=160k", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("only root may mount a file system, and not everywhere")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_real_disk_that_is_full_or_read_only(reference: StudyResults, small_disk: Path) -> None:
    out = small_disk / "out"
    with pytest.raises(OSError, match="No space left on device"):
        in_a_thread(design(), out)
    assert leftovers(out) == []
    assert 0 < len(load_study(out).missing) < 8
    subprocess.run(["mount", "-o", "remount,size=1m", str(small_disk)], check=True)
    in_a_thread(design(), out)
    assert contents(out) == contents(reference.folder)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with pytest.raises(OSError, match="Read-only file system"):
        in_a_thread(design(), out)


def test_temporary_files_of_a_killed_process_are_removed(reference: StudyResults, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(reference.folder, out)
    next((out / "runs").iterdir()).unlink()
    for place in ("manifest.json", "runs/a.parquet", "demand/b.parquet"):
        path = out / place
        path.with_name(f".{path.name}.{'0f' * 16}.tmp").write_bytes(b"half")
    in_a_thread(design(), out)
    assert contents(out) == contents(reference.folder)


def test_a_file_that_cannot_be_written_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_sealed(tmp_path, "a.toml", b"old = 1\n")
    before = contents(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda descriptor: 1 / 0)
    write_sealed(tmp_path, "a.toml", b"old = 1\n")  # the same: nothing is written
    with pytest.raises(ZeroDivisionError):
        write_sealed(tmp_path, "a.toml", b"new = 1\n")
    assert contents(tmp_path) == before


def test_two_sweeps_at_once_are_refused(reference: StudyResults) -> None:
    with (
        alone(reference.folder),
        pytest.raises(InputError, match="one that no other sweep is using"),
    ):
        in_a_thread(design(), reference.folder)


KILLS = int(os.environ.get("AIMD_DES_TEST_KILLS", "3"))

# A disk on which writing takes its time, so that many a process is killed in the middle of it.
SLOW_DISK = """
import os, time
sync = os.fsync
def slow(descriptor):
    time.sleep(0.05)
    sync(descriptor)
os.fsync = slow
"""

# Imports once, and forks for each sweep: a process that is killed need not have been long in coming.
KILLER = """
import os, random, signal, sys, time, tomllib
import slow_disk
from contextlib import suppress
from multiprocessing import forkserver, resource_tracker
from pathlib import Path
from aimd_des.study import Study, run_study
from aimd_des.study.run_tables import run_schema
from aimd_des.study.store import Store
from aimd_des.study.stored_rows import read_rows

def ours():
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if f"MARK={os.environ['MARK']}".encode() in (place / "environ").read_bytes():
                found.append(int(place.name))
        except OSError:
            pass
    return found

def there():
    return len(read_rows(Store(Path("out")), run_schema(study)).spans)

def half():
    return len(list(Path("out").rglob(".*.tmp")))

def sweep():
    # A sweep that is killed while it asks for a worker takes the server of workers along.
    forkserver.ensure_running()
    alone.add(forkserver._forkserver._forkserver_pid)
    child = os.fork()
    if child == 0:
        # It runs, but is no child of this process, which therefore cannot ask for it.
        forkserver.ensure_running = forkserver._forkserver.ensure_running = lambda: None
        run_study(study, "out", workers=2)
        os._exit(0)
    return child

study = Study.model_validate(tomllib.loads(Path("study.toml").read_text()))
forkserver.set_forkserver_preload(["slow_disk", "aimd_des.study.worker_task"])
forkserver.ensure_running()
alone = {os.getpid(), forkserver._forkserver._forkserver_pid, resource_tracker._resource_tracker._pid}
rng, child = random.Random(1), None
for _ in range(int(sys.argv[1])):
    enough, child = there() + rng.randint(1, 6), child or sweep()
    while there() < enough and os.waitpid(child, os.WNOHANG) == (0, 0):
        time.sleep(0.002)
    time.sleep(rng.uniform(0.0, 0.05))
    workers = [one for one in ours() if one not in alone and one != child]
    # One that is the only worker may have a run for the last time.
    if len(workers) == 2 and rng.random() < 0.5:
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(rng.choice(workers), signal.SIGKILL)
        print("worker", there(), 0, half(), flush=True)
        continue
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    child, until = None, time.monotonic() + 30
    while set(ours()) > alone and time.monotonic() < until:
        time.sleep(0.05)
    print("sweep", there(), len(set(ours()) - alone), half(), flush=True)
if child is not None:
    assert os.waitpid(child, 0)[1] == 0
assert os.waitpid(sweep(), 0)[1] == 0
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no signal that kills at once")
def test_sweeps_and_workers_that_are_killed_at_any_moment_leave_nothing(tmp_path: Path) -> None:
    large = design(replications=2 + 2 * KILLS)
    in_a_thread(large, tmp_path / "whole")
    (tmp_path / "study.toml").write_text(tomli_w.dumps(large.spoken()))
    (tmp_path / "slow_disk.py").write_text(SLOW_DISK)
    setting = {"MARK": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"}
    setting["PYTHONPATH"] = os.pathsep.join((str(ROOT), str(tmp_path)))
    killed = python("-c", KILLER, str(KILLS), cwd=tmp_path, **setting)
    assert killed.returncode == 0, killed.stderr
    lines = [line.split() for line in killed.stdout.splitlines()]
    assert len(lines) == KILLS
    assert {"worker", "sweep"} >= {victim for victim, *_ in lines}
    assert all(0 < int(there) < 4 * large.replications for _, there, _, _ in lines)
    assert all(int(orphans) == 0 for _, _, orphans, _ in lines)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


# -- what a folder may become ----------------------------------------------------------------------------


def test_a_folder_grows_by_values_and_replications(reference: StudyResults, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(reference.folder, out)
    before = contents(out)
    axes = [{**DESIGN["axes"][0], "values": [0, 0.5, 2]}, DESIGN["axes"][1]]
    grown = design(axes=axes, replications=3)
    table = planned(grown, Store(out))
    assert table["replications"].tolist() == [3] * 6
    assert table["done"].tolist() == [2, 2, 0, 0, 2, 2]
    results = in_a_thread(grown, out)
    after = contents(out)
    frames = [name for name in before if name.startswith(("signals/", "demand/"))]
    assert len(frames) == 16
    assert all(after[name] == before[name] for name in frames)
    assert results.runs["latency"].unique().tolist() == [0.0, 0.5, 2.0]
    in_a_thread(grown, tmp_path / "fresh")
    assert after == contents(tmp_path / "fresh")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"replications": 1}, "more replications at latency = 0.0, kind = ticks than the study (1)"),
        (
            {"axes": [{**DESIGN["axes"][0], "values": [0]}, DESIGN["axes"][1]]},
            "has runs at latency = 2.0, kind",
        ),
        ({"where": "latency > 0"}, "has runs at latency = 0.0"),
        ({"axes": DESIGN["axes"][:1]}, "axes of the study = ['latency']"),
        ({"seed": 1}, "the scenario or the seed at latency = 0.0, kind = ticks is not that"),
        ({"paired": False}, "the scenario or the seed at"),
        ({"scenario": {**BASE, "until": 31}}, "the scenario or the seed at"),
        ({"keep": ["signals"]}, "keep of the study = ['signals']"),
        ({"measures": ["signals"]}, "measures of the study = ['signals']"),
        (
            {
                "axes": [
                    DESIGN["axes"][0],
                    {"name": "kind", "cases": {"t": {}, "f": {"dynamics": "continuous"}}},
                ]
            },
            "the runs at latency = 0.0, kind = ticks have other names",
        ),
    ],
)
def test_another_study_in_the_same_folder_is_refused(
    reference: StudyResults, changes: dict[str, Any], sentence: str
) -> None:
    before = contents(reference.folder)
    with pytest.raises(InputError) as caught:
        in_a_thread(design(**changes), reference.folder)
    assert sentence in str(caught.value)
    assert "choose another folder, or say --overwrite" in str(caught.value)
    assert contents(reference.folder) == before


def test_results_of_another_version_are_refused(
    reference: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("aimd_des.study.plan_table.RESULT_VERSION", 2)
    with pytest.raises(InputError, match="result version of"):
        in_a_thread(design(), reference.folder)


def test_a_study_takes_the_place_of_another_if_it_is_told_to(reference: StudyResults, tmp_path: Path) -> None:
    out = tmp_path / "out"
    in_a_thread(design(keep=["events"], axes=[]), out)
    in_a_thread(design(), out, overwrite=True)
    assert contents(out) == contents(reference.folder)


def test_folders_of_others_are_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years")
    for overwrite in (False, True):
        with pytest.raises(InputError, match=r"it has no manifest.json but 'thesis.tex'"):
            in_a_thread(design(), tmp_path, overwrite=overwrite)
        with pytest.raises(InputError, match="it is a file"):
            in_a_thread(design(), tmp_path / "thesis.tex", overwrite=overwrite)
    assert contents(tmp_path) == {"thesis.tex": b"years"}
    with pytest.raises(InputError, match="that of a study"):
        load_study(tmp_path)
    with pytest.raises(InputError, match="that of a study"):
        load_study(tmp_path / "nowhere")


def test_results_that_are_not_all_there_yet(reference: StudyResults, tmp_path: Path) -> None:
    shutil.copytree(reference.folder, tmp_path / "out")
    first, second = reference.plan["key"][:2]
    forget(tmp_path / "out", first)
    partial = load_study(tmp_path / "out")
    assert partial.missing["key"].tolist() == [first]
    assert partial.runs["key"].iloc[0] == second
    assert first not in set(partial.frame("signals")["key"])
    shutil.rmtree(tmp_path / "out/runs")
    empty = load_study(tmp_path / "out")
    assert list(empty.runs.columns) == list(reference.runs.columns)
    assert empty.runs.empty
    assert empty.frame("signals").empty
    with pytest.raises(InputError, match="that of a run in"):
        empty.scenario(first)


def test_the_scenario_of_a_point_is_in_the_folder_and_a_run_adds_its_seed(reference: StudyResults) -> None:
    points = pd.read_parquet(reference.folder / "points.parquet").set_index("point")["scenario"]
    assert points.index.tolist() == reference.plan["point"].cat.categories.tolist()
    first = reference.plan.iloc[0]
    data = {**tomllib.loads(points[first["point"]]), "seed": int(first["seed"])}
    assert reference.scenario(first["key"]).spoken() == data
